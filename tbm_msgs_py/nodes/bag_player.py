"""Node `bag_player`: publishes a recording as it was recorded, with its clock."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.publisher import Publisher
from rclpy.timer import Timer
from rclpy.validate_full_topic_name import validate_full_topic_name

from tbm_msgs_py import topics
from tbm_msgs_py.bags.bag import Bag
from tbm_msgs_py.bags.batch import RawMessage, Topic
from tbm_msgs_py.bags.qos import offered_qos
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.texts import listed, quoted
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.managed import ManagedNode
from tbm_msgs_py.nodes.settings import PlayerSettings

TICK = 0.005  # s of wall time: messages are at most this late, /clock comes at 200 Hz
LATE = 1.0  # s of wall time after its own that a message counts as late
DELIVERY = 2.0  # s that subscribers get to acknowledge the last messages


class BagPlayer(ManagedNode[PlayerSettings]):
    """Plays a recording by its log times.

    While it waits for subscribers the clock stands at the first message, so that nodes on simulated time can start.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("bag_player", PlayerSettings, **options)
        self._played: dict[tuple[str, str], Publisher] = {}  # by topic and type
        self._latched: set[str] = set()
        self._left_out: dict[str, int] = {}  # recorded messages by topic
        self._next: RawMessage | None = None
        self._newest_ns = 0  # log time of what was published
        self._clock_publisher: Publisher | None = None
        self._timer: Timer | None = None

    def configure(self) -> None:
        """Open the recording and create a publisher for each topic."""
        if not self.settings.bag:
            raise RecordingError("parameter bag: empty, allowed: a rosbag2 folder or a .mcap file")
        self._bag = Bag(self.settings.bag)
        self._info = info = self._bag.info()
        if info.messages == 0:
            raise self._bag.nothing_read()
        self._noted: list[str] = []
        self._tell_notes()
        self._start_ns = info.start_ns + round(self.settings.start * NANOSECONDS)
        length = round(self.settings.duration * NANOSECONDS)
        self._end_ns = min(info.end_ns, self._start_ns + length) if length else info.end_ns
        if self._start_ns > self._end_ns:
            raise RecordingError(f"parameter start: {self.settings.start} s, allowed: below {info.duration:.3f} s")
        self._create_publishers(info.topics)
        if self.settings.clock:
            self._clock_publisher = self.contract_publisher(topics.CLOCK)

    def activate(self) -> None:
        """Begin to wait for subscribers, then play."""
        self._before_start = self._latched_before_start()
        self._loops = self._lost_before = 0
        self._rewind()
        self._waiting_until = time.monotonic() + self.settings.wait_timeout
        self._playing, self._now_ns, self._ticked = False, self._start_ns, 0
        self._count = self._late = 0
        # The wall timer must not follow the clock that this node publishes.
        self._timer = self.create_timer(TICK, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def deactivate(self) -> None:
        """Stop playing; the next activation starts from the beginning."""
        self._stop()
        self.write_summary(
            played=self._count,
            lost=self.lost,
            late=self._late,
            left_out=self._left_out,
            loops=self._loops,
            ended=self._next is None,
        )

    def _stop(self) -> None:
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None

    def cleanup(self) -> None:
        """Forget the publishers."""
        self._played, self._clock_publisher = {}, None
        self._latched.clear()
        self._left_out = {}

    @property
    def lost(self) -> int:
        """Messages of the recording that could not be read, in any round."""
        return max(self._lost_before, self._bag.lost)

    def statuses(self) -> list[DiagnosticStatus]:
        """Position, and what of the recording is lost or came late."""
        values = {
            "position": (min(self._now_ns, self._end_ns) - self._info.start_ns) * 1e-9,
            "length": self._info.duration,
            "rate": self.settings.rate,
            "played": self._count,
            "lost": self.lost,
            "late": self._late,
            "left out": sum(self._left_out.values()),
            "loops": self._loops,
        }
        wrong = [f"{count} messages {what}" for count, what in ((self.lost, "lost"), (self._late, "late")) if count]
        level: messages.Level = "warn" if wrong else "ok"
        text = "; ".join([self._doing(), *wrong])
        return [self.status("player", level, text, values, str(self._bag.path))]

    def _doing(self) -> str:
        if not self._playing:
            return "waiting for subscribers"
        if self._next is None:
            return "ended"
        return "paused" if self.settings.paused else "playing"

    def _create_publishers(self, recorded: dict[Topic, int]) -> None:
        chosen = self.settings.topics or {topic.name for topic in recorded}
        names, reasons = {topic.name for topic in recorded}, list[str]()
        if missing := sorted(set(chosen) - names):
            raise RecordingError(f"parameter topics: {missing[0]}, allowed: {listed(sorted(names))}")
        for topic in sorted(recorded, key=recorded.__getitem__, reverse=True):
            if topic.name not in chosen or (topic.name == topics.CLOCK and self.settings.clock):
                continue
            if why := self._create_publisher(topic):
                self._left_out[topic.name] = self._left_out.get(topic.name, 0) + recorded[topic]
                self.get_logger().warning(f"{topic.name}: {why}; not played, {recorded[topic]} messages left out")
                reasons.append(f"{topic.name}: {why}")
        if not self._played:
            raise RecordingError(
                f"{self._bag.path}: no topic can be played: {listed(reasons, separator='; ')}, "
                "allowed: CDR of an installed type under a name of ROS"
            )

    def _create_publisher(self, topic: Topic) -> str:
        """Create the publisher of a topic; why there is none, if there is none."""
        if (topic.name, topic.type) in self._played and topic.encoding == "cdr":
            return ""
        message_type = messages.message_class(topic.type)
        if why := self._obstacle(topic, message_type):
            return why
        stated = offered_qos(topic.qos)
        if topic.qos.strip(" []\n") and stated is None:
            self.get_logger().warning(
                f"{topic.name}: the quality of service recorded is none of ROS; the usual is offered"
            )
        quality = stated or topics.contract(topic.name).quality
        try:
            made = self.create_publisher(message_type, topic.name, qos.replayed(topic.name, quality))
        except Exception as error:  # noqa: BLE001 - rclpy's own: a topic it has as another type
            return " ".join(str(error).split())
        self._played[topic.name, topic.type] = made
        if quality.latched:
            self._latched.add(topic.name)
        return ""

    def _obstacle(self, topic: Topic, message_type: type | None) -> str:
        """Why a topic cannot be played, empty when it can."""
        if topic.encoding != "cdr":
            return f"message encoding {quoted(topic.encoding)}, where ROS 2 has cdr"
        if other := next((kind for name, kind in self._played if name == topic.name), ""):
            return f"recorded as {topic.type}, too, most of it as {other}"
        try:
            validate_full_topic_name(topic.name)  # what is none would be completed, and come under another name
        except InvalidTopicNameException as error:
            return " ".join(str(error).split())
        return "" if message_type else f"type {topic.type} is not installed"

    def _tick(self) -> None:
        try:
            self._go_on()
        except (RecordingError, OSError) as error:
            self.get_logger().error(f"{self._bag.path}: {error}; playing ends")
            self._stop()
            self.end(2)

    def _go_on(self) -> None:
        if not self._playing and not self._ready():
            self._publish_clock(self._start_ns)
            return
        if not self._playing:
            self._begin()
        before, self._ticked = self._ticked, time.monotonic_ns()
        if not self.settings.paused:
            self._now_ns += round((self._ticked - before) * self.settings.rate)
        now = min(self._now_ns, self._end_ns)
        self._publish_until(now)
        self._publish_clock(now)
        if self._next is None:
            self._finished()

    def _begin(self) -> None:
        for message in self._before_start:
            self._publish(message)
        self._now_ns, self._ticked = self._start_ns, time.monotonic_ns()
        self._playing = True

    def _ready(self) -> bool:
        wanted = self.settings.wait_for_subscribers
        matched = sum(publisher.get_subscription_count() for publisher in self._played.values())
        if matched < wanted and time.monotonic() < self._waiting_until:
            return False
        if matched < wanted:
            self.get_logger().warning(f"playing with {matched} of {wanted} subscriptions after the longest wait")
        return True

    def _publish_until(self, now_ns: int) -> None:
        while self._next is not None and self._next.log_ns <= now_ns:
            after = self._now_ns - self._next.log_ns
            # Behind its time, or by a wrong index behind a message that comes after it.
            if after > LATE * NANOSECONDS * self.settings.rate or self._next.log_ns < self._newest_ns:
                self._late += 1
            self._newest_ns = max(self._newest_ns, self._next.log_ns)
            self._publish(self._next)
            self._advance()

    def _publish(self, message: RawMessage) -> None:
        self._played[message.topic.name, message.topic.type].publish(message.data)
        self._count += 1

    def _publish_clock(self, now_ns: int) -> None:
        if self._clock_publisher is not None:
            self._clock_publisher.publish(messages.clock(now_ns))

    def _tell_notes(self) -> None:
        """Say once each what was found in the recording so far."""
        for note in self._bag.notes:
            if note not in self._noted:
                self._noted.append(note)
                self.get_logger().warning(f"{self._bag.path}: {note}")

    def _finished(self) -> None:
        self._tell_notes()
        if not self._count and self.lost:
            raise self._bag.nothing_read()
        if self.settings.loop:
            self._loops += 1
            self._lost_before = self.lost
            self._rewind()
            self._begin()
            return
        for publisher in self._played.values():
            publisher.wait_for_all_acked(Duration(seconds=DELIVERY / len(self._played)))
        wrong = "".join(f", {count} {what}" for count, what in ((self.lost, "lost"), (self._late, "late")) if count)
        self.get_logger().info(f"end of {self._bag.path}: {self._count} messages played{wrong}")
        self._stop()
        self.publish_statuses()
        if self.settings.exit_at_end:
            self.end()

    def _rewind(self) -> None:
        self._newest_ns = 0
        self._recorded = self._messages({name for name, _ in self._played}, self._start_ns)
        self._advance()

    def _messages(self, names: set[str], start_ns: int = 0) -> Iterator[RawMessage]:
        recorded = self._bag.messages(names, start_ns)
        return (
            message
            for message in recorded
            if (message.topic.name, message.topic.type) in self._played and message.topic.encoding == "cdr"
        )

    def _latched_before_start(self) -> list[RawMessage]:
        """Last message of each latched topic before the start: it still holds there, as the operating point does."""
        found: dict[str, RawMessage] = {}
        if self._latched and self.settings.start:
            for message in self._messages(self._latched):
                if message.log_ns >= self._start_ns:
                    break
                found[message.topic.name] = message
        return list(found.values())

    def _advance(self) -> None:
        following = next(self._recorded, None)
        self._next = following if following is not None and following.log_ns <= self._end_ns else None
