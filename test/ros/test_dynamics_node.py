"""`dynamics_node`: the bits of its blocks, lost and wrong loads, lifecycle; and behind a load node, as processes."""

import math
import signal

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from geometry_msgs.msg import AccelStamped  # noqa: E402
from peer import stamps  # noqa: E402
from sensor_msgs.msg import JointState, PointCloud2  # noqa: E402

from tbm_dynamics import load_machine, simulate  # noqa: E402
from tbm_dynamics.machine.loading import machine_text  # noqa: E402
from tbm_dynamics.nodes.dynamics_node import DynamicsNode  # noqa: E402
from tbm_msgs_py import ACCELERATION, LOADS  # noqa: E402
from tbm_msgs_py.blocks import mesh_forces  # noqa: E402
from tbm_msgs_py.nodes import messages, qos  # noqa: E402
from tbm_msgs_py.topics import TEST_POINTS  # noqa: E402

pytestmark = pytest.mark.ros

NODE, STATUS = "/tbm/dynamics_node", "tbm: dynamics"
BLOCK_NS, SAMPLES, DT = 50_000_000, 500, 1e-4
START_NS = 1_700_000_000_000_000_000


class Loads:
    """Publishes load blocks of the library, any of them."""

    def __init__(self, peer, seed=4, matched=1):
        self._peer = peer
        self._loads = load_machine("dz101").loads(seed=seed)
        self._publisher = peer.publisher(PointCloud2, "/tbm/loads/block", qos.BLOCK, matched)

    def wait_until_matched(self):
        self._peer.wait_for(self._publisher.get_subscription_count)

    def values(self, block):
        return self._loads.evaluate(np.arange(block * SAMPLES, (block + 1) * SAMPLES) * DT)

    def send(self, block, values=None, layout=LOADS, spacing=DT):
        values = self.values(block) if values is None else values
        message = messages.block(layout, START_NS + block * BLOCK_NS, np.arange(len(values)) * spacing, values)
        self._publisher.publish(message)


def listen_to_model(peer):
    received = {point: peer.listen(PointCloud2, f"/tbm/model/{point}/block", qos.BLOCK) for point in TEST_POINTS}
    received["meshes"] = peer.listen(PointCloud2, "/tbm/model/mesh_forces", qos.BLOCK)
    return received


@pytest.fixture
def off_axis(tmp_path):
    """The shipped machine with a sensor that sits off its node."""
    text = machine_text("dz101")
    file = tmp_path / "machine.yaml"
    file.write_text(text.replace("girder: 47", "girder: {node: 47, offset: [0, 1.2, 0]}"))
    assert file.read_text() != text
    return str(file)


def test_live_equals_offline_bit_for_bit(run_node, peer, off_axis):
    loads = peer.listen(PointCloud2, "/tbm/loads/block", qos.BLOCK)
    model = listen_to_model(peer)
    accel = peer.listen(AccelStamped, "/tbm/model/shield/accel", qos.LIVE)
    drives = peer.listen(JointState, "/tbm/model/drives", qos.LIVE)
    nodes = [
        run_node("dynamics_node", seed=5, machine=off_axis),
        run_node("load_node", seed=5, wait_for_subscribers=2),
    ]
    peer.wait_for(lambda: all(len(blocks) >= 20 for blocks in model.values()))
    epoch = stamps(loads)[0]
    last = max(stamps(blocks)[-1] for blocks in model.values())
    machine = load_machine(off_axis)
    response = simulate(machine, duration=(last - epoch) / 1e9 + 0.05, seed=5)
    for name, blocks in model.items():
        decoded = [messages.block_from(message) for message in blocks]
        assert set(np.diff(stamps(blocks))) == {BLOCK_NS}
        if name == "meshes":
            layout, offline = mesh_forces(10), response.mesh_force[::2]
        else:
            layout = ACCELERATION
            offline = response.acceleration(machine.description.test_points[name])[::2, :3].astype(np.float32)
        for block in decoded:
            assert block.layout == layout
            first = (block.stamp_ns - epoch) // 200_000
            assert np.allclose(block.offsets, np.arange(250) / 5000, rtol=0.0, atol=1e-12)
            assert np.array_equal(block.values, offline[first : first + 250]), f"{name} at sample {first}"
    for live in (accel, drives):
        spacing = np.diff(stamps(live))
        assert not (spacing % 10_000_000).any()  # 100 Hz; best effort
    assert list(drives[0].name) == [f"drive_{i}" for i in range(1, 11)]
    torque = np.mean([message.effort for message in drives])
    gear = machine.description.driveshaft.gear
    assert torque == pytest.approx(3.04e6 / 10 * gear.pinion_teeth / gear.ring_teeth, rel=0.3)
    assert list(drives[0].velocity) == pytest.approx([5.6 * math.pi / 30.0 * gear.ring_teeth / gear.pinion_teeth] * 10)
    peer.wait_for(lambda: peer.text(STATUS) == "integrating")
    assert peer.value(STATUS, "lost_steps") == "0"
    assert float(peer.value(STATUS, "real_time_factor")) > 0.0
    for node in nodes:  # a signal while blocks stream: an end without a word
        node.send(signal.SIGINT)
        assert node.exit_code() == 0, node.output
        assert not node.output.strip()


def test_sensors_at_a_rate_of_their_own(host_node, peer):
    """Every fifth of the samples that sensors at block_rate would send; the mesh forces keep theirs."""
    model = listen_to_model(peer)
    node = host_node(DynamicsNode, block_samples=50, **{"sensor.rate": 1000})
    loads = Loads(peer)
    node.wait_for(lambda: peer.text(STATUS) == "no block on loads/block yet")
    for k in range(4):
        loads.send(k)
    node.wait_for(lambda: len(model["meshes"]) == 20 and len(model["shield"]) == 4)
    shield, meshes = (messages.block_from(model[name][0]) for name in ("shield", "meshes"))
    assert np.diff(shield.offsets) == pytest.approx(np.full(49, 1e-3))
    assert np.diff(meshes.offsets) == pytest.approx(np.full(49, 2e-4))


def test_lost_and_wrong_blocks(host_node, peer):
    model = listen_to_model(peer)
    node = host_node(DynamicsNode)
    loads = Loads(peer)
    meshes = model["meshes"]
    node.wait_for(lambda: peer.text(STATUS) == "no block on loads/block yet")
    for k in range(6):
        loads.send(k)
    for k in range(7, 10):  # block 6 is lost
        loads.send(k)
    peer.wait_for(lambda: len(meshes) == 10)
    node.wait_for(lambda: any("500 lost steps bridged" in text for text in peer.said[STATUS]))
    assert max(peer.levels[STATUS]) == 1
    assert peer.value(STATUS, "lost_steps") == "500"
    assert peer.value(STATUS, "restarts") == "0"
    for blocks in model.values():
        assert stamps(blocks) == [START_NS + k * BLOCK_NS for k in range(10)]
    force = np.concatenate([messages.block_from(message).values for message in meshes])
    jumps = np.abs(np.diff(force, axis=0)).max(axis=1)
    border = slice(6 * 250 - 2, 7 * 250 + 2)
    assert jumps[border].max() < 2.0 * jumps[250 : 6 * 250].max()

    nan = loads.values(10)
    nan[3, 2] = np.nan
    for wrong, reason in [
        ({"values": np.zeros((500, 3)), "layout": ACCELERATION}, "block channels ax ay az"),
        ({"values": nan}, "not finite"),
        ({"values": loads.values(10)[::2], "spacing": 2e-4}, "allowed: 0.0001 s of load_rate 10000 Hz"),
    ]:
        loads.send(10, **wrong)
        node.wait_for(lambda reason=reason: reason in peer.text(STATUS))
        assert peer.diagnostics[STATUS].level >= 1  # an error where no good one comes for 2 s
    assert peer.value(STATUS, "refused_blocks") == "3"
    loads.send(12, nan)  # wrong, and after a gap
    node.wait_for(lambda: peer.value(STATUS, "refused_blocks") == "4")
    for k in range(10, 13):
        loads.send(k)
    peer.wait_for(lambda: len(meshes) == 13)
    node.wait_for(lambda: peer.text(STATUS) == "integrating")
    assert peer.value(STATUS, "lost_steps") == "500"
    assert stamps(meshes) == [START_NS + k * BLOCK_NS for k in range(13)]

    for k in (-50, -49, -48):  # a stream that starts again, 3 s earlier
        loads.send(k)
    peer.wait_for(lambda: len(meshes) == 16)
    assert stamps(meshes)[13:] == [START_NS + k * BLOCK_NS for k in (-50, -49, -48)]
    node.wait_for(lambda: any("the loads jumped: the run started afresh" in text for text in peer.said[STATUS]))
    assert peer.value(STATUS, "restarts") == "1"

    loads.send(-47, 1e-3 * loads.values(-47))
    node.wait_for(lambda: "of the operating point's thrust: values in kN?" in peer.text(STATUS))
    loads.send(-46)
    node.wait_for(lambda: "kN?" not in peer.text(STATUS))


def test_only_an_active_node_answers(host_node, peer):
    meshes = peer.listen(PointCloud2, "/tbm/model/mesh_forces", qos.BLOCK)
    host_node(DynamicsNode, autostart=False)
    for _ in range(2):
        assert peer.transition(NODE, "configure")
        loads = Loads(peer, matched=0)
        loads.send(0)  # inactive: not answered
        assert peer.transition(NODE, "activate")
        loads.wait_until_matched()
        before = len(meshes)
        peer.wait_for(lambda: peer.node.count_publishers("/tbm/model/mesh_forces") == 1)
        for k in range(50, 60):
            loads.send(k)
        peer.wait_for(lambda before=before: len(meshes) > before)
        assert stamps(meshes)[before] >= START_NS + 50 * BLOCK_NS
        assert peer.transition(NODE, "deactivate")
        peer.wait_for(lambda: peer.node.count_subscribers("/tbm/loads/block") == 0)  # nothing waits while inactive
        assert peer.transition(NODE, "cleanup")
        peer.wait_for(lambda: peer.node.count_publishers("/tbm/model/mesh_forces") == 0)
