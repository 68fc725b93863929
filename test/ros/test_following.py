"""Publishers of a topic that disagree about its type, or change it: said while it lasts, and no node ends of it."""

from types import SimpleNamespace

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from geometry_msgs.msg import AccelStamped, Vector3Stamped  # noqa: E402
from nav_msgs.msg import Goals  # noqa: E402
from peer import Rig  # noqa: E402
from rclpy.qos import QoSProfile  # noqa: E402
from sensor_msgs.msg import Imu, JointState, PointCloud2  # noqa: E402
from std_msgs.msg import String  # noqa: E402

from tbm_gsa.app.nodes.live_view import LiveView  # noqa: E402
from tbm_msgs_py import ACCELERATION, Bag  # noqa: E402
from tbm_msgs_py.nodes import messages, qos  # noqa: E402
from tbm_msgs_py.nodes.bag_recorder import BagRecorder  # noqa: E402
from tbm_msgs_py.nodes.following import TopicFollower  # noqa: E402

pytestmark = pytest.mark.ros

OK, WARN, ERROR, STALE = range(4)
ACCEL, BLOCK, HEAD = "/tbm/field/girder/accel", "/tbm/field/shield/block", "/rig/head"
MAPPING = f"""
topics:
  {ACCEL}: {{point: girder, units: m/s2, gravity: removed, frame: fixed}}
  {BLOCK}: {{point: shield, units: m/s2, gravity: removed, frame: fixed}}
  {HEAD}: {{point: cutterhead, units: m/s2, gravity: removed, frame: fixed}}
"""


class Middleware:
    """Node and reader of a follower: a subscription is refused until the executor has let the one before it go."""

    def __init__(self):
        self.kinds, self.held, self.said = [], "", []

    def get_publishers_info_by_topic(self, topic):
        offered = QoSProfile(depth=1)
        return [SimpleNamespace(topic_type=kind, node_name=f"node_{kind}", qos_profile=offered) for kind in self.kinds]

    def destroy_subscription(self, subscription):
        assert subscription == self.held

    def refuses(self, topic, kind):
        return ""

    def requests(self, topic, offered):
        return offered.quality

    def subscribe(self, topic, offer):
        if self.held not in ("", offer.type):
            raise RuntimeError(f"{topic} is held\nas {self.held}")
        self.held = offer.type
        return offer.type

    def report(self, topic, problem):
        self.said.append(problem)


def test_another_type_is_tried_until_the_middleware_takes_it():
    given = Middleware()
    follower = TopicFollower(given, given)

    def look():
        follower.look("t")
        return given.said[-1], "t" in follower

    given.kinds = ["A"]
    assert look() == ("", True)
    given.kinds = ["A", "B"]
    assert look() == ("t: type B of node_B, allowed: A, which is in use; not used", True)
    given.kinds = ["B"]
    assert look() == ("", False)  # released, and nothing made yet
    for _ in range(3):
        assert look() == ("t: type B: t is held as A; not subscribed to", False)
    given.held = ""  # let go
    assert look() == look() == ("", True)
    assert given.held == "B"
    given.kinds = []
    assert look() == ("", True)
    follower.close()
    assert len(follower) == 0


class Clash:
    """What `/diagnostics` says of a status while rigs come and go."""

    def __init__(self, peer, status):
        self._peer, self._status = peer, status

    def is_said(self, *texts):
        self._peer.wait_for(lambda: self.level == ERROR and all(t in self._peer.text(self._status) for t in texts))

    def is_over(self):
        self._peer.wait_for(lambda: self.level not in (None, ERROR))

    @property
    def level(self):
        status = self._peer.diagnostics.get(self._status)
        return status and status.level


def test_types_that_clash_do_not_end_the_analysis(run_node, peer, tmp_path):
    (tmp_path / "mapping.yaml").write_text(MAPPING)
    node = run_node("analysis_node", history="none", mapping=tmp_path / "mapping.yaml")
    girder, shield = (Clash(peer, f"tbm: comparison {point}") for point in ("girder", "shield"))
    girder.is_over()
    accel, imu = "geometry_msgs/msg/AccelStamped", "sensor_msgs/msg/Imu"

    first = Rig(AccelStamped, ACCEL, qos.LIVE, "first")
    peer.wait_for(lambda: first.matched)
    with Rig(Imu, ACCEL, qos.LIVE, "other") as other:
        girder.is_said(f"{ACCEL}: type {imu} of other, allowed: {accel}, which is in use; not used")
        assert (first.matched, other.matched) == (1, 0)
        first.close()  # what is left is what is measured
        peer.wait_for(lambda: other.matched)
        girder.is_over()
        with Rig(AccelStamped, ACCEL, qos.BLOCK, "back"):
            girder.is_said(f"type {accel} of back, allowed: {imu}")
        girder.is_over()

    with Rig(String, BLOCK, qos.BLOCK, "talker"):
        shield.is_said(f"{BLOCK}: type std_msgs/msg/String of talker, allowed: sensor_msgs/msg/PointCloud2, {accel}")
    shield.is_over()
    with Rig(AccelStamped, BLOCK, qos.LIVE, "slow") as slow:
        peer.wait_for(lambda: slow.matched)
        with Rig(PointCloud2, BLOCK, qos.BLOCK, "fast") as fast:
            shield.is_said(f"type sensor_msgs/msg/PointCloud2 of fast, allowed: {accel}")
            slow.close()
            peer.wait_for(lambda: fast.matched)
            shield.is_over()

    for kind in (PointCloud2, Imu, Vector3Stamped, PointCloud2):
        with Rig(kind, HEAD, qos.LIVE) as head:
            peer.wait_for(lambda head=head: head.matched)
    assert peer.state("/tbm/analysis_node") == "active"
    assert peer.value("tbm: analysis_node", "failed_callbacks") == "0"
    assert not node.says("[ERROR]")


def block(number):
    return messages.block(ACCELERATION, number, np.arange(10) / 5000, np.full((10, 3), float(number)))


def test_a_recording_keeps_the_type_that_it_began_with(host_node, peer, tmp_path):
    recorder = host_node(BagRecorder, output=tmp_path / "bag", topics=f"[{BLOCK}]")
    clash = Clash(peer, "tbm: recorder")

    def until(condition):
        recorder.wait_for(condition)

    with Rig(Goals, BLOCK, qos.BLOCK, "planner"):
        until(lambda: f"{BLOCK}: type nav_msgs/msg/Goals of planner, none of ROS" in peer.text("tbm: recorder"))
        assert clash.level == ERROR
    with Rig(Imu, BLOCK, qos.BLOCK) as imu:  # without a message it begins no recording
        until(lambda: imu.matched)
    with Rig(PointCloud2, BLOCK, qos.BLOCK) as first:
        until(lambda: first.matched)
        first.publish(block(1))
        until(lambda: peer.value("tbm: recorder", "messages") == "1")
        with Rig(Imu, BLOCK, qos.BLOCK, "other") as other:
            until(
                lambda: (
                    "sensor_msgs/msg/Imu of other, recorded as sensor_msgs/msg/PointCloud2"
                    in peer.text("tbm: recorder")
                )
            )
            first.close()
            other.publish(Imu())
    with Rig(PointCloud2, BLOCK, qos.BLOCK) as back:
        until(lambda: back.matched)
        back.publish(block(2))
        until(lambda: peer.value("tbm: recorder", "messages") == "2")
    until(lambda: peer.diagnostics["tbm: recorder"].level == OK)
    recorder.close()
    (topic,) = Bag(tmp_path / "bag").info().topics
    assert topic.type == "sensor_msgs/msg/PointCloud2"


def test_a_view_shows_the_type_that_is_published(host_node, peer):
    pytest.importorskip("foxglove")
    view = host_node(LiveView, port=0, blocks=True)
    status = "tbm: live view"
    with Rig(Vector3Stamped, "/diagnostics", qos.DIAGNOSTICS, "stray"):  # it publishes there itself, another type
        view.wait_for(lambda: "/diagnostics: type geometry_msgs/msg/Vector3Stamped of stray" in peer.text(status))
        assert peer.diagnostics[status].level == ERROR
    for kind in (JointState, PointCloud2, JointState):
        with Rig(kind, "/tbm/model/drives", qos.LIVE) as rig:
            view.wait_for(lambda rig=rig: rig.matched)
    view.wait_for(lambda: peer.diagnostics[status].level == OK)
