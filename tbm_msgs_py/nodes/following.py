"""Subscriptions to topics of others, of the type and the quality of service that their publishers offer now."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Protocol

from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from tbm_msgs_py.nodes import qos
from tbm_msgs_py.topics import QoS, TopicContract

if TYPE_CHECKING:
    from tbm_msgs_py.nodes.managed import ManagedNode


class Reader(Protocol):
    """What a node does with the topics that it follows."""

    def refuses(self, topic: str, kind: str) -> str:
        """Reason why messages of this type cannot be used; empty if they can."""

    def requests(self, topic: str, offered: TopicContract) -> QoS:
        """Quality of service to request of publishers that all offer this."""

    def subscribe(self, topic: str, offer: TopicContract) -> Subscription:
        """Create the subscription."""

    def report(self, topic: str, problem: str) -> None:
        """Report what is wrong with a topic now; empty if nothing is."""


class TopicFollower:
    """Keeps one subscription a topic.

    Where publishers disagree about the type, the one in use stays, and the others are a problem of the topic until
    they are gone. The type changes when the one in use is published no more.

    Parameters
    ----------
    node : ManagedNode
    reader : Reader
    """

    def __init__(self, node: ManagedNode[Any], reader: Reader) -> None:
        self._node, self._reader = node, reader
        self._followed: dict[str, TopicContract] = {}
        self._subscriptions: dict[str, Subscription] = {}
        self._others: dict[str, str] = {}  # what is wrong with publishers whose type is not in use

    def __contains__(self, topic: str) -> bool:
        return topic in self._subscriptions

    def __len__(self) -> int:
        return len(self._subscriptions)

    def look(self, topic: str) -> None:
        """Follow what the publishers of a topic offer now."""
        self.follow(topic, self.offer(topic, self._node.get_publishers_info_by_topic(topic)))

    def offer(self, topic: str, found: Iterable[TopicEndpointInfo]) -> TopicContract | None:
        """Type and quality of service to use of the publishers found; None where none can be used."""
        publishers: dict[str, list[TopicEndpointInfo]] = {}
        for known in found:
            publishers.setdefault(known.topic_type, []).append(known)
        kind = self._choose(topic, publishers)
        self._others[topic] = "; ".join(
            f"{topic}: type {other} of {_names(publishers[other])}, {self._why_not(topic, other, kind)}; not used"
            for other in sorted(publishers)
            if other != kind
        )
        if kind is None:
            return None
        return TopicContract(kind, self._reader.requests(topic, TopicContract(kind, qos.offered(publishers[kind]))))

    def _choose(self, topic: str, publishers: Iterable[str]) -> str | None:
        followed = self._followed.get(topic)
        if followed and followed.type in publishers:
            return followed.type
        return next((kind for kind in sorted(publishers) if not self._reader.refuses(topic, kind)), None)

    def _why_not(self, topic: str, kind: str, used: str | None) -> str:
        return self._reader.refuses(topic, kind) or f"allowed: {used}, which is in use"

    def follow(self, topic: str, offer: TopicContract | None) -> None:
        """Subscribe to what is offered, if that is something else; what was subscribed to stays where nothing is."""
        problems = [self._others.get(topic, "")]
        if offer is not None and not self._release_other(topic, offer):
            problems.append(self._subscribe(topic, offer))
        self._reader.report(topic, "; ".join(filter(None, problems)))

    def _release_other(self, topic: str, offer: TopicContract) -> bool:
        """Release a subscription to something else; True if nothing may take its place yet, or need do so.

        The executor holds what is released a little longer, and the middleware the topic with its type: a subscription
        of another type is made at a later look.
        """
        before, held = self._followed.get(topic), self._subscriptions.get(topic)
        if held is None or before == offer:
            return held is not None
        self.release(topic)
        self._followed[topic] = offer
        return before is not None and before.type != offer.type

    def _subscribe(self, topic: str, offer: TopicContract) -> str:
        """Subscribe; what went wrong, if anything. The next look tries again."""
        self._followed[topic] = offer
        try:
            self._subscriptions[topic] = self._reader.subscribe(topic, offer)
        except Exception as error:  # noqa: BLE001 - rclpy's and the middleware's own, of whatever kind
            return f"{topic}: type {offer.type}: {' '.join(str(error).split())}; not subscribed to"
        return ""

    def release(self, topic: str) -> None:
        """Follow a topic no more."""
        self._followed.pop(topic, None)
        if topic in self._subscriptions:
            self._node.destroy_subscription(self._subscriptions.pop(topic))

    def close(self) -> None:
        """Follow nothing any more."""
        for topic in list(self._subscriptions):
            self.release(topic)


def _names(publishers: Iterable[TopicEndpointInfo]) -> str:
    return ", ".join(sorted({known.node_name for known in publishers}))
