"""Subscriptions to field topics as they are: message type and reliability are those that the publishers offer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from tbm_gsa.nodes.health import StreamHealth
from tbm_msgs_py import topics
from tbm_msgs_py.bags.mapping import SensorMapping
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.managed import ManagedNode
from tbm_msgs_py.topics import Quality

LOOK_S = 0.2  # between looks at who publishes
_BLOCK = "sensor_msgs/msg/PointCloud2"
_SAMPLE: dict[str, Callable[[Any], Any]] = {
    "geometry_msgs/msg/AccelStamped": lambda message: message.accel.linear,
    "geometry_msgs/msg/Vector3Stamped": lambda message: message.vector,
    "sensor_msgs/msg/Imu": lambda message: message.linear_acceleration,
}

OnBlock = Callable[[SensorMapping, Any], None]
OnSamples = Callable[[SensorMapping, int, np.ndarray, np.ndarray], None]


@dataclass(frozen=True)
class _Offer:
    """Message type and reliability of a topic."""

    type: str
    reliable: bool


class FieldTopics:
    """Subscribes to every field topic.

    Topics of the contract are subscribed to at once, as the contract has them; any topic follows what its publishers
    offer, be they there before the node or after it. Of a point that is published as blocks and as single samples only
    the blocks are taken, as from a recording.

    Parameters
    ----------
    node : ManagedNode
    sensors : mapping of str to SensorMapping
        By topic.
    on_block : callable
        Called with the sensor and a block message.
    on_samples : callable
        Called with the sensor, the stamp (ns), offsets (n,) in s and values (n, 3) of single samples.
    health : StreamHealth
        Is told what is wrong with a topic.
    on_left : callable
        Called with a test point whose single samples are no longer taken.
    """

    def __init__(
        self,
        node: ManagedNode,
        sensors: Mapping[str, SensorMapping],
        on_block: OnBlock,
        on_samples: OnSamples,
        health: StreamHealth,
        on_left: Callable[[str], None],
    ) -> None:
        self._node, self._sensors, self._health = node, dict(sensors), health
        self._points = {sensor.point for sensor in self._sensors.values()}
        self._on_block, self._on_samples, self._on_left = on_block, on_samples, on_left
        self._offers: dict[str, _Offer] = {}
        self._subscriptions: dict[str, Any] = {}
        for name in self._sensors:
            contract = _contract_offer(topics.absolute(name, node.get_namespace()), node.get_namespace())
            if contract is not None:
                self._subscribe(name, contract)
        self._look()
        # Who publishes does not depend on the clock, which may stand.
        node.create_steady_timer(LOOK_S, self._look)

    def close(self) -> None:
        """Release the subscriptions made since the node was configured."""
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions = {}

    def _look(self) -> None:
        offered: dict[str, _Offer] = {}
        for name in self._sensors:
            publishers = self._node.get_publishers_info_by_topic(name)
            if not publishers:
                continue
            self._health.publishers(self._sensors[name].point, name, [known.node_name for known in publishers])
            offered[name] = _Offer(publishers[0].topic_type, qos.offered(publishers).reliable)
        in_blocks = {self._sensors[name].point for name, offer in offered.items() if offer.type == _BLOCK}
        for name, offer in offered.items():
            if offer.type != _BLOCK and self._sensors[name].point in in_blocks:
                if name in self._subscriptions:
                    self._leave(name)
                    self._on_left(self._sensors[name].point)
            elif offer != self._offers.get(name):
                self._subscribe(name, offer)

    def _leave(self, name: str) -> None:
        self._offers.pop(name, None)
        if name in self._subscriptions:
            self._node.destroy_subscription(self._subscriptions.pop(name))

    def _subscribe(self, name: str, offer: _Offer) -> None:
        self._leave(name)
        self._offers[name] = offer
        if offer.type != _BLOCK and offer.type not in _SAMPLE:
            allowed = ", ".join([_BLOCK, *_SAMPLE])
            self._health.doubt(
                self._sensors[name].point, name, f"{name}: type {offer.type}, allowed: {allowed}; not compared"
            )
            return
        self._health.settle(self._sensors[name].point, name)
        sensor = self._sensors[name]
        block = offer.type == _BLOCK
        callback = partial(self._block, sensor) if block else partial(self._sample, _SAMPLE[offer.type], sensor)
        depth = (topics.BLOCK_QUALITY if block else topics.LIVE_QUALITY).depth
        profile = qos.profile(Quality(offer.reliable, latched=False, depth=depth))
        kind = messages.message_class(offer.type)
        self._subscriptions[name] = self._node.create_subscription(kind, name, callback, profile)

    def _foreign(self, sensor: SensorMapping, message: Any) -> bool:
        """Whether the frame is that of another test point."""
        frame = message.header.frame_id
        foreign = frame != sensor.point and frame in self._points
        if foreign:
            self._health.refuse(sensor.point, "field", f"frame_id {frame}, allowed: {sensor.point} or the sensor's own")
        return foreign

    def _block(self, sensor: SensorMapping, message: Any) -> None:
        if not self._foreign(sensor, message):
            self._on_block(sensor, message)

    def _sample(self, linear: Callable[[Any], Any], sensor: SensorMapping, message: Any) -> None:
        if self._foreign(sensor, message):
            return
        vector = linear(message)
        stamp = messages.stamp_to_ns(message.header.stamp)
        self._on_samples(sensor, stamp, np.zeros(1), np.array([[vector.x, vector.y, vector.z]]))


def _contract_offer(name: str, namespace: str) -> _Offer | None:
    """Give what the contract says about a field topic; None for any other topic."""
    if not name.startswith(topics.absolute("field/", namespace)):
        return None
    reliable = topics.quality(name, namespace).reliable
    if name.endswith("/block"):
        return _Offer(_BLOCK, reliable)
    return _Offer("geometry_msgs/msg/AccelStamped", reliable) if name.endswith("/accel") else None
