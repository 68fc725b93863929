"""`load_node`: publishes the cutterhead loads in blocks, on the node's clock."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState

from tbm_dynamics import Machine, OperatingPoint, load_machine
from tbm_dynamics.nodes.settings import LoadSettings, OperatingSettings
from tbm_dynamics.streaming.schedule import Schedule, pairs, read_schedule
from tbm_dynamics.streaming.streams import LoadBlock, LoadStream, step_ns
from tbm_msgs_py import blocks, topics
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.units import NANOSECONDS, R_MIN
from tbm_msgs_py.nodes import messages
from tbm_msgs_py.nodes.fault_log import FaultLog
from tbm_msgs_py.nodes.managed import ManagedNode
from tbm_msgs_py.nodes.rate import Rate

# A clock that leaps further than this (a bag that loops, a suspended computer), or than readers have room for, starts
# the stream afresh.
_LONGEST_BACKLOG_S = 5.0
_MOST_BLOCKS = topics.BLOCK_QOS.depth - 8
_MATCHING_S = 0.3  # a publisher knows of a subscriber before that one receives
# A block is late by up to the time between two looks at the clock.
_LOOKS_A_BLOCK = 5

FRAME = "cutterhead"


class LoadNode(ManagedNode[LoadSettings]):
    """Lifecycle node that turns (seed, operating point, time) into load blocks."""

    def __init__(self, **options: Any) -> None:
        super().__init__("load_node", LoadSettings, **options)

    def configure(self) -> None:
        """Load the machine and create the publishers."""
        self._machine: Machine = load_machine(self.settings.machine)
        self._rate: float = self.settings.block_rate
        self._samples: int = self.settings.block_samples
        self._step = step_ns(self._rate)
        self._offsets = np.arange(self._samples) * self._step / NANOSECONDS
        self._stream: LoadStream | None = None
        self._epoch_ns = 0
        self._refused = 0
        self._faults: FaultLog[str] = FaultLog(lambda text: self.get_logger().warning(text))
        self._schedule = self._read_schedule()
        self._wanted: OperatingPoint | None = None  # of the topic or the parameters, since the node was configured
        self._advance = 0.0  # of the topic: passed on, the loads do not depend on it
        self._standstill = False  # of the machine, by the topic: the loads, which need a head that turns, stay
        if given := self._given_point(self.settings.operating_point):
            self._new_stream().set_operating_point(given)
            self._wanted = given
        self._set_live_rate()
        # Compiles and designs the filters now, not when the first block is due.
        self._new_stream().next_block()
        self._create_topics()

    def _create_topics(self) -> None:
        self._blocks = self.contract_publisher(topics.LOADS_BLOCK)
        self._live = self.contract_publisher(topics.LOADS_WRENCH)
        self._applied = self.contract_publisher(topics.LOADS_OPERATING_POINT)
        self.contract_subscription(topics.OPERATING_POINT, self._on_operating_point)

    def _set_live_rate(self) -> None:
        self._live_stride = max(1, round(self._rate / self.settings.live_rate))

    def _given_point(self, given: OperatingSettings) -> OperatingPoint | None:
        """Operating point of the parameters; None while all are zero."""
        if given == OperatingSettings():
            return None
        own = self._machine.operating_point
        return OperatingPoint(
            given.speed * R_MIN or own.speed, given.torque * 1e3 or own.torque, given.thrust * 1e3 or own.thrust
        )

    def check_settings(self, settings: LoadSettings, names: frozenset[str]) -> None:
        """Refuse an operating point that the machine, its rock or a schedule does not allow."""
        if _drive(names):
            wanted = self._given_point(settings.operating_point) or self._machine.operating_point
            self._new_stream().set_operating_point(wanted)

    def settings_changed(self, names: frozenset[str]) -> None:
        """Use another live rate or operating point."""
        self._set_live_rate()
        if _drive(names):
            self._wanted = self._given_point(self.settings.operating_point) or self._machine.operating_point
            if self._stream:
                self._stream.set_operating_point(self._wanted)

    def _read_schedule(self) -> Schedule | None:
        file = self.settings.schedule
        if not file:
            return None
        columns = pairs("schedule_columns", self.settings.schedule_columns)
        return read_schedule(file, columns, pairs("schedule_where", self.settings.schedule_where))

    def _new_stream(self) -> LoadStream:
        seed, loads = self.settings.seed, self.settings.loads
        return LoadStream(self._machine, seed, 1.0 / self._rate, self._samples, loads, self._schedule)

    def activate(self) -> None:
        """Start the stream at the first look at which the clock runs and the subscribers are there."""
        self._stream = None
        self._sent = Rate()
        self._matched_since: float | None = None
        self._timer = self.create_timer(self._samples / self._rate / _LOOKS_A_BLOCK, self._tick)

    def _on_operating_point(self, message: JointState) -> None:
        try:
            _, given = messages.operating_point_from(message)
            wanted = OperatingPoint(given.speed, given.torque, given.thrust)
            self._standstill = given.standstill and self._schedule is None
            if not self._standstill:
                (self._stream or self._new_stream()).set_operating_point(wanted)
        except InputError as error:
            self._refused += 1
            self._faults.report("operating point", f"{topics.OPERATING_POINT}: {error}; the last one stays")
            return
        self._faults.clear("operating point")
        if not self._standstill:
            self._wanted, self._advance = wanted, given.advance

    def _tick(self) -> None:
        now = self.get_clock().now().nanoseconds
        if self._stream is None and not self._begin(now):
            return
        stream = self._stream
        assert stream is not None  # noqa: S101 - _begin made it
        due = (now - self._epoch_ns) // self._step - stream.next_step
        if due < -self._samples or due > min(_LONGEST_BACKLOG_S * self._rate, _MOST_BLOCKS * self._samples):
            self._faults.report("clock", "the clock jumped: the load stream starts afresh")
            self._faults.clear("clock")
            self._stream = None
            return
        while due >= self._samples and self.context.ok():
            self._publish(stream.next_block())
            due -= self._samples

    def _begin(self, now: int) -> bool:
        """Start the stream once the clock runs and enough subscribers are there."""
        if now == 0 or not self._matched():
            return False
        # When this call was due, however late it was: every block is complete at one, and waits for none after it.
        due = now - max(0, self._timer.timer_period_ns - self._timer.time_until_next_call())
        self._epoch_ns = due // self._step * self._step
        self._stream = self._new_stream()
        if self._wanted is not None:
            self._stream.set_operating_point(self._wanted)
        # Stamped before the first block: where the run starts, not what it changes to over that block.
        self._announce(self._epoch_ns - self._samples * self._step, self._stream.operating_point, 0.0)
        return True

    def _matched(self) -> bool:
        """Whether enough subscribers are there, and have been for a moment."""
        wanted = self.settings.wait_for_subscribers
        if self._blocks.get_subscription_count() < wanted:
            self._matched_since = None
            return False
        self._matched_since = self._matched_since or time.monotonic()
        return wanted == 0 or time.monotonic() - self._matched_since >= _MATCHING_S

    def _announce(self, stamp_ns: int, point: OperatingPoint, head_angle: float) -> None:
        self._announced = point, self._advance
        given = OperatingPoint(point.speed, point.torque, point.thrust, head_angle, self._advance)
        self._applied.publish(messages.operating_point_message(stamp_ns, given))

    def _publish(self, block: LoadBlock) -> None:
        stamp = self._epoch_ns + block.first_step * self._step
        self._sent.add(len(block.loads))
        if (block.operating_point, self._advance) != self._announced:
            self._announce(stamp, block.operating_point, block.head_angle)
        self._blocks.publish(messages.block(blocks.LOADS, stamp, self._offsets, block.loads, FRAME))
        first = -block.first_step % self._live_stride
        for i in range(first, len(block.loads), self._live_stride):
            self._live.publish(messages.wrench(stamp + i * self._step, block.loads[i], FRAME))

    def statuses(self) -> list[DiagnosticStatus]:
        """Operating point, progress and what was refused."""
        running = self._stream is not None
        point = self._stream.operating_point if self._stream else self._wanted or self._machine.operating_point
        values = {
            "blocks": self._stream.next_step // self._samples if self._stream else 0,
            "rate_hz": self._rate,
            "measured_rate_hz": self._sent.mean(),
            "refused_operating_points": self._refused,
            "speed_r_min": point.speed / R_MIN,
            "torque_kn_m": point.torque / 1e3,
            "thrust_kn": point.thrust / 1e3,
        }
        problems = list(self._faults.show().values())
        going = "streaming" if running else "waiting for the clock or for subscribers"
        if running and self._standstill:
            going = "streaming as before: the machine stands still"
        if running and self.clock_stands:
            going = "the clock stands"
        level: messages.Level = "ok" if running and not problems else "warn"
        return [self.status("loads", level, "; ".join([going, *problems]), values, self._machine.name)]


def _drive(names: frozenset[str]) -> bool:
    """Whether the operating point is among parameters of these names."""
    return any(name.startswith("operating_point.") for name in names)
