"""Subscriptions that take what every publisher of their topic offers, be it less than the contract asks for."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.topics import BLOCK_QOS, TopicContract

_LEAST_QUEUE = BLOCK_QOS.depth  # a state counts from its stamp on, and there may be one a block
_MOST_UNPAIRED = 64


class MatchingSubscription:
    """A subscription as the contract has it; a second one, volatile and best effort, once a publisher offers less.

    What a publisher offers in full comes through both: each message is handed on once. Messages carry no id that every
    executor of rclpy passes on, so they are told apart by what they hold.

    Parameters
    ----------
    node : Node
    topic : str
    contract : TopicContract
    callback : callable
        Called with each message.
    log : callable
        Called with a line when the second subscription is made.
    overridden : QoSOverridingOptions, optional
        Policies of the first one that parameters may override.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        contract: TopicContract,
        callback: Callable[[Any], None],
        log: Callable[[str], object],
        overridden: QoSOverridingOptions | None = None,
    ) -> None:
        self._node, self._topic, self._callback, self._log = node, topic, callback, log
        self._type, offered = contract
        self._quality = replace(offered, depth=max(offered.depth, _LEAST_QUEUE))
        # Handed on by one subscription, and not yet come through the other.
        self._unpaired: tuple[deque[Any], deque[Any]] = (deque(maxlen=_MOST_UNPAIRED), deque(maxlen=_MOST_UNPAIRED))
        self._second: Subscription | None = None
        events = SubscriptionEventCallbacks(incompatible_qos=self._on_incompatible)
        self.first = node.create_subscription(
            messages.message_class(self._type),
            topic,
            partial(self._receive, 0),
            qos.profile(self._quality),
            event_callbacks=events,
            qos_overriding_options=overridden,
        )

    def _receive(self, which: int, message: Any) -> None:
        if self._second is not None:
            own, other = self._unpaired[which], self._unpaired[1 - which]
            if message in other:
                other.remove(message)
                return
            own.append(message)
        self._callback(message)

    def _on_incompatible(self, _event: QoSRequestedIncompatibleQoSInfo) -> None:
        if self._second is not None:
            return
        least = replace(self._quality, reliable=False, latched=False)
        self._second = self._node.create_subscription(
            messages.message_class(self._type), self._topic, partial(self._receive, 1), qos.profile(least)
        )
        self._log(f"{self._topic}: {self._offers()}; what it sends from now on is used")

    def _offers(self) -> str:
        """Name the publishers that offer less, and what of the contract they do not offer."""
        less = {_name(known): text for known in self._publishers() if (text := self._less(known))}
        return "; ".join(f"{name} is {text}" for name, text in sorted(less.items())) or "a publisher offers less"

    def _less(self, known: TopicEndpointInfo) -> str:
        asked, offered = self.first.qos_profile, known.qos_profile
        texts = []
        if asked.reliability == ReliabilityPolicy.RELIABLE != offered.reliability:
            texts.append("best effort, not reliable")
        if asked.durability == DurabilityPolicy.TRANSIENT_LOCAL != offered.durability:
            texts.append("volatile, not transient local")
        return " and ".join(texts)

    def _publishers(self) -> list[TopicEndpointInfo]:
        return list(self._node.get_publishers_info_by_topic(self._topic))

    def problem(self) -> str:
        """Name the publishers whose messages cannot be used because of their type; empty if there are none."""
        others = {_name(known): known.topic_type for known in self._publishers() if known.topic_type != self._type}
        return "; ".join(
            f"{self._topic}: type {kind} of {name}, allowed: {self._type}; not used"
            for name, kind in sorted(others.items())
        )

    def close(self) -> None:
        """Release the second subscription; the first is the node's."""
        if self._second is not None:
            self._node.destroy_subscription(self._second)
            self._second = None


def _name(known: TopicEndpointInfo) -> str:
    """Node of a publisher; it may be told a moment after the publisher."""
    return "a publisher" if known.node_name.startswith("_NODE_NAME_UNKNOWN") else str(known.node_name)
