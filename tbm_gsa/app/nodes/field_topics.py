"""Subscriptions to field topics as they are: message type and reliability are those that the publishers offer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np

from tbm_gsa.app.nodes.frame_choice import FrameChoice
from tbm_gsa.app.nodes.stream_health import StreamHealth
from tbm_msgs_py import topics
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.texts import listed
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.following import TopicFollower
from tbm_msgs_py.nodes.managed import ManagedNode
from tbm_msgs_py.recordings.mapping import SensorMapping
from tbm_msgs_py.recordings.marks import UNMEASURED, UNMEASURED_TEXT
from tbm_msgs_py.topics import QoS, TopicContract

if TYPE_CHECKING:
    from geometry_msgs.msg import AccelStamped, Vector3, Vector3Stamped
    from rclpy.subscription import Subscription
    from sensor_msgs.msg import Imu, PointCloud2

    _Sample: TypeAlias = AccelStamped | Vector3Stamped | Imu

LOOK_S = 0.2  # between looks at who publishes
BESIDE_S = 1.0  # between looks at what else is published
_BLOCK = "sensor_msgs/msg/PointCloud2"
_SAMPLE: dict[str, Callable[[Any], Vector3]] = {
    "geometry_msgs/msg/AccelStamped": lambda message: message.accel.linear,
    "geometry_msgs/msg/Vector3Stamped": lambda message: message.vector,
    "sensor_msgs/msg/Imu": lambda message: message.linear_acceleration,
}

OnSamples = Callable[[SensorMapping, int, np.ndarray, np.ndarray], None]


class Receiver(Protocol):
    """What the samples are for: a comparison, say."""

    points: tuple[str, ...]
    health: StreamHealth

    def restart(self, point: str) -> None:
        """Begin a test point anew: its signal comes from elsewhere now."""


class FieldTopics:
    """Subscribes to every field topic.

    Topics of the contract are subscribed to at once, as the contract has them; any topic follows what its publishers
    offer, be they there before the node or after it. Of a point that is published as blocks and as single samples only
    the blocks are used, as of a recording.

    Parameters
    ----------
    node : ManagedNode
    sensors : mapping of str to SensorMapping
        By topic.
    receiver : Receiver
        Restarts at a test point whose single samples are no longer used; its health gets the faults of topics.
    on_samples : callable
        Called with the sensor, the stamp (ns), offsets (n,) in s and values (n, 3) while the node is active.
    keep : callable
        Called with the topic, its offer and every message while the node is active.
    """

    def __init__(
        self,
        node: ManagedNode[Any],
        sensors: Mapping[str, SensorMapping],
        receiver: Receiver,
        on_samples: OnSamples,
        keep: Callable[[str, TopicContract, Any], None],
    ) -> None:
        self._node, self._sensors, self._receiver = node, dict(sensors), receiver
        self._health = receiver.health
        self._points = {sensor.point for sensor in self._sensors.values()}
        self._frames = {name: FrameChoice(sensor.frame_id) for name, sensor in self._sensors.items()}
        self._on_samples, self._keep = on_samples, keep
        self._follower = TopicFollower(node, self)
        for name in self._sensors:
            self._follower.follow(name, _contract_offer(name, node.get_namespace()))
        self._look()
        # Who publishes does not depend on the clock, which may stand.
        node.create_steady_timer(LOOK_S, self._look)
        self._beside: set[str] = set()
        node.create_steady_timer(BESIDE_S, self._look_beside)

    def close(self) -> None:
        """Release the subscriptions made since the node was configured."""
        self._follower.close()

    def _look(self) -> None:
        offers = {name: self._offer(name) for name in self._sensors}
        in_blocks = {self._sensors[name].point for name, offer in offers.items() if offer and offer.type == _BLOCK}
        for name, offer in offers.items():
            point = self._sensors[name].point
            self._health.note(point, f"frames of {name}", self._frames[name].problem())
            if offer and offer.type != _BLOCK and point in in_blocks:
                self._leave(name, point)
            else:
                self._follower.follow(name, offer)

    def _look_beside(self) -> None:
        """Report field topics that nothing follows: of a test point that is none of the machine's, or not mapped."""
        namespace, found = self._node.get_namespace(), dict[str, str]()
        followed = {topics.absolute(name, namespace) for name in self._sensors}
        for name, _ in self._node.get_topic_names_and_types():
            if name not in followed and _contract_offer(name, namespace) and self._node.count_publishers(name):
                point, points = name.split("/")[-2], self._receiver.points
                there = f"allowed: {listed(points)}"
                why = "not in the mapping" if point in points else f"{point} is no test point of the machine, {there}"
                found[name] = f"{name}: {why}; not compared"
        for name in self._beside ^ found.keys():
            self._node.faults.update(name, found.get(name, ""))
        self._beside = set(found)

    def _offer(self, name: str) -> TopicContract | None:
        publishers = self._node.get_publishers_info_by_topic(name)
        if publishers:
            self._health.set_publishers(self._sensors[name].point, name, [known.node_name for known in publishers])
        return self._follower.offer(name, publishers)

    def _leave(self, name: str, point: str) -> None:
        if name in self._follower:
            self._follower.release(name)
            self._receiver.restart(point)
        self.report(name, "")

    def refuses(self, topic: str, kind: str) -> str:  # noqa: ARG002
        """List the allowed types if this is none of them."""
        return "" if kind == _BLOCK or kind in _SAMPLE else f"allowed: {', '.join([_BLOCK, *_SAMPLE])}"

    def requests(self, topic: str, offered: TopicContract) -> QoS:  # noqa: ARG002
        """As reliable as the publishers; what a late sensor sent before is of no use."""
        quality = topics.BLOCK_QOS if offered.type == _BLOCK else topics.LIVE_QOS
        return QoS(offered.quality.reliable, latched=False, depth=quality.depth)

    def subscribe(self, topic: str, offer: TopicContract) -> Subscription:
        """Subscribe to blocks or single samples."""
        block = offer.type == _BLOCK
        take = partial(self._block, topic) if block else partial(self._sample, _SAMPLE[offer.type], topic)

        def callback(message: Any) -> None:
            if self._node.active:
                self._keep(topic, offer, message)
                take(message)

        kind = messages.message_class(offer.type)
        return self._node.create_subscription(kind, topic, callback, qos.profile(offer.quality))

    def report(self, topic: str, problem: str) -> None:
        """Report a fault of a topic of a point on `/diagnostics`, or its end."""
        point = self._sensors[topic].point
        if problem:
            self._health.fail(point, topic, problem)
        else:
            self._health.settle(point, topic)

    def _unusable(self, topic: str, message: PointCloud2 | _Sample) -> bool:
        """Whether the frame is that of another test point or sensor."""
        sensor = self._sensors[topic]
        frame = message.header.frame_id
        foreign = frame != sensor.point and frame in self._points
        if foreign:
            self._health.refuse(sensor.point, "field", f"frame_id {frame}, allowed: {sensor.point} or the sensor's own")
        return foreign or not self._frames[topic].takes(frame)

    def _block(self, topic: str, message: PointCloud2) -> None:
        if self._unusable(topic, message):
            return
        sensor = self._sensors[topic]
        try:
            block = messages.acceleration_block(message)
        except InputError as error:
            self._health.refuse(sensor.point, "field", str(error))
        else:
            self._on_samples(sensor, block.stamp_ns, block.offsets, block.values)

    def _sample(self, linear: Callable[[Any], Vector3], topic: str, message: _Sample) -> None:
        if self._unusable(topic, message):
            return
        sensor, vector = self._sensors[topic], linear(message)
        if getattr(message, "linear_acceleration_covariance", [0.0])[0] == UNMEASURED:
            self._health.refuse(sensor.point, "field", UNMEASURED_TEXT)
            return
        try:
            stamp = messages.stamp_to_ns(message.header.stamp)
        except InputError as error:
            self._health.refuse(sensor.point, "field", str(error))
            return
        self._on_samples(sensor, stamp, np.zeros(1), np.array([[vector.x, vector.y, vector.z]]))


def _contract_offer(topic: str, namespace: str) -> TopicContract | None:
    """TopicContract that the contract makes of a field topic; None for any other topic."""
    name = topics.absolute(topic, namespace)
    known = name.startswith(topics.absolute("field/", namespace)) and name.endswith(("/block", "/accel"))
    return topics.contract(name, namespace) if known else None
