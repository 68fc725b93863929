"""One test point while its two signals arrive: ordering, conditioning and sums per window, no samples kept."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from tbm_dynamics.streaming.continuity import Continuity, StreamBlock
from tbm_gsa.comparison.pace import Pace
from tbm_gsa.signals.clock import GAP_PERIODS, sampling_rate
from tbm_gsa.signals.conditioning import HIGH_PASS_HZ, Band, CausalConditioner, common_band
from tbm_gsa.signals.statistics import coverage, kurtosis, rms
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.units import NANOSECONDS

Source = Literal["model", "field"]
SOURCES: tuple[Source, Source] = ("model", "field")

BATCH_NS = 200_000_000  # samples are worked off in batches; the first one gives the rate and the mean to start from
LEAST_BATCH = 8  # samples
SLACK_NS = 30_000_000  # stamps jitter, and single samples are lost: so near, they are the signal's
# A jump of the clock is believed after a window without a sample where the signal had got to, or after so long.
MOST_JUMP_NS = 2_000_000_000
SETTLE_NS = round(NANOSECONDS / HIGH_PASS_HZ)  # one period of the high-pass


@dataclass
class StreamCounters:
    """What happened to one signal of one point since the beginning."""

    rejected: int = 0  # samples that were not finite
    late: int = 0  # samples not newer than the ones before, of a window already closed, or beside the signal
    gaps: int = 0  # stretches without samples that were longer than a window
    restarts: int = 0  # jumps back of the stamps, by more than a window
    rate_changes: int = 0  # of the rate that stamps declare, while they run on
    declared_hz: float = 0.0  # the rate since then
    came_hz: float = 0.0  # samples a second in the last stretch as long as a window
    block_gaps: int = 0  # in it, if they follow most blocks: another rate comes than is declared


@dataclass
class WindowSum:
    """Sums of one signal over one window."""

    count: int = 0
    rate_hz: float = 0.0  # of the samples; zero before there are any
    moments: Array = field(default_factory=lambda: np.zeros((4, 3)))  # of powers 1 to 4, (m/s²)^k; NaN without a band
    largest: Array = field(default_factory=lambda: np.zeros(3))  # magnitude, m/s²; NaN likewise
    settling: bool = False

    def add(self, values: Array) -> None:
        """Take conditioned samples, (n, 3), along the compared axes."""
        squares = np.square(values)
        self.count += len(values)
        self.moments += [part.sum(axis=0) for part in (values, squares, squares * values, np.square(squares))]
        self.largest = np.maximum(self.largest, np.abs(values).max(axis=0))

    def rms(self) -> Array:
        """Root mean square, (3,), m/s²."""
        return rms(self.count, self.moments)

    def peak(self) -> Array:
        """Largest magnitude, (3,), m/s²."""
        return self.largest if self.count else np.full(3, np.nan)

    def kurtosis(self) -> Array:
        """Kurtosis, (3,)."""
        return kurtosis(self.count, self.moments)

    def coverage(self, window_ns: int) -> float:
        """Share of the window that arrived."""
        return coverage(self.count, self.rate_hz, window_ns / NANOSECONDS) if self.rate_hz else 0.0


@dataclass(frozen=True, eq=False)
class ClosedWindow:
    """A window that nothing will be added to; it starts at index times its length."""

    index: int
    sums: Mapping[Source, WindowSum]


class PointStreams:
    """Both signals of one test point.

    Parameters
    ----------
    window_ns : int
        Length of a window.
    counters : mapping of Source to StreamCounters
        Where to count; they outlive a restart.
    rotating : bool
        The sensor turns with the head: y and z both become √(y² + z²), as `compared_axes` says.
    """

    def __init__(self, window_ns: int, counters: Mapping[Source, StreamCounters], rotating: bool) -> None:
        self._window_ns = window_ns
        self._streams: dict[Source, _Stream] = {
            source: _Stream(window_ns, counters[source], rotating) for source in SOURCES
        }
        self._band: Band | None = None
        self._closed: int | None = None  # the last closed window

    def __getitem__(self, source: Source) -> "_Stream":
        return self._streams[source]

    def feed(
        self, source: Source, times: Integers, rows: Array, *, high_hz: float | None, patience: int
    ) -> list[ClosedWindow]:
        """Take finite samples, times (n,) ns and rows (n, 3) m/s², and give the windows that are complete."""
        self._streams[source].push(times, rows)
        self._settle_on_band(high_hz)
        for stream in self._streams.values():
            stream.work_off(self._closed)
        return list(self._close(patience))

    def _settle_on_band(self, high_hz: float | None) -> None:
        """Take the band of the rates once both are known, another one after a rate has changed."""
        rates = [stream.rate_hz for stream in self._streams.values() if stream.rate_hz]
        if high_hz is not None:
            self._band = Band(HIGH_PASS_HZ, high_hz)
        elif len(rates) == len(SOURCES):
            self._band = common_band(*rates)
        if self._band:
            for stream in self._streams.values():
                stream.start(self._band)

    def _close(self, patience: int) -> Iterator[ClosedWindow]:
        reached = [stream.reached_ns for stream in self._streams.values()]
        for index in sorted(set().union(*(stream.sums for stream in self._streams.values()))):
            end = (index + 1) * self._window_ns
            if min(reached) < end and max(reached) < end + patience * self._window_ns:
                return
            self._closed = index
            sums = {source: stream.sums.pop(index, WindowSum()) for source, stream in self._streams.items()}
            if not any(total.settling for total in sums.values()):
                yield ClosedWindow(index, sums)


class _Stream:
    """One signal of one point.

    Short gaps leave the state of the filter as it is: its high-pass remembers the mean, and a jump between two values
    of a vibration is no worse than the vibration. After more than a window without a sample it starts afresh, and so
    it does once the stamps declare another rate.
    """

    def __init__(self, window_ns: int, counters: StreamCounters, rotating: bool) -> None:
        self.rate_hz: float | None = None
        self.reached_ns = -1  # end of what is in the sums; negative before anything is
        self.sums: dict[int, WindowSum] = {}
        self._window_ns = window_ns
        self._counters = counters
        self._rotating = rotating
        self._pending_times: list[Integers] = []
        self._pending_rows: list[Array] = []
        self.latest_ns: int | None = None  # of all samples, pending or not
        self._continuity: Continuity[tuple[Integers, Array]] = Continuity(window_ns, min(window_ns, MOST_JUMP_NS))
        self._dropped = 0  # samples of the continuity that are counted as late
        self._pace: Pace | None = None
        self._changing = False  # the rate; it is learnt again
        self._design: tuple[float, Band] | None = None  # rate and band of the conditioner
        self._conditioner: CausalConditioner | None = None
        self._settled_ns: int | None = None

    def admit(self, times: Integers, rows: Array) -> list[tuple[Integers, Array]]:
        """Give the blocks to go on with, now that samples at times (n,), ns, with rows (n, 3) have come.

        None while they wait, for they may be of another publisher; several when those that waited are believed.
        """
        length = int(times[-1] - times[0])
        period = length / (len(times) - 1) if length > 0 else self._period_ns
        slack = max(SLACK_NS, length / 2.0, GAP_PERIODS * period)
        block = StreamBlock(int(times[0]), round(times[-1] + period), slack, len(times), (times, rows))
        end = None if self.latest_ns is None else round(self.latest_ns + period)
        admitted = self._continuity.add(block, end)
        self._counters.late += self._continuity.dropped_samples - self._dropped
        self._dropped = self._continuity.dropped_samples
        return [block.content for block in admitted]

    def is_behind(self, times: Integers) -> bool:
        """Whether samples at these times (n,), ns, that were admitted, belong to a new run of the clock."""
        return self.latest_ns is not None and bool(times[0] < self.latest_ns - self._window_ns)

    @property
    def _period_ns(self) -> int:
        return round(NANOSECONDS / self.rate_hz) if self.rate_hz else 0

    def start(self, band: Band) -> None:
        """Condition to this band from now on, if the rate is known."""
        if self.rate_hz and self._design != (self.rate_hz, band):
            self._conditioner = CausalConditioner(self.rate_hz, band)
            self._design = self.rate_hz, band
            self._settled_ns = None

    def push(self, times: Integers, rows: Array) -> None:
        """Take what is newer than all before; learn the rate from the first batch, and again once it changes."""
        latest = int(times[0]) - 1 if self.latest_ns is None else self.latest_ns
        fresh = times > np.maximum.accumulate(np.concatenate([[latest], times[:-1]]))
        self._counters.late += int(np.count_nonzero(~fresh))
        if self._pace:
            self._pace.count(times, latest)
            self._counters.came_hz, self._counters.block_gaps = self._pace.came_hz, self._pace.gaps
        if not fresh.any():
            return
        self._pending_times.append(times[fresh])
        self._pending_rows.append(rows[fresh])
        self.latest_ns = int(times[fresh][-1])
        if self._pace:
            since = self._pace.changed_since(times[fresh])
            if since is not None:
                self._forget_rate(since)
        elif self._holds(BATCH_NS):
            self._learn_rate()

    def _learn_rate(self) -> None:
        pending = np.concatenate(self._pending_times)
        self.rate_hz = sampling_rate((pending - pending[0]) / NANOSECONDS)
        self._pace = Pace(self.rate_hz, self._window_ns)
        self._counters.declared_hz = self.rate_hz
        self._counters.rate_changes += self._changing
        self._changing = False

    def _forget_rate(self, since_ns: int) -> None:
        """Drop what is pending, of either rate, and leave out the windows in which samples of both may be."""
        self.rate_hz, self._pace, self._changing = None, None, True
        self._pending_times, self._pending_rows = [], []
        for index, total in self.sums.items():
            total.settling |= index >= since_ns // self._window_ns

    def work_off(self, closed: int | None) -> None:
        """Add what is pending to the sums, if it is enough; while there is no band, a window of it waits for one."""
        enough = (self._holds(BATCH_NS) or self._ends_window()) if self._conditioner else self._holds(self._window_ns)
        if self.rate_hz is None or not enough:
            return
        times, rows = np.concatenate(self._pending_times), np.concatenate(self._pending_rows)
        self._pending_times, self._pending_rows = [], []
        cuts = np.flatnonzero(np.diff(times, prepend=times[0]) > self._window_ns)
        if 0 <= self.reached_ns < times[0] - self._window_ns:
            cuts = np.concatenate([[0], cuts])
        for number, (stamps, part) in enumerate(zip(np.split(times, cuts), np.split(rows, cuts), strict=True)):
            if number:
                self._counters.gaps += 1
                self._restart()
            if stamps.size:
                self._add(stamps, self._condition(stamps, part), closed)
        self.reached_ns = int(times[-1]) + self._period_ns

    def _holds(self, length_ns: int) -> bool:
        """Whether the pending samples, each with its period, fill a length of time."""
        count = sum(map(len, self._pending_times))
        if count < LEAST_BATCH:
            return False
        span = int(self._pending_times[-1][-1] - self._pending_times[0][0])
        return span * count >= length_ns * (count - 1)

    def _ends_window(self) -> bool:
        """Whether the pending samples reach the end of the window they begin in."""
        if not self._pending_times or self.latest_ns is None:
            return False
        end = (self._pending_times[0][0] // self._window_ns + 1) * self._window_ns
        return bool(self.latest_ns + self._period_ns >= end)

    def _restart(self) -> None:
        self._settled_ns = None
        if self._conditioner:
            self._conditioner.reset()

    def _condition(self, times: Integers, rows: Array) -> Array:
        if self._conditioner is None:
            return np.full(rows.shape, np.nan)
        if self._settled_ns is None:
            self._settled_ns = int(times[0]) + SETTLE_NS
        conditioned = self._conditioner.process(rows)
        if self._rotating:
            conditioned[:, 1:] = np.hypot(conditioned[:, 1], conditioned[:, 2])[:, None]
        return conditioned

    def _add(self, times: Integers, conditioned: Array, closed: int | None) -> None:
        indices = times // self._window_ns
        for index in np.unique(indices).tolist():
            inside = indices == index
            if closed is not None and index <= closed:
                self._counters.late += int(np.count_nonzero(inside))
                continue
            total = self.sums.setdefault(index, WindowSum())
            total.add(conditioned[inside])
            total.rate_hz = self.rate_hz or 0.0
            total.settling |= self._settled_ns is not None and bool(times[inside][0] < self._settled_ns)
