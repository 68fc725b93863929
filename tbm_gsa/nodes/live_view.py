"""Node `live_view`: shows the machine's topics to Foxglove over a WebSocket, for sites without a bridge."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from tbm_gsa.errors import InputError
from tbm_msgs_py import topics
from tbm_msgs_py.bags.samples import typestore
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.faults import Faults
from tbm_msgs_py.nodes.following import Offer, TopicFollower
from tbm_msgs_py.nodes.managed import ManagedNode, Parameter, run_node
from tbm_msgs_py.topics import Quality

LOOK_S = 0.5  # between looks for topics that are not there yet

PARAMETERS = (
    Parameter("host", "127.0.0.1", "address the server listens at; the default is this computer only"),
    Parameter("port", 8765, "TCP port; 0 for a free one, which the log names", minimum=0, maximum=65535),
    Parameter("blocks", False, "show blocks too: no panel draws them, a recording may want them"),
)


class LiveView(ManagedNode):
    """Passes on raw messages; nothing can be published or changed from there."""

    def __init__(self, **options: Any) -> None:
        super().__init__("live_view", PARAMETERS, **options)

    def configure(self) -> None:
        """Start the server."""
        try:
            import foxglove  # noqa: PLC0415 - an optional extra
        except ImportError:
            raise InputError("foxglove-sdk is not installed; pip install 'tbm_monitor[live]'") from None
        host, port = self.value("host"), self.value("port")
        self._foxglove = foxglove
        self._sink = foxglove.Context()
        self._channels: dict[str, Any] = {}
        try:
            self._server = foxglove.start_server(name=self.get_namespace(), host=host, port=port, context=self._sink)
        except Exception as error:
            raise InputError(f"{host}:{port}: {error}") from error
        self.get_logger().info(f"Foxglove: open ws://{host}:{self._server.port}")

    def activate(self) -> None:
        """Look for topics, again and again."""
        self._faults: Faults[str] = Faults(self.get_logger().warning)
        self._topics = TopicFollower(self, self)
        self._look()
        self.create_steady_timer(LOOK_S, self._look)

    def deactivate(self) -> None:
        """Listen no more."""
        self._topics.close()
        for channel in self._channels.values():
            channel.close()
        self._channels = {}

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
        return own and (self.value("blocks") or not block) and not all(self.refuses(name, kind) for kind in kinds)

    def refuses(self, topic: str, kind: str) -> str:  # noqa: ARG002
        """Say so of a type whose definition Foxglove could not be told."""
        known = kind in typestore().types and messages.message_class(kind)
        return "" if known else "none of the installed common interfaces of ROS 2 Jazzy"

    def asks(self, topic: str, offered: Offer) -> Quality:  # noqa: ARG002
        """Ask as much as every publisher offers."""
        return offered.quality

    def subscribe(self, topic: str, offer: Offer) -> Any:
        """Show a topic."""
        if before := self._channels.pop(topic, None):
            before.close()
        text, _ = typestore().generate_msgdef(offer.type, ros_version=2)
        schema = self._foxglove.Schema(name=offer.type, encoding="ros2msg", data=text.encode())
        channel = self._foxglove.Channel(topic, schema=schema, message_encoding="cdr", context=self._sink)
        self._channels[topic] = channel
        kind, profile = messages.message_class(offer.type), qos.profile(offer.quality)
        return self.create_subscription(kind, topic, self._passer(channel), profile, raw=True)

    def tell(self, topic: str, problem: str) -> None:
        """Take note of what of a topic is not shown."""
        if problem:
            self._faults.report(topic, problem)
        else:
            self._faults.clear(topic)

    def _passer(self, channel: Any) -> Callable[[bytes], None]:
        def pass_on(data: bytes) -> None:
            channel.log(bytes(data), log_time=self.get_clock().now().nanoseconds)

        return pass_on

    def statuses(self) -> list[DiagnosticStatus]:
        """Where it listens, and what it cannot show."""
        values = {"port": self._server.port, "topics": len(self._topics)}
        address = f"{self.value('host')}:{self._server.port}"
        problems = self._faults.show().values()
        return [
            self.status("live view", "error" if problems else "ok", "; ".join(["showing", *problems]), values, address)
        ]


def main() -> None:
    """Run the node."""
    sys.exit(run_node(LiveView))


if __name__ == "__main__":
    main()
