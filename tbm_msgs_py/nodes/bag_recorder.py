"""Node `bag_recorder`: records topics into a rosbag2 folder that survives a kill and a full disk."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.event_handler import QoSMessageLostInfo, SubscriptionEventCallbacks
from rclpy.subscription import Subscription

from tbm_msgs_py import topics
from tbm_msgs_py.bags.definitions import typestore
from tbm_msgs_py.bags.quota import enforce, mark
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.texts import doubled
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.fault_log import FaultLog
from tbm_msgs_py.nodes.following import TopicFollower
from tbm_msgs_py.nodes.logs import get_logger
from tbm_msgs_py.nodes.managed import ManagedNode
from tbm_msgs_py.nodes.settings import RecorderSettings
from tbm_msgs_py.topics import QoS, TopicContract

DISCOVERY = 0.05  # s between looks for topics that are not there yet
FOLLOWING = 1.0  # s between looks at what the publishers of the others offer
MOST_HELD = 64_000_000  # bytes that may wait for a simulated clock to begin; later ones are lost, and counted
QUOTA_PERIOD = 2.0  # s between looks at the disk
DEPTH = 1000  # messages that may wait while the disk is slow
MEGABYTE = 1e6


class Arrived(NamedTuple):
    """A message that is not written yet."""

    topic: str
    type: str
    offered: QoS
    data: bytes


class BagRecorder(ManagedNode[RecorderSettings]):
    """Records raw messages on the node's clock, from the moment a topic has a publisher."""

    def __init__(self, **options: Any) -> None:
        super().__init__("bag_recorder", RecorderSettings, **options)
        self._writer: BagWriter | None = None
        self._topics = TopicFollower(self, self)
        self._asked: dict[str, QoS] = {}
        self._types: dict[str, str] = {}  # of the topics that have had a message
        self._unrecorded: FaultLog[str] = FaultLog(lambda text: self.get_logger().error(text))
        self._arrived: list[Arrived] = []
        self._held = 0  # bytes of what has arrived
        self._lost = self._lost_shown = 0
        self._deleted: list[str] = []
        self._over_quota = False
        self._problem = ""

    def configure(self) -> None:
        """Create the recording."""
        self._wanted = [topics.absolute(name, self.get_namespace()) for name in self.settings.topics]
        if not self._wanted:
            raise RecordingError("parameter topics: empty, allowed: at least one topic")
        if twice := doubled(self._wanted):
            raise RecordingError(f"parameter topics: {twice} twice, allowed: each topic once")
        if not self.settings.output:
            raise RecordingError("parameter output: empty, allowed: a new folder")
        writer = BagWriter(
            self.settings.output,
            self.settings.compression,
            max_bytes=self.settings.split_size * MEGABYTE or None,
            max_seconds=self.settings.split_time or None,
            custom_data=mark(self.settings.quota),
        )
        try:
            writer.open()
        except KeyboardInterrupt:  # a signal while nothing is recorded
            writer.discard()
            raise
        self._writer = writer

    def activate(self) -> None:
        """Record: subscribe to what is there, look for the rest, write out what waits."""
        self._discover()
        tasks = [(DISCOVERY, self._discover), (FOLLOWING, self._follow), (self.settings.flush_period, self._flush)]
        if self.settings.quota:
            tasks.append((QUOTA_PERIOD, self._keep_quota))
        if self.settings.duration:
            tasks.append((self.settings.duration, self.end))
        for period, task in tasks:
            self.create_steady_timer(period, task)  # the disk does not wait for a simulated clock

    def deactivate(self) -> None:
        """Stop recording."""
        self._topics.close()
        self._asked = {}

    def cleanup(self) -> None:
        """Finish the recording: index and metadata."""
        self._on_disk(lambda writer: writer.close())
        self._writer, self._types = None, {}
        self.write_summary(lost=self._lost + len(self._arrived), deleted=self._deleted, problem=self._problem)

    def _discover(self) -> None:
        for name in self._wanted:
            if name not in self._topics:
                self._topics.look(name)

    def _follow(self) -> None:
        for name in self._wanted:
            self._topics.look(name)

    def refuses(self, topic: str, kind: str) -> str:
        """Refuse another type than what is recorded of a topic already, and what a reader may not know."""
        recorded = self._types.get(topic, kind)
        if kind != recorded:
            return f"recorded as {recorded}"
        if kind not in typestore().types:
            return "none of ROS 2 Jazzy's common interfaces"
        return "" if messages.message_class(kind) else "not installed"

    def requests(self, topic: str, offered: TopicContract) -> QoS:
        """Quality of service requested before; less where the present publishers offer less."""
        before, now = self._asked.get(topic, offered.quality), offered.quality
        return now if before.reliable > now.reliable or before.latched > now.latched else before

    def subscribe(self, topic: str, offer: TopicContract) -> Subscription:
        """Record a topic."""
        quality = offer.quality
        made = self.create_subscription(
            messages.message_class(offer.type),
            topic,
            self._recorder(topic, offer),
            qos.profile(QoS(quality.reliable, quality.latched, DEPTH)),
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(message_lost=self._on_lost),
        )
        self._asked[topic] = quality
        return made

    def report(self, topic: str, problem: str) -> None:
        """Report what of a topic is not recorded."""
        self._unrecorded.update(topic, problem)

    def _recorder(self, name: str, offer: TopicContract) -> Callable[[bytes], None]:
        def record(data: bytes) -> None:
            if self._held > MOST_HELD:
                self._lost += 1
                return
            self._held += len(data)
            self._types[name] = offer.type
            self._arrived.append(Arrived(name, *offer, data))
            self._on_disk(self._write)

        return record

    def _write(self, writer: BagWriter) -> None:
        """Write what has arrived; it waits for a simulated clock that has not begun."""
        if now := self.get_clock().now().nanoseconds:
            arrived, self._arrived, self._held = self._arrived, [], 0
            for message in arrived:
                writer.write(message.topic, message.type, now, message.data, qos=message.offered)

    def _on_disk(self, work: Callable[[BagWriter], None]) -> None:
        """Do what writes; a disk that refuses ends the recording with what it has."""
        if self._writer is None:
            return
        try:
            work(self._writer)
        except (RecordingError, OSError) as error:
            self._problem = str(error)
            running = self.context.ok()  # else it was the end after a signal, and nothing can be published
            output = self.get_logger() if running else get_logger("tbm_monitor")
            output.error(f"the recording ends with what was written before: {self._problem}")
            if running:
                self.publish_statuses()
            self._writer.salvage()
            self._writer = None
            self.end(2)

    def _flush(self) -> None:
        self._on_disk(self._write)
        self._on_disk(lambda writer: writer.flush())

    def _keep_quota(self) -> None:
        self._on_disk(self._delete_oldest)

    def _delete_oldest(self, writer: BagWriter) -> None:
        quota = self.settings.quota
        deleted, over = enforce(quota * MEGABYTE, writer)
        for file in deleted:
            self._deleted.append(str(file.path))
            self.get_logger().info(f"quota of {quota:g} MB: deleted {file.path} ({file.size / MEGABYTE:.3f} MB)")
        if over > 0 and not self._over_quota:
            self.get_logger().warning(f"over the quota by {over / MEGABYTE:.3f} MB, and no older file may be deleted")
        self._over_quota = over > 0

    def _on_lost(self, event: QoSMessageLostInfo) -> None:
        self._lost += event.total_count_change

    def statuses(self) -> list[DiagnosticStatus]:
        """Messages recorded and lost so far, and what is wrong; of the losses those since the last status."""
        if self._writer is None:
            return []
        lost, self._lost_shown = self._lost - self._lost_shown, self._lost
        refused = self._unrecorded.show()
        missing = [name for name in self._wanted if name not in self._topics and name not in refused]
        errors = [*([self._problem] if self._problem else []), *refused.values()]
        troubles = [
            *errors,
            *([f"waiting for {', '.join(missing)}"] if missing else []),
            *([f"waiting for {topics.CLOCK}, nothing is written before it"] if self._arrived else []),
            *([f"{lost} messages lost on their way"] if lost else []),
            *(["over the quota"] if self._over_quota else []),
        ]
        values = {
            "messages": self._writer.messages,
            "lost": self._lost,
            "file": self._writer.current,
            "deleted": len(self._deleted),
        }
        level: messages.Level = "error" if errors else "warn" if troubles else "ok"
        return [self.status("recorder", level, "; ".join(troubles) or "recording", values, self.settings.output)]
