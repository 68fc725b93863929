"""`load_node`: lifecycle, the bits of its blocks, the operating point, the clock."""

import math
from itertools import pairwise

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from geometry_msgs.msg import WrenchStamped  # noqa: E402
from peer import SimulatedClock, stamps  # noqa: E402
from sensor_msgs.msg import JointState, PointCloud2  # noqa: E402

from tbm_dynamics import load_machine  # noqa: E402
from tbm_dynamics.nodes.load_node import LoadNode  # noqa: E402
from tbm_dynamics.streaming.schedule import read_schedule  # noqa: E402
from tbm_dynamics.streaming.streams import LoadStream  # noqa: E402
from tbm_msgs_py import LOADS, OperatingPoint  # noqa: E402
from tbm_msgs_py.base.operating_point import from_joint_state  # noqa: E402
from tbm_msgs_py.nodes import messages, qos  # noqa: E402
from tbm_msgs_py.topics import QoS  # noqa: E402

pytestmark = pytest.mark.ros

DEEP = qos.profile(QoS(reliable=True, latched=True, depth=64))
NODE = "/tbm/load_node"
BLOCK_NS, SAMPLES, DT = 50_000_000, 500, 1e-4
TABLE_1 = (5.6 * 2 * math.pi / 60, 3.04e6, 1.20e7)


START_NS = 1_000_000_000_000


@pytest.fixture
def clock(peer):
    return SimulatedClock(peer, START_NS)


def expected(seed, block):
    """Loads of a block by the library, (500, 6)."""
    return load_machine("dz101").loads(seed=seed).evaluate(np.arange(block * SAMPLES, (block + 1) * SAMPLES) * DT)


def drive(message):
    point = from_joint_state(message)
    return point.speed, point.torque, point.thrust


def scale_of(point):
    return load_machine("dz101").load_scale(OperatingPoint(point.speed, point.torque, point.thrust))


def test_lifecycle_and_the_bits_of_the_blocks(host_node, peer, clock):
    host_node(LoadNode, use_sim_time=True, autostart=False, seed=3)
    blocks = peer.listen(PointCloud2, "/tbm/loads/block", qos.BLOCK)
    assert peer.state(NODE) == "unconfigured"
    assert peer.transition(NODE, "configure")
    assert peer.state(NODE) == "inactive"
    wrenches = peer.listen(WrenchStamped, "/tbm/loads/wrench", qos.BLOCK)
    peer.wait_for(lambda: peer.node.count_publishers("/tbm/loads/wrench") == 1)
    asked = clock.now_ns
    assert peer.transition(NODE, "activate")
    clock.run_until(lambda: len(blocks) >= 8 and len(wrenches) >= 30)
    decoded = [messages.block_from(message) for message in blocks[:8]]
    epoch = decoded[0].stamp_ns
    assert epoch >= asked - 100_000  # rounded to the step
    assert epoch % 100_000 == 0
    for k, block in enumerate(decoded):
        assert block.layout == LOADS
        assert block.stamp_ns == epoch + k * BLOCK_NS
        assert np.array_equal(block.offsets, np.arange(SAMPLES) * 1e5 / 1e9)
        assert np.array_equal(block.values, expected(3, k)), f"block {k}"
    step, late = np.divmod(stamps(wrenches)[0] - epoch, 10_000_000)
    assert late == 0
    assert set(np.diff(stamps(wrenches))) == {10_000_000}
    sample = int(step) * 100
    assert wrenches[0].wrench.torque.x == expected(3, sample // SAMPLES)[sample % SAMPLES, 3]

    points = peer.listen(JointState, "/tbm/loads/operating_point", qos.OPERATING_POINT)  # latched: comes to the late
    peer.wait_for(lambda: points)
    assert drive(points[0]) == pytest.approx(TABLE_1)

    assert not peer.transition(NODE, "activate"), "it is active already"
    assert peer.state(NODE) == "active"
    assert peer.transition(NODE, "deactivate")
    assert peer.state(NODE) == "inactive"
    stopped = clock.now_ns
    assert peer.transition(NODE, "activate")
    clock.run_until(lambda: stamps(blocks)[-1] >= stopped + 2 * BLOCK_NS)
    again = [message for message in blocks if messages.stamp_to_ns(message.header.stamp) >= stopped - BLOCK_NS]
    first = next(m for m in again if np.array_equal(messages.block_from(m).values, expected(3, 0)))
    assert messages.stamp_to_ns(first.header.stamp) >= stopped - 100_000, "the stream starts afresh"

    assert peer.transition(NODE, "deactivate")
    assert peer.transition(NODE, "cleanup")
    peer.wait_for(lambda: peer.node.count_publishers("/tbm/loads/block") == 0)
    assert peer.transition(NODE, "configure")
    assert peer.transition(NODE, "activate")
    peer.wait_for(lambda: peer.node.count_publishers("/tbm/loads/block") == 1)
    before = len(blocks)
    clock.run_until(lambda: len(blocks) > before + 2)


def test_an_operating_point_is_applied_or_refused(host_node, peer, clock):
    blocks = peer.listen(PointCloud2, "/tbm/loads/block", qos.BLOCK)
    points = peer.listen(JointState, "/tbm/loads/operating_point", qos.OPERATING_POINT)
    node = host_node(LoadNode, use_sim_time=True, seed=1)
    clock.run_until(lambda: len(blocks) > 2 and points)
    publisher = peer.publisher(JointState, "/tbm/operating_point", qos.OPERATING_POINT)

    for refused, reason in [
        (OperatingPoint(-0.5, 3e6, 1e7), "speed must be positive"),
        (JointState(name=["cutterhead", "thrust"], velocity=[0.5, 0.0], effort=[math.nan, 1e7]), "not finite"),
        (JointState(name=["cutter"], velocity=[1.0], effort=[1.0]), "cutter, allowed: both cutterhead, thrust"),
    ]:
        message = refused if isinstance(refused, JointState) else messages.operating_point_message(0, refused)
        publisher.publish(message)
        peer.wait_for(lambda reason=reason: node.says(reason))
    node.wait_for(lambda: peer.value("tbm: loads", "refused_operating_points") == "3")
    assert len(node.output.strip().splitlines()) == 3, node.output
    assert len(points) == 1

    wanted = OperatingPoint(TABLE_1[0] * 1.1, 2.0e6, 0.9e7)
    publisher.publish(messages.operating_point_message(0, wanted))
    clock.run_until(lambda: len(points) == 2)
    assert drive(points[1]) == (wanted.speed, wanted.torque, wanted.thrust)
    changed = stamps(points)[1]
    # A reader that is late gets the newest, not the first that is kept.
    late = peer.listen(JointState, "/tbm/loads/operating_point", DEEP)
    peer.wait_for(lambda: late)
    assert stamps(late) == stamps(points)[-1:]
    clock.run_until(lambda: stamps(blocks)[-1] > changed)
    scale = scale_of(wanted)
    decoded = [messages.block_from(message) for message in blocks]
    assert {b.stamp_ns - a.stamp_ns for a, b in pairwise(decoded)} == {BLOCK_NS}
    for k, block in enumerate(decoded):
        share = np.arange(1, SAMPLES + 1)[:, None] / SAMPLES
        share = np.clip(share + (block.stamp_ns - changed) // BLOCK_NS, 0.0, 1.0)
        np.testing.assert_allclose(block.values, expected(1, k) * (1.0 + share * (scale - 1.0)), rtol=1e-9)


def test_an_operating_point_before_the_start_holds_from_it(host_node, peer, clock):
    wanted = OperatingPoint(TABLE_1[0], 1.52e6, 1.0e7)
    blocks = peer.listen(PointCloud2, "/tbm/loads/block", qos.BLOCK)
    host_node(LoadNode, use_sim_time=True, autostart=False, seed=1)
    assert peer.transition(NODE, "configure")
    peer.publisher(JointState, "/tbm/operating_point", qos.OPERATING_POINT).publish(
        messages.operating_point_message(0, wanted)
    )
    peer.wait_for(lambda: peer.node.count_publishers("/tbm/loads/block") == 1)
    points = peer.listen(JointState, "/tbm/loads/operating_point", qos.OPERATING_POINT)
    assert peer.transition(NODE, "activate")
    clock.run_until(lambda: blocks and points)
    assert drive(points[0]) == (wanted.speed, wanted.torque, wanted.thrust)
    first = messages.block_from(blocks[0])
    np.testing.assert_allclose(first.values, expected(1, 0) * scale_of(wanted), rtol=1e-9)


def test_the_stream_stands_and_starts_afresh_with_its_clock(host_node, peer, clock):
    blocks = peer.listen(PointCloud2, "/tbm/loads/block", qos.BLOCK)
    node = host_node(LoadNode, seed=2, use_sim_time=True)
    clock.run_until(lambda: len(blocks) >= 5)
    assert stamps(blocks)[0] >= START_NS
    assert stamps(blocks)[-1] + BLOCK_NS <= clock.now_ns
    for _ in range(20):
        clock.tick(0.0)
    assert peer.state(NODE) == "active"
    assert len(blocks) == 5, "nothing comes while the clock stands"
    clock.run_until(lambda: len(blocks) >= 7)
    assert set(np.diff(stamps(blocks))) == {BLOCK_NS}

    clock.now_ns = back = START_NS - 60_000_000_000
    clock.run_until(lambda: len(blocks) >= 10)
    assert node.says("starts afresh")
    fresh = blocks[7:]
    assert back <= stamps(fresh)[0] < back + 1_000_000_000
    assert set(np.diff(stamps(fresh))) == {BLOCK_NS}
    assert np.array_equal(messages.block_from(fresh[0]).values, expected(2, 0))


def test_no_block_comes_before_its_subscribers(host_node, peer, clock):
    node = host_node(LoadNode, use_sim_time=True, wait_for_subscribers=1)
    clock.run_for(1.0)
    node.wait_for(lambda: "waiting for the clock or for subscribers" in peer.text("tbm: loads"))
    blocks = peer.listen(PointCloud2, "/tbm/loads/block", qos.BLOCK)
    clock.run_until(lambda: blocks)
    assert np.array_equal(messages.block_from(blocks[0]).values, expected(0, 0))
    assert not node.output


def test_disc_forces_on_a_schedule(host_node, peer, clock, tmp_path):
    rows = ["t,rpm,torque_kn_m,thrust_kn,cycle", "0,4.0,0,9000,a", "0.2,5.0,0,11000,a", "9,7.0,0,9000,b"]
    (tmp_path / "cycle.csv").write_text("\n".join(rows), "utf-8")
    blocks = peer.listen(PointCloud2, "/tbm/loads/block", qos.BLOCK)
    points = peer.listen(JointState, "/tbm/loads/operating_point", qos.OPERATING_POINT)
    node = host_node(
        LoadNode,
        use_sim_time=True,
        loads="cutter",
        seed=3,
        schedule=str(tmp_path / "cycle.csv"),
        schedule_columns="[time=t, speed=rpm]",
        schedule_where="[cycle=a]",
    )
    clock.run_until(lambda: len(blocks) >= 6)
    schedule = read_schedule(tmp_path / "cycle.csv", {"time": "t", "speed": "rpm"}, {"cycle": "a"})
    stream = LoadStream(load_machine("dz101"), 3, DT, SAMPLES, "cutter", schedule)
    for message in blocks[:6]:
        offline = stream.next_block()
        assert np.array_equal(messages.block_from(message).values, offline.loads)
    held = offline.operating_point  # at the end of the fourth block, 11 000 kN, and from there on
    assert drive(points[-1]) == (held.speed, held.torque, held.thrust)
    assert held.thrust == pytest.approx(11e6)
    peer.publisher(JointState, "/tbm/operating_point", qos.OPERATING_POINT).publish(
        messages.operating_point_message(0, OperatingPoint(0.5, 2e6, 1e7))
    )
    peer.wait_for(lambda: node.says("the loads follow a schedule; the last one stays"))
