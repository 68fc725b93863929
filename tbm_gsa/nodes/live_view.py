"""Node `live_view`: shows the machine's topics to Foxglove over a WebSocket, for sites without a bridge."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from tbm_gsa.errors import InputError
from tbm_msgs_py import topics
from tbm_msgs_py.bags.samples import typestore
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.managed import ManagedNode, Parameter, run_node

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
        self._subscriptions_made: list[Any] = []
        self._look()
        self.create_steady_timer(LOOK_S, self._look)

    def deactivate(self) -> None:
        """Listen no more."""
        for subscription in self._subscriptions_made:
            self.destroy_subscription(subscription)
        self._channels = {}

    def cleanup(self) -> None:
        """Stop the server."""
        self._server.stop()

    def _look(self) -> None:
        own = f"{self.get_namespace().rstrip('/')}/"
        for name, types in self.get_topic_names_and_types():
            wanted = name.startswith(own) or name == topics.DIAGNOSTICS
            shown = not name.endswith(("/block", topics.MODEL_MESH_FORCES)) or self.value("blocks")
            if name not in self._channels and wanted and shown and types[0] in typestore().types:
                self._show(name, types[0])

    def _show(self, name: str, kind: str) -> None:
        message_class = messages.message_class(kind)
        publishers = self.get_publishers_info_by_topic(name)
        if message_class is None or not publishers:
            return
        text, _ = typestore().generate_msgdef(kind, ros_version=2)
        schema = self._foxglove.Schema(name=kind, encoding="ros2msg", data=text.encode())
        channel = self._foxglove.Channel(name, schema=schema, message_encoding="cdr", context=self._sink)
        self._channels[name] = channel
        made = self.create_subscription(
            message_class, name, self._passer(channel), qos.profile(qos.offered(publishers)), raw=True
        )
        self._subscriptions_made.append(made)

    def _passer(self, channel: Any) -> Callable[[bytes], None]:
        def pass_on(data: bytes) -> None:
            channel.log(bytes(data), log_time=self.get_clock().now().nanoseconds)

        return pass_on

    def statuses(self) -> list[DiagnosticStatus]:
        """Where it listens."""
        values = {"port": self._server.port, "topics": len(self._channels)}
        address = f"{self.value('host')}:{self._server.port}"
        return [self.status("live view", "ok", "showing", values, address)]


def main() -> None:
    """Run the node."""
    sys.exit(run_node(LiveView))


if __name__ == "__main__":
    main()
