"""Node `live_view`: shows the machine's topics to Foxglove over a WebSocket, for sites without a bridge."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.subscription import Subscription

from tbm_gsa.app.nodes.settings import LiveViewSettings
from tbm_msgs_py import topics
from tbm_msgs_py.bags.definitions import typestore
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.fault_log import FaultLog
from tbm_msgs_py.nodes.following import TopicFollower
from tbm_msgs_py.nodes.managed import ManagedNode
from tbm_msgs_py.topics import QoS, TopicContract

if TYPE_CHECKING:
    import foxglove

LOOK_S = 0.5  # between looks for topics that are not there yet
REPEAT_S = 0.1  # between looks for clients that have missed a latched message


class _SubscriberListener:
    """Notes which topics clients subscribe to."""

    def __init__(self, asked: SimpleQueue[str]) -> None:
        self._asked = asked

    def on_subscribe(self, client: foxglove.Client, channel: foxglove.ChannelView) -> None:  # noqa: ARG002
        """Queue the topic of a new subscriber; the server calls from a thread of its own."""
        self._asked.put(channel.topic)


class LiveView(ManagedNode[LiveViewSettings]):
    """Passes on raw messages; nothing can be published or changed from there."""

    def __init__(self, **options: Any) -> None:
        super().__init__("live_view", LiveViewSettings, **options)

    def configure(self) -> None:
        """Start the server."""
        try:
            import foxglove  # noqa: PLC0415 - an optional extra
        except ImportError:
            raise InputError("foxglove-sdk is not installed; pip install 'tbm_monitor[live]'") from None
        host, port = self.settings.host, self.settings.port
        self._foxglove = foxglove
        self._sink = foxglove.Context()
        self._channels: dict[str, foxglove.Channel] = {}
        self._kept: dict[str, tuple[bytes, int]] = {}  # last message of every latched topic, and its time
        self._asked: SimpleQueue[str] = SimpleQueue()  # topics of new subscribers; filled by the server's threads
        try:
            self._server = foxglove.start_server(
                name=self.get_namespace(),
                host=host,
                port=port,
                context=self._sink,
                server_listener=_SubscriberListener(self._asked),
            )
        except Exception as error:
            raise InputError(f"{host}:{port}: {error}") from error
        self.get_logger().info(f"Foxglove: open ws://{host}:{self._server.port}")

    def activate(self) -> None:
        """Look for topics, again and again."""
        self._faults: FaultLog[str] = FaultLog(self.get_logger().warning)
        self._topics = TopicFollower(self, self)
        self._look()
        self.create_steady_timer(LOOK_S, self._look)
        self.create_steady_timer(REPEAT_S, self._repeat)

    def deactivate(self) -> None:
        """Listen no more."""
        self._topics.close()
        for channel in self._channels.values():
            channel.close()
        self._channels, self._kept = {}, {}

    def cleanup(self) -> None:
        """Stop the server."""
        self._server.stop()

    def _look(self) -> None:
        there = {name for name, kinds in self.get_topic_names_and_types() if self._shows(name, kinds)}
        for name in there | self._channels.keys():
            self._topics.look(name)

    def _shows(self, name: str, kinds: Iterable[str]) -> bool:
        own = name.startswith(f"{self.get_namespace().rstrip('/')}/") or name == topics.DIAGNOSTICS
        block = name.endswith(("/block", topics.MODEL_MESH_FORCES))
        return own and (self.settings.blocks or not block) and not all(self.refuses(name, kind) for kind in kinds)

    def refuses(self, topic: str, kind: str) -> str:  # noqa: ARG002
        """Refuse a type whose definition is not known here."""
        known = kind in typestore().types and messages.message_class(kind)
        return "" if known else "none of the installed common interfaces of ROS 2 Jazzy"

    def requests(self, topic: str, offered: TopicContract) -> QoS:  # noqa: ARG002
        """Quality of service that every publisher offers."""
        return offered.quality

    def subscribe(self, topic: str, offer: TopicContract) -> Subscription:
        """Show a topic."""
        if before := self._channels.pop(topic, None):
            before.close()
        text, _ = typestore().generate_msgdef(offer.type, ros_version=2)
        schema = self._foxglove.Schema(name=offer.type, encoding="ros2msg", data=text.encode())
        channel = self._foxglove.Channel(topic, schema=schema, message_encoding="cdr", context=self._sink)
        self._channels[topic] = channel
        kind, profile = messages.message_class(offer.type), qos.profile(offer.quality)
        passer = self._passer(topic, channel, offer.quality.latched)
        return self.create_subscription(kind, topic, passer, profile, raw=True)

    def report(self, topic: str, problem: str) -> None:
        """Report what of a topic is not shown."""
        self._faults.update(topic, problem)

    def _passer(self, topic: str, channel: foxglove.Channel, latched: bool) -> Callable[[bytes], None]:
        self._kept.pop(topic, None)

        def pass_on(message: bytes) -> None:
            data, now = bytes(message), self.get_clock().now().nanoseconds
            if latched:
                self._kept[topic] = data, now
            channel.log(data, log_time=now)

        return pass_on

    def _repeat(self) -> None:
        """Send the latched message of a topic again, to all its clients, for those that are later."""
        asked = {self._asked.get() for _ in range(self._asked.qsize())}
        for topic in asked & self._kept.keys():
            data, stamp = self._kept[topic]
            self._channels[topic].log(data, log_time=stamp)

    def statuses(self) -> list[DiagnosticStatus]:
        """Where it listens, and what it cannot show."""
        values = {"port": self._server.port, "topics": len(self._topics)}
        address = f"{self.settings.host}:{self._server.port}"
        problems = self._faults.show().values()
        return [
            self.status("live view", "error" if problems else "ok", "; ".join(["showing", *problems]), values, address)
        ]
