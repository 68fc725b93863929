"""Node `bag_recorder`: records topics into a rosbag2 folder that survives a kill."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from rclpy.subscription import Subscription

from tbm_msgs_py import topics
from tbm_msgs_py.bags import BagWriter, RecordingError
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.managed import ManagedNode, Parameter, run_node
from tbm_msgs_py.topics import Quality

DISCOVERY = 0.2  # s between looks for topics that are not there yet
DEPTH = 1000  # messages that may wait while the disk is slow

PARAMETERS = (
    Parameter("output", "", "new rosbag2 folder"),
    Parameter("topics", [""], "topics recorded, relative to the namespace or absolute; at least one"),
    Parameter("flush_period", 0.5, "longest time a message stays unwritten, s", 0.05, 0.5),
    Parameter("compression", "none", "compression of the chunks", choices=("none", "zstd")),
)


class BagRecorder(ManagedNode):
    """Records raw messages on the node's clock, from the moment a topic has a publisher."""

    def __init__(self) -> None:
        super().__init__("bag_recorder", PARAMETERS)
        self._writer: BagWriter | None = None
        self._subscribed: dict[str, Subscription] = {}
        self._timers_made: list[Any] = []

    def configure(self) -> None:
        """Create the recording."""
        self._wanted = [topics.absolute(name, self.get_namespace()) for name in self.value("topics")]
        if not self._wanted:
            raise RecordingError("parameter topics: empty, allowed: at least one topic")
        if not self.value("output"):
            raise RecordingError("parameter output: empty, allowed: a new folder")
        writer = BagWriter(self.value("output"), self.value("compression"))
        writer.open()
        self._writer = writer

    def activate(self) -> None:
        """Record: subscribe to what is there, look for the rest, write out what waits."""
        self._discover()
        self._timers_made = [
            self.create_timer(DISCOVERY, self._discover),
            self.create_timer(self.value("flush_period"), self._flush),
        ]

    def deactivate(self) -> None:
        """Stop recording."""
        for timer in self._timers_made:
            self.destroy_timer(timer)
        for subscription in self._subscribed.values():
            self.destroy_subscription(subscription)
        self._timers_made, self._subscribed = [], {}

    def cleanup(self) -> None:
        """Finish the recording: index and metadata."""
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()

    def _discover(self) -> None:
        known = dict(self.get_topic_names_and_types())
        for name in self._wanted:
            publishers = self.get_publishers_info_by_topic(name) if name not in self._subscribed else []
            if publishers and name in known:
                self._subscribe(name, known[name][0], publishers)

    def _subscribe(self, name: str, message_type: str, publishers: list[Any]) -> None:
        message_class = messages.message_class(message_type)
        if message_class is None:
            self.get_logger().error(f"{name}: type {message_type} is not installed, the topic is not recorded")
            self._wanted.remove(name)
            return
        offered = qos.offered(publishers)
        profile = qos.profile(Quality(offered.reliable, offered.latched, DEPTH))
        callback = self._recorder(name, message_type, offered)
        self._subscribed[name] = self.create_subscription(message_class, name, callback, profile, raw=True)

    def _recorder(self, name: str, message_type: str, offered: Quality) -> Callable[[bytes], None]:
        def record(data: bytes) -> None:
            if self._writer is not None:
                now = self.get_clock().now().nanoseconds
                self._writer.write(name, message_type, now, data, quality=offered)

        return record

    def _flush(self) -> None:
        if self._writer is not None:
            self._writer.flush()


def main(args: list[str] | None = None) -> int:
    """Entry point of the executable."""
    return run_node(BagRecorder, args)


if __name__ == "__main__":
    sys.exit(main())
