"""Publishers of others that offer less than the contract asks for, or another type: used, or named."""

from contextlib import ExitStack

import pytest

rclpy = pytest.importorskip("rclpy")

from peer import Rig, SimulatedClock  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from sensor_msgs.msg import JointState, PointCloud2  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402

from tbm_dynamics.nodes.dynamics_node import DynamicsNode  # noqa: E402
from tbm_dynamics.nodes.load_node import LoadNode  # noqa: E402
from tbm_gsa.app.nodes.analysis_node import AnalysisNode  # noqa: E402
from tbm_msgs_py import BagWriter, OperatingPoint  # noqa: E402
from tbm_msgs_py.nodes import messages, qos  # noqa: E402
from tbm_msgs_py.nodes.bag_player import BagPlayer  # noqa: E402
from tbm_msgs_py.nodes.matching import MatchingSubscription  # noqa: E402
from tbm_msgs_py.topics import QoS, contract  # noqa: E402

pytestmark = pytest.mark.ros

TOPIC, STATUS, NODE = "/tbm/operating_point", "tbm: loads", "tbm: load_node"
SPEED, TORQUE, THRUST = 0.5, 2.0e6, 1.0e7
OFFERS = {
    "a volatile publisher": (QoS(reliable=True, latched=False, depth=1), "is volatile, not transient local"),
    "a best effort one": (
        QoS(reliable=False, latched=False, depth=1),
        "is best effort, not reliable and volatile, not transient local",
    ),
    "a latched best effort one": (QoS(reliable=False, latched=True, depth=1), "is best effort, not reliable"),
}


def point(thrust, speed=SPEED, stamp=0):
    return messages.operating_point_message(stamp, OperatingPoint(speed, TORQUE, thrust))


def holds(peer, thrust):
    return lambda: peer.value(STATUS, "thrust_kn") == f"{thrust / 1e3:.6g}"


@pytest.mark.parametrize("offer", OFFERS)
def test_a_publisher_that_offers_less_is_used(host_node, peer, offer):
    """Beside one that offers all, whose messages come through both subscriptions and are used once."""
    quality, text = OFFERS[offer]
    node = host_node(LoadNode, use_sim_time=True)
    plc = peer.publisher(JointState, TOPIC, qos.OPERATING_POINT)
    with Rig(JointState, TOPIC, qos.profile(quality)) as rig:
        node.wait_for(lambda: rig.matched)
        assert node.says(f" {text}; what it sends from now on is used"), node.output
        peer.wait_for(lambda: plc.get_subscription_count() == 2)
        for step in range(3):
            rig.publish(point(THRUST + step * 1e4))
            node.wait_for(holds(peer, THRUST + step * 1e4))
            plc.publish(point(THRUST + step * 2e4 + 5e3))
            node.wait_for(holds(peer, THRUST + step * 2e4 + 5e3))
        plc.publish(point(-1.0))
        node.wait_for(lambda: peer.value(STATUS, "refused_operating_points"))
        peer.spin_for(0.1)
        node.wait_for(lambda: peer.value(STATUS, "refused_operating_points") == "1")


def test_every_subscription_matches_the_least_offer(host_node, peer):
    """Of every node of a machine; the field's, too, which follow their publishers."""
    host_node(DynamicsNode, use_sim_time=True)
    node = host_node(AnalysisNode, history="none", use_sim_time=True)
    states = dict.fromkeys((TOPIC, "/tbm/loads/operating_point"), JointState)
    blocks = dict.fromkeys(("/tbm/loads/block", "/tbm/model/girder/block", "/tbm/field/girder/block"), PointCloud2)
    with ExitStack() as rigs:
        least = qos.profile(QoS(reliable=False, latched=False, depth=1))
        made = [rigs.enter_context(Rig(kind, name, least)) for name, kind in (states | blocks).items()]
        node.wait_for(lambda: all(rig.matched for rig in made))


def test_run_hears_nodes_whose_parameters_offer_less(peer):
    """As `qos_overrides` in a parameter file has it."""
    with Rig(PointCloud2, "/tbm/loads/block", qos.profile(QoS(reliable=False, latched=False, depth=1))) as rig:
        received = []
        MatchingSubscription(peer.node, "loads/block", contract("loads/block"), received.append, print)
        peer.wait_for(lambda: rig.matched)
        rig.publish(messages.block(messages.blocks.LOADS, 10**18, [0.0], [[0.0] * 6]))
        peer.wait_for(lambda: received)


def test_an_override_of_no_topic_of_the_node_is_named(host_node):
    """A misspelt topic, the other direction: rclpy passes over both."""
    kept, misspelt, turned = (
        f"qos_overrides./tbm/{end}.depth"
        for end in ("loads/block.publisher", "loads/blok.publisher", "operating_point.publisher")
    )
    node = host_node(LoadNode, **dict.fromkeys((kept, misspelt, turned), 9))
    for name in (misspelt, turned):
        assert node.says(f"{name}: no such topic of this node can be overridden; not used")
    assert not node.says(f"{kept}:")


def test_a_late_subscriber_gets_the_newest_played(host_node, peer, tmp_path):
    """Of a latched topic of ours, whatever depth an earlier recording states."""
    with BagWriter(tmp_path / "field") as writer:
        for step in range(3):
            data = serialize_message(point(THRUST + step))
            deep = QoS(reliable=True, latched=True, depth=100)
            writer.write(TOPIC, "sensor_msgs/msg/JointState", 10**18 + step, data, qos=deep)
    player = host_node(BagPlayer, bag=tmp_path / "field", wait_for_subscribers=0, exit_at_end=False)
    peer.wait_for(lambda: player.says("3 messages played"))
    late = peer.listen(JointState, TOPIC, qos.profile(QoS(reliable=True, latched=True, depth=100)))
    peer.wait_for(lambda: late)
    assert [message.effort[1] for message in late] == [THRUST + 2]


def test_a_publisher_of_another_type_is_named(host_node, peer):
    node = host_node(LoadNode, use_sim_time=True)
    with Rig(Float64, TOPIC, qos.BLOCK):
        node.wait_for(lambda: "std_msgs/msg/Float64 of rig, allowed: sensor_msgs/msg/JointState" in peer.text(NODE))
        assert peer.diagnostics[NODE].level == 1
    node.wait_for(lambda: peer.text(NODE) == "active")


def test_a_machine_that_stands_still_is_no_fault(host_node, peer):
    clock = SimulatedClock(peer, 10**18)
    node = host_node(LoadNode, use_sim_time=True)
    clock.run_until(lambda: peer.text(STATUS))
    plc = peer.publisher(JointState, TOPIC, qos.OPERATING_POINT)
    for given, thrust, text in (
        (point(THRUST), THRUST, "streaming"),
        (point(0.9 * THRUST, speed=0.0), THRUST, "streaming as before: the machine stands still"),
        (point(0.8 * THRUST), 0.8 * THRUST, "streaming"),
    ):
        plc.publish(given)
        told = peer.said[STATUS]
        told.clear()

        def tick():
            clock.tick()
            node.report()

        peer.wait_for(lambda: text in told[-1:] and holds(peer, thrust)(), step=tick)  # noqa: B023 - waits here
        assert peer.diagnostics[STATUS].level == 0
    assert peer.value(STATUS, "refused_operating_points") == "0"
    assert not node.output


def joints(**changes):
    state = {"name": ["cutterhead", "thrust"], "velocity": [SPEED, 0.0], "effort": [TORQUE, THRUST]}
    return JointState(**(state | changes))


def with_nanoseconds(message, nanosec=4_000_000_000):
    message.header.stamp.sec, message.header.stamp.nanosec = 5, nanosec
    return message


WRONG = {
    "a joint twice": (
        joints(name=["cutterhead", "thrust", "cutterhead"], velocity=[0.5, 0.0, 0.1], effort=[1e6, 1e7, 2e6]),
        "cutterhead twice, allowed: each name once",
    ),
    "positions of some joints": (joints(position=[0.1]), "1 positions, allowed: 2, or none at all"),
    "a stamp that is no time": (with_nanoseconds(joints()), "no ROS time"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_joint_state_that_contradicts_itself_is_refused(host_node, peer, wrong):
    """By every node that listens, each in a line of its own."""
    message, text = WRONG[wrong]
    listeners = {
        LoadNode: (TOPIC, STATUS),
        DynamicsNode: ("/tbm/loads/operating_point", "tbm: dynamics"),
        AnalysisNode: (TOPIC, "tbm: analysis_node"),
    }
    for factory, (topic, status) in listeners.items():
        given = {"history": "none"} if factory is AnalysisNode else {}
        node = host_node(factory, use_sim_time=True, **given)
        publisher = peer.publisher(JointState, topic, qos.OPERATING_POINT, matched=1 + (factory is AnalysisNode))
        publisher.publish(message)
        node.wait_for(lambda status=status: text in peer.text(status))
        assert peer.diagnostics[status].level == 1
        lines = [line for line in node.output.splitlines() if f"] {topic.removeprefix('/tbm/')}: " in line]
        assert len(lines) == 1, node.output


@pytest.mark.parametrize(("kind", "topic"), [("block", "block"), ("sample", "accel")])
def test_a_field_stamp_that_is_no_time_is_called_that(host_node, peer, kind, topic):
    node = host_node(AnalysisNode, history="none")
    if kind == "block":
        message = messages.block(messages.blocks.ACCELERATION, 10**18, [0.0, 0.1], [[0.0] * 3] * 2)
        publisher = peer.publisher(PointCloud2, f"/tbm/field/girder/{topic}", qos.BLOCK)
    else:
        message = messages.accel(10**18, [0.0] * 3)
        publisher = peer.publisher(type(message), f"/tbm/field/girder/{topic}", qos.LIVE)
    for _ in range(3):
        publisher.publish(with_nanoseconds(message))
    node.wait_for(lambda: "no ROS time" in peer.text("tbm: comparison girder"))
    assert peer.diagnostics["tbm: comparison girder"].level == 2
