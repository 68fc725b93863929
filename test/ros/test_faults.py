"""The system under faults: each is on `/diagnostics` within two windows and gone when it is over; no state jumps.

Loads, dynamics and analysis in this process, on a simulated clock that wall time follows.
"""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from peer import Peer, SimulatedClock, stamps  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402

from tbm_dynamics import load_machine, simulate  # noqa: E402
from tbm_dynamics.nodes import pacer  # noqa: E402
from tbm_dynamics.nodes.dynamics_node import DynamicsNode  # noqa: E402
from tbm_dynamics.nodes.load_node import LoadNode  # noqa: E402
from tbm_gsa.app.nodes import stream_health  # noqa: E402
from tbm_gsa.app.nodes.analysis_node import AnalysisNode  # noqa: E402
from tbm_msgs_py import ACCELERATION, LOADS  # noqa: E402
from tbm_msgs_py.nodes import messages, qos, rate  # noqa: E402
from tbm_msgs_py.topics import TEST_POINTS, WINDOW  # noqa: E402

pytestmark = pytest.mark.ros

DYNAMICS = "tbm: dynamics"
OK, WARN, ERROR, STALE = range(4)
SEED = 7
START_NS = 1_700_000_000_000_000_000
BLOCK_S = 0.05
STATUS_S = 1.0  # between messages on /diagnostics


def comparison(point):
    return f"tbm: comparison {point}"


ALL = (DYNAMICS, "tbm: loads", *map(comparison, TEST_POINTS))


class Field:
    """Sensors that measure what the model says, 10 % less; each can be spoilt."""

    def __init__(self, peer):
        self._peer = peer
        self._send = {p: self._publisher(peer.node, p) for p in TEST_POINTS}
        self.spoilt = {}
        for point in TEST_POINTS:
            callback = partial(self._measure, point)
            peer.node.create_subscription(PointCloud2, f"/tbm/model/{point}/block", callback, qos.BLOCK)

    def _publisher(self, node, point):
        return node.create_publisher(PointCloud2, f"/tbm/field/{point}/block", qos.BLOCK)

    def _measure(self, point, message):
        block = messages.block_from(message)
        self.spoilt.get(point, sound)(self._send[point], point, block.stamp_ns, block.offsets, 0.9 * block.values)

    def second(self, node, point, ahead_ns=0):
        """Fault: another node sends the same, with other stamps."""
        other = self._publisher(node, point)

        def both(send, name, stamp, *block):
            sound(send, name, stamp, *block)
            sound(other, name, stamp + ahead_ns, *block)

        return both


def sound(send, point, stamp, offsets, values, layout=ACCELERATION):
    send.publish(messages.block(layout, stamp, offsets, values, point))


def in_g(send, point, stamp, offsets, values):
    sound(send, point, stamp, offsets, values / 9.80665)


def not_finite(send, point, stamp, offsets, values):
    sound(send, point, stamp, offsets, np.where(np.arange(len(values))[:, None] == 7, np.nan, values))


def wrong_frame(send, point, stamp, offsets, values):
    sound(send, "shield", stamp, offsets, values)


def wrong_fields(send, point, stamp, offsets, values):
    sound(send, point, stamp, offsets, np.tile(values, 2), LOADS)


def wrong_rate(send, point, stamp, offsets, values):
    sound(send, point, stamp, 2.0 * offsets, values)


def half_the_spacing(send, point, stamp, offsets, values):
    sound(send, point, stamp, 0.5 * offsets, values)


def silent(*_):
    """Nothing comes."""


@pytest.fixture(scope="module")
def system():
    """Loads, dynamics and analysis with a field; the tests share them and leave them sound."""
    with Peer() as peer, pytest.MonkeyPatch.context() as patch:
        clock = SimulatedClock(peer, START_NS)
        for module in (stream_health, rate, pacer):
            patch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock.now_ns * 1e-9))
        yield System(peer, clock)


class System:
    def __init__(self, peer, clock):
        self.peer, self.clock = peer, clock
        self.meshes = peer.listen(PointCloud2, "/tbm/model/mesh_forces", qos.BLOCK)
        self.loads = peer.listen(PointCloud2, "/tbm/loads/block", qos.BLOCK)
        self.field = Field(peer)
        self._nodes = [
            peer.host(AnalysisNode, use_sim_time=True, history="none", **{"gsa.on_threshold": False}),
            peer.host(DynamicsNode, use_sim_time=True, seed=SEED),
            peer.host(LoadNode, use_sim_time=True, seed=SEED),
        ]
        for node in self._nodes:
            node.asked_only = True  # or a timer of wall time divides a step of the simulated clock
        self.wait_until_sound()

    def step(self):
        """A status period of every node."""
        for _ in range(round(STATUS_S / BLOCK_S)):
            self.clock.tick(BLOCK_S)
        for node in self._nodes:
            node.report()

    def wait_for(self, condition, step=None):
        self.peer.wait_for(condition, step=step or self.step)

    def level(self, status):
        return self.peer.diagnostics[status].level if status in self.peer.diagnostics else None

    def shows(self, faults, names=ALL):
        """Whether `/diagnostics` shows the faults (level, text) by status, and the others of the names as sound."""
        wanted = {name: faults.get(name, (OK, "")) for name in names}
        return all(self.level(name) == level and text in self.peer.text(name) for name, (level, text) in wanted.items())

    def wait_until_sound(self):
        self.wait_for(lambda: self.shows({}))

    def has_fault_for(self, spoilt, faults):
        """Let sensors err: faults are shown, and gone afterwards, within two windows of the stream's time."""
        for change, expected in ((spoilt, faults), ({}, {})):
            self.field.spoilt = change
            since = stamps(self.meshes)[-1]
            self.wait_for(lambda expected=expected: self.shows(expected))
            # The first window in which something is wrong from its beginning, two of them, and the next message.
            assert (stamps(self.meshes)[-1] - since) * 1e-9 < WINDOW + 2.0 * WINDOW + 2.0 * STATUS_S


def test_sensors_that_err_are_named(system):
    spoilt = {
        "cutterhead": wrong_rate,
        "shield": in_g,
        "walkway": wrong_fields,
        "girder": not_finite,
        "gripper": wrong_frame,
    }
    faults = {
        "cutterhead": (WARN, "samples of the field late or twice: another rate than declared"),
        "shield": (WARN, "0.102 times the model on all axes: values in g?"),
        "walkway": (ERROR, "block channels fx fy fz mx my mz, allowed: ax ay az; not used"),
        "girder": (WARN, "samples of the field that are not finite"),
        "gripper": (ERROR, "frame_id shield, allowed: gripper"),
    }
    system.has_fault_for(spoilt, {comparison(point): fault for point, fault in faults.items()})


def test_two_publishers_none_and_gaps_between_blocks(system):
    other = rclpy.create_node("other_rig")
    spoilt = {
        "shield": system.field.second(other, "shield"),
        "cutterhead": system.field.second(other, "cutterhead", 3_600_000_000_000),
        "walkway": system.field.second(other, "walkway", -700_000_000),
        "girder": silent,
        "gripper": half_the_spacing,
    }
    faults = {
        comparison("shield"): (WARN, "2 publishers on field/shield/block, other_rig, peer"),
        comparison("cutterhead"): (WARN, "2 publishers on field/cutterhead/block, other_rig, peer"),
        comparison("walkway"): (WARN, "2 publishers on field/walkway/block, other_rig, peer"),
        comparison("girder"): (STALE, "no signal of the field for"),
        comparison("gripper"): (WARN, "gaps between the blocks of the field: 10000 Hz declared, 5000 Hz came"),
    }
    counted = [system.peer.value(comparison(point), "field_restarts") for point in TEST_POINTS]
    system.has_fault_for(spoilt, faults)
    assert [system.peer.value(comparison(point), "field_restarts") for point in TEST_POINTS] == counted
    for point in ("shield", "cutterhead", "walkway"):  # 10 % less than the model, whatever the other said
        assert float(system.peer.value(comparison(point), "relative_error_x")) == pytest.approx(1 / 9, abs=0.01)
    other.destroy_node()


BESIDE = "blocks beside the stream dropped: 2 publishers, load_node, peer"


def test_loads_of_others_change_no_bit_of_the_run(system):
    peer = system.peer
    machine = load_machine("dz101")
    publisher = peer.publisher(PointCloud2, "/tbm/loads/block", qos.BLOCK)
    values, steps = np.ones((500, 6)), np.arange(500) * 1e-4
    for wrong, reason in (
        ({"values": np.full((500, 6), np.nan)}, "not finite"),
        ({"values": values[:, :3], "layout": ACCELERATION}, "block channels ax ay az"),
        ({"values": values, "frame": "girder"}, "block frame_id girder, allowed: cutterhead"),
        ({"values": values, "spacing": 2.0}, "allowed: 0.0001 s of load_rate 10000 Hz"),
        ({"values": values, "spacing": 1e20}, "s from the stamp, allowed: below 86400 s"),
        *(({"values": values, "late": late}, BESIDE) for late in (70_000_000, -1_030_000_000, -10 * 10**9, 10**18)),
    ):
        before = len(peer.said[DYNAMICS])

        def send(wrong=wrong):
            stamp = stamps(system.meshes)[-1] - wrong.get("late", 0)
            offsets = steps * wrong.get("spacing", 1.0)
            layout = wrong.get("layout", LOADS)
            publisher.publish(messages.block(layout, stamp, offsets, wrong["values"], wrong.get("frame", "")))
            system.step()

        system.wait_for(
            lambda before=before, reason=reason: any(reason in t for t in peer.said[DYNAMICS][before:]), send
        )
        assert max(peer.levels[DYNAMICS][before:]) == WARN
    peer.node.destroy_publisher(publisher)
    system.wait_until_sound()
    counted = peer.value(DYNAMICS, "restarts"), peer.value(DYNAMICS, "lost_steps")
    assert counted == ("0", "0"), peer.said[DYNAMICS]
    epoch = stamps(system.loads)[0]
    response = simulate(machine, duration=(stamps(system.meshes)[-1] - epoch) / 1e9 + 0.05, seed=SEED)
    for message in system.meshes:
        block = messages.block_from(message)
        first = (block.stamp_ns - epoch) // 200_000
        assert np.array_equal(block.values, response.mesh_force[::2][first : first + 250]), f"at sample {first}"
