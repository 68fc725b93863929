"""Nodes on the clock of a bag that is played fast and slowly, stands, and starts again."""

import signal
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from geometry_msgs.msg import Vector3Stamped  # noqa: E402
from peer import stamps  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402

from tbm_dynamics import load_machine, simulate  # noqa: E402
from tbm_dynamics.nodes.dynamics_node import DynamicsNode  # noqa: E402
from tbm_dynamics.nodes.load_node import LoadNode  # noqa: E402
from tbm_gsa.app.nodes.analysis_node import AnalysisNode  # noqa: E402
from tbm_msgs_py import ACCELERATION, BagWriter  # noqa: E402
from tbm_msgs_py.nodes import bag_player, messages, qos  # noqa: E402
from tbm_msgs_py.nodes.bag_player import BagPlayer  # noqa: E402
from tbm_msgs_py.topics import QoS  # noqa: E402

pytestmark = pytest.mark.ros

LOAD_NODE, DYNAMICS_NODE = "load_node", "dynamics_node"
ANALYSIS_NODE, PLAYER = "analysis_node", "bag_player"
START_NS = 1_700_000_000_000_000_000
BLOCK_NS, SEED = 50_000_000, 3
STEP_NS = 200_000  # of the blocks of the model


def recorded(path, seconds):
    with BagWriter(path) as writer:
        for k in range(seconds * 10**9 // BLOCK_NS):
            values = np.random.default_rng(k).standard_normal((250, 3))
            stamp = START_NS + k * BLOCK_NS
            writer.write_block("/tbm/field/shield/block", stamp, ACCELERATION, np.arange(250) / 5000, values)
    return path


# On a busy computer 64 blocks, a third of a second of a clock that runs ten times as fast, may not be enough.
DEEP = qos.profile(QoS(reliable=True, latched=False, depth=1000))


def deep(topic, side, *published):
    names = [f"{topic}.{side}", *(f"{name}.publisher" for name in published)]
    return {f"qos_overrides./tbm/{name}.depth": 1000 for name in names}


def runs(received):
    """Blocks of each run: one ends where the time goes back or leaps."""
    found = [[received[0]]] if received else []
    for before, after in pairwise(received):
        if stamps([after])[0] - stamps([before])[0] != BLOCK_NS:
            found.append([])
        found[-1].append(after)
    return found


@pytest.fixture
def wall(monkeypatch):
    """Wall time of the player, which passes when the test says so, in ns."""
    passed = SimpleNamespace(ns=0)
    monkeypatch.setattr(bag_player.time, "monotonic_ns", lambda: passed.ns)
    return passed


def test_nodes_follow_the_clock_of_a_bag(host_node, peer, tmp_path, wall):
    """In this process: the player's wall time passes when the nodes have done what was due."""
    loads = peer.listen(PointCloud2, "/tbm/loads/block", DEEP)
    meshes = peer.listen(PointCloud2, "/tbm/model/mesh_forces", DEEP)
    windows = peer.listen(Vector3Stamped, "/tbm/analysis/shield/model_rms", qos.ANALYSIS)
    host_node(AnalysisNode, use_sim_time=True, window=0.5, history="none", **{"gsa.on_threshold": False})
    dynamics = host_node(DynamicsNode, use_sim_time=True, seed=SEED, live_rate=1.0)
    driven = host_node(LoadNode, use_sim_time=True, seed=SEED, live_rate=1.0)
    player = host_node(BagPlayer, bag=recorded(tmp_path / "bag", 5), rate=0.5, loop=True)
    clock = peer.listen(Clock, "/clock", qos.CLOCK)

    def step():
        """A tick of the player, and what follows from it."""
        wall.ns += 20_000_000
        seen = len(clock)
        peer.wait_for(lambda: len(clock) > seen)
        peer.settle()

    def run_until(condition):
        peer.wait_for(condition, step=step)

    run_until(lambda: len(meshes) > 5)
    assert not peer.set_parameters("/tbm/bag_player", paused=True)
    standing = len(meshes)
    for _ in range(50):
        step()
    assert len(meshes) == standing
    for node, status in ((driven, "tbm: loads"), (dynamics, "tbm: dynamics")):
        node.wait_for(lambda status=status: peer.text(status) == "the clock stands")

    assert not peer.set_parameters("/tbm/bag_player", paused=False, rate=0.1)
    run_until(lambda: len(meshes) > standing + 1)
    assert peer.set_parameters("/tbm/bag_player", rate=20.0), "over its range"
    assert not peer.set_parameters("/tbm/bag_player", rate=10.0)
    run_until(lambda: len(runs(meshes)) > 2 and len(runs(meshes)[-1]) > 10)
    assert not peer.set_parameters("/tbm/bag_player", rate=1.0)
    run_until(lambda: len(runs(meshes)[-1]) > 40 and len(runs(windows)) > 2)

    player.close()  # the bag is over
    dynamics.wait_for(lambda: peer.text("tbm: dynamics") == "the clock stands")
    driven.report()
    assert any("the clock jumped" in line for line in driven.output.splitlines())
    assert int(peer.value("tbm: dynamics", "restarts")) >= 2
    assert peer.value("tbm: dynamics", "lost_steps") == "0", peer.said["tbm: dynamics"]
    assert all(start % 500_000_000 == 0 and start >= START_NS - 500_000_000 for start in stamps(windows))
    same_as_offline(loads, meshes, 5)


@pytest.mark.verify  # a busy computer does not keep up with a clock that runs ten times as fast
def test_processes_follow_the_clock_of_a_bag(run_node, peer, tmp_path):
    # Long beside what a busy computer takes to notice that the clock went back, a second and more at four times its
    # rate: over a gap the run of the dynamics goes on, and does not know that the loads behind it are of a new run.
    bag = recorded(tmp_path / "bag", 8)
    loads = peer.listen(PointCloud2, "/tbm/loads/block", DEEP)
    meshes = peer.listen(PointCloud2, "/tbm/model/mesh_forces", DEEP)
    windows = peer.listen(Vector3Stamped, "/tbm/analysis/shield/model_rms", qos.ANALYSIS)
    simulated = {"use_sim_time": True}
    # Few messages for the eye: ten times as fast they are most of the work, and a full computer loses blocks.
    driven = {"seed": SEED, "live_rate": 1.0, **simulated}
    run_node(ANALYSIS_NODE, window=0.5, **simulated, **{"gsa.on_threshold": False})
    run_node(DYNAMICS_NODE, **driven, **deep("loads/block", "subscription", "model/mesh_forces"))
    run_node(LOAD_NODE, wait_for_subscribers=2, **driven, **deep("loads/block", "publisher"))
    player = run_node(PLAYER, bag=bag, rate=0.5, loop=True)
    peer.wait_for(lambda: len(meshes) > 5)

    assert not peer.set_parameters("/tbm/bag_player", paused=True)
    peer.wait_for(lambda: peer.text("tbm: loads") == peer.text("tbm: dynamics") == "the clock stands")
    standing = len(meshes)
    peer.spin_for(0.3)
    assert len(meshes) == standing
    assert len(runs(meshes)) == 1

    assert not peer.set_parameters("/tbm/bag_player", paused=False, rate=0.1)
    peer.wait_for(lambda: len(meshes) > standing + 1)
    assert peer.set_parameters("/tbm/bag_player", rate=20.0), "over its range"
    assert not peer.set_parameters("/tbm/bag_player", rate=10.0)
    peer.wait_for(lambda: len(meshes) > standing + 40)
    # A full computer does not keep up with that for long, and would lose blocks.
    assert not peer.set_parameters("/tbm/bag_player", rate=4.0)
    peer.wait_for(lambda: len(runs(meshes)) > 2 and len(runs(meshes)[-1]) > 10)
    assert not peer.set_parameters("/tbm/bag_player", rate=1.0)
    peer.wait_for(lambda: len(runs(meshes)[-1]) > 40 and len(runs(windows)) > 2)

    player.send(signal.SIGTERM)  # the bag is over
    assert player.exit_code() == 0, player.output
    peer.wait_for(lambda: peer.text("tbm: dynamics") == "the clock stands")
    assert any("the clock jumped" in text for text in peer.said["tbm: loads"])
    assert int(peer.value("tbm: dynamics", "restarts")) >= 2
    assert peer.value("tbm: dynamics", "lost_steps") == "0", peer.said["tbm: dynamics"]

    assert all(start % 500_000_000 == 0 and start >= START_NS - 500_000_000 for start in stamps(windows))
    same_as_offline(loads, meshes, 8)


def same_as_offline(loads, meshes, length):
    """Every run has the stamps of its loads and the bits of an offline run, whatever the clock did."""
    machine = load_machine("dz101")
    response = simulate(machine, duration=length + 0.5, seed=SEED)
    offline = machine.loads(seed=SEED)
    for driven, moved in zip(runs(loads), runs(meshes), strict=True):
        epoch = stamps(driven)[0]
        assert START_NS <= epoch < START_NS + length * 1e9
        assert set(stamps(moved)) <= set(stamps(driven))
        for message in driven:
            block = messages.block_from(message)
            first = (block.stamp_ns - epoch) // 100_000
            assert np.array_equal(block.values, offline.evaluate(np.arange(first, first + 500) * 1e-4))
        for message in moved:
            block = messages.block_from(message)
            first = (block.stamp_ns - epoch) // STEP_NS
            assert np.array_equal(block.values, response.mesh_force[::2][first : first + 250])
