"""One test point while its two signals arrive: ordering, conditioning, sums per window; no samples kept."""

from collections.abc import Iterator, Mapping
from typing import Literal

import numpy as np

from tbm_dynamics.streaming.continuity import Continuity, StreamBlock
from tbm_gsa.comparison.rate import RateEstimator, StreamCounters
from tbm_gsa.signals.clock import GAP_PERIODS
from tbm_gsa.signals.conditioning import HIGH_PASS_HZ, Band, along, causal_conditioner, common_band
from tbm_gsa.signals.spans import SpanCollector
from tbm_gsa.signals.statistics import coverage
from tbm_gsa.signals.windows import WindowSums
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.causal_filter import CausalFilter
from tbm_msgs_py.base.units import NANOSECONDS

Side = Literal["model", "field"]
SIDES: tuple[Side, Side] = ("model", "field")

BATCH_NS = 200_000_000  # samples are worked off in batches; the first one gives the rate and the mean to start from
LEAST_BATCH = 8  # samples
SLACK_NS = 30_000_000  # stamps jitter, and single samples are lost: so near, they are the signal's
# A jump of the clock is believed after a window without a sample where the signal had got to, or after so long.
MOST_JUMP_NS = 2_000_000_000
SETTLE_NS = round(NANOSECONDS / HIGH_PASS_HZ)  # one period of the high-pass
FIXED, ROTATING = ((0,), (1,), (2,)), ((0,), (1, 2), (1, 2))  # columns behind x, y and z


class LiveWindow(WindowSums):
    """Sums of one signal over one window, along x, y and z; NaN without a band.

    Attributes
    ----------
    rate_hz : float
        Of the samples; zero before there are any.
    settling : bool
        The filter had not settled at its begin, or the rate may have changed in it.
    """

    def __init__(self) -> None:
        super().__init__(axes=3)
        self.rate_hz, self.settling = 0.0, False

    def coverage(self, window_ns: int) -> float:
        """Share of the window that arrived."""
        return coverage(self.count, self.rate_hz, window_ns / NANOSECONDS) if self.rate_hz else 0.0


class PointStreams:
    """Both signals of one test point; they begin afresh when the clock of one jumps back, as a bag does that loops.

    Parameters
    ----------
    window_ns : int
        Length of a window.
    counters : mapping of Side to StreamCounters
        They outlive a restart.
    rotating : bool
        The sensor turns with the head: y and z both become √(y² + z²), as `compared_axes` says.
    high_hz : float or None
        Upper limit of the band; by default that of the rates once both are known.
    patience : int
        Windows that one signal may lag behind before a window is closed without it.
    spans : SpanCollector, optional
        Gets the field as it is conditioned.
    """

    def __init__(
        self,
        window_ns: int,
        counters: Mapping[Side, StreamCounters],
        *,
        rotating: bool,
        high_hz: float | None,
        patience: int,
        spans: SpanCollector | None = None,
    ) -> None:
        self._window_ns, self._patience_ns, self._counters = window_ns, patience * window_ns, counters
        self._axes = ROTATING if rotating else FIXED
        self._spans: dict[Side, SpanCollector | None] = {"model": None, "field": spans}
        self._given = None if high_hz is None else Band(HIGH_PASS_HZ, high_hz)
        self._restart()

    def _restart(self) -> None:
        self.streams = {
            source: _Stream(self._window_ns, self._counters[source], self._axes, self._spans[source])
            for source in SIDES
        }
        for spans in filter(None, self._spans.values()):
            spans.restart()
        self._band = self._given
        self._closed: int | None = None  # the last closed window

    def feed(self, source: Side, times: Integers, rows: Array) -> Iterator[tuple[int, dict[Side, LiveWindow]]]:
        """Windows, by number and signal, that finite samples complete: times (n,) ns, rows (n, 3) m/s²."""
        for stamps, part in self.streams[source].admit(times, rows):
            if self.streams[source].queue.is_behind(stamps, self._window_ns):
                self._counters[source].restarts += 1
                self._restart()
            self.streams[source].push(stamps, part)
            rates = [stream.rate.hz for stream in self.streams.values() if stream.rate.hz]
            if self._given is None and len(rates) == len(SIDES):
                self._band = common_band(*rates)
            for stream in self.streams.values():
                stream.work_off(self._band, self._closed)
            yield from self._close()

    def _close(self) -> Iterator[tuple[int, dict[Side, LiveWindow]]]:
        reached = [stream.reached_ns for stream in self.streams.values()]
        for index in sorted(set().union(*(stream.sums for stream in self.streams.values()))):
            end = (index + 1) * self._window_ns
            if min(reached) < end and max(reached) < end + self._patience_ns:
                return
            self._closed = index
            sums = {source: stream.sums.pop(index, LiveWindow()) for source, stream in self.streams.items()}
            if not any(total.settling for total in sums.values()):
                yield index, sums


class SampleQueue:
    """Samples that wait to be worked off, each newer than all before it."""

    def __init__(self) -> None:
        self.latest_ns: int | None = None  # of all samples, those worked off too
        self.clear()

    def __len__(self) -> int:
        return sum(map(len, self._times))

    def clear(self) -> None:
        """Drop what waits."""
        self._times: list[Integers] = []
        self._rows: list[Array] = []

    def push(self, times: Integers, rows: Array) -> Integers:
        """Add what is newer than all before; the times of it are returned."""
        latest = times[0] - 1 if self.latest_ns is None else self.latest_ns
        fresh = times > np.maximum.accumulate(np.concatenate([[latest], times[:-1]]))
        if fresh.any():
            self._times.append(times[fresh])
            self._rows.append(rows[fresh])
            self.latest_ns = int(times[fresh][-1])
        return times[fresh]

    def is_behind(self, times: Integers, window_ns: int) -> bool:
        """Whether samples at times (n,), ns, belong to a new run of the clock."""
        return self.latest_ns is not None and bool(times[0] < self.latest_ns - window_ns)

    def holds(self, length_ns: int) -> bool:
        """Whether what waits, each sample with its period, fills a length of time."""
        if len(self) < LEAST_BATCH:
            return False
        span = int(self._times[-1][-1] - self._times[0][0])
        return span * len(self) >= length_ns * (len(self) - 1)

    def ends_window(self, window_ns: int, period_ns: int) -> bool:
        """Whether what waits reaches the end of the window it begins in."""
        if not self._times or self.latest_ns is None:
            return False
        return bool(self.latest_ns + period_ns >= (self._times[0][0] // window_ns + 1) * window_ns)

    @property
    def times(self) -> Integers:
        """Times of what waits, (n,), ns."""
        return np.concatenate(self._times)

    def pop_all(self) -> tuple[Integers, Array]:
        """Remove and return what waits, times (n,) ns and rows (n, 3)."""
        times, rows = self.times, np.concatenate(self._rows)
        self.clear()
        return times, rows


class GapConditioner:
    """Conditions one signal as it comes, with the causal filter.

    Short gaps leave the state of the filter as it is: its high-pass remembers the mean, and a jump between two values
    of a vibration is no worse than the vibration. After more than a window without a sample it starts afresh, and so
    it does with another rate or band. Without a band all is NaN.
    """

    def __init__(self, window_ns: int, counters: StreamCounters) -> None:
        self._window_ns, self._counters = window_ns, counters
        self._design: tuple[float, Band] | None = None
        self._filter: CausalFilter | None = None
        self.settled_ns: int | None = None

    def start(self, rate_hz: float, band: Band) -> None:
        """Condition to this band from now on."""
        if self._design != (rate_hz, band):
            self._filter, self._design = causal_conditioner(rate_hz, band), (rate_hz, band)
            self.settled_ns = None

    def process(self, times: Integers, rows: Array, reached_ns: int) -> Iterator[tuple[Integers, Array]]:
        """Parts between gaps, times (n,) ns and values (n, 3) m/s², of samples after those that end at `reached_ns`."""
        before = reached_ns if reached_ns >= 0 else times[0]
        cuts = np.flatnonzero(np.diff(times, prepend=before) > self._window_ns)
        for number, (stamps, part) in enumerate(zip(np.split(times, cuts), np.split(rows, cuts), strict=True)):
            if number:
                self._counters.gaps += 1
                self.settled_ns = None
                if self._filter:
                    self._filter.reset()
            if stamps.size:
                yield stamps, self._condition(stamps, part)

    def _condition(self, times: Integers, rows: Array) -> Array:
        if self._filter is None:
            return np.full_like(rows, np.nan)
        if self.settled_ns is None:
            self.settled_ns = int(times[0]) + SETTLE_NS
        return self._filter.process(rows, rows.mean(axis=0))


class _Stream:
    """One signal of one point."""

    def __init__(
        self,
        window_ns: int,
        counters: StreamCounters,
        axes: tuple[tuple[int, ...], ...],
        spans: SpanCollector | None,
    ) -> None:
        self.reached_ns = -1  # end of what is in the sums; negative before anything is
        self.sums: dict[int, LiveWindow] = {}
        self.queue, self.rate = SampleQueue(), RateEstimator(window_ns, counters)
        self._window_ns, self._counters, self._axes, self._spans = window_ns, counters, axes, spans
        self._continuity: Continuity[tuple[Integers, Array]] = Continuity(window_ns, min(window_ns, MOST_JUMP_NS))
        self._conditioner = GapConditioner(window_ns, counters)

    def admit(self, times: Integers, rows: Array) -> list[tuple[Integers, Array]]:
        """Blocks to go on with, now that samples at times (n,), ns, with rows (n, 3) have come.

        None while they wait, for they may be of another publisher; several when those that waited are believed.
        """
        length, latest_ns = int(times[-1] - times[0]), self.queue.latest_ns
        period = length / (len(times) - 1) if length > 0 else self.rate.period_ns
        slack = max(SLACK_NS, length / 2.0, GAP_PERIODS * period)
        block = StreamBlock(int(times[0]), round(times[-1] + period), slack, len(times), (times, rows))
        dropped = self._continuity.dropped_samples
        admitted = self._continuity.add(block, None if latest_ns is None else round(latest_ns + period))
        self._counters.late += self._continuity.dropped_samples - dropped
        return [one.content for one in admitted]

    def push(self, times: Integers, rows: Array) -> None:
        """Add what is newer than all before; learn the rate from the first batch, and again once it changes."""
        latest_ns = self.queue.latest_ns
        fresh = self.queue.push(times, rows)
        self._counters.late += len(times) - len(fresh)
        if self.rate.hz and latest_ns is not None:
            self.rate.add_block(times, latest_ns)
            since_ns = self.rate.changed_since(fresh) if fresh.size else None
            if since_ns is not None:
                # What waits may be of either rate, and so may be what is in the windows since then.
                self.queue.clear()
                for index, total in self.sums.items():
                    total.settling |= index >= since_ns // self._window_ns
        elif fresh.size and self.queue.holds(BATCH_NS):
            self.rate.learn(self.queue.times)

    def work_off(self, band: Band | None, closed: int | None) -> None:
        """Add what waits to the sums, if it is enough.

        While there is no band a window of it waits for the other signal, whose rate limits it; then its own rate does.
        """
        if self.rate.hz is None:
            return
        period_ns, batch_ns = self.rate.period_ns, BATCH_NS if band else self._window_ns
        if not (self.queue.holds(batch_ns) or (band and self.queue.ends_window(self._window_ns, period_ns))):
            return
        used = band or common_band(self.rate.hz)
        self._conditioner.start(self.rate.hz, used)
        times, rows = self.queue.pop_all()
        for stamps, values in self._conditioner.process(times, rows, self.reached_ns):
            self._add(stamps, along(values, self._axes), closed, self.rate.hz)
            self._add_to_span(stamps, values, used)
        self.reached_ns = int(times[-1]) + period_ns

    def _add(self, times: Integers, values: Array, closed: int | None, rate_hz: float) -> None:
        settled_ns, indices = self._conditioner.settled_ns, times // self._window_ns
        for index in np.unique(indices).tolist():
            inside = indices == index
            if closed is not None and index <= closed:
                self._counters.late += int(np.count_nonzero(inside))
                continue
            total = self.sums.setdefault(index, LiveWindow())
            total.add(values[:, inside])
            total.rate_hz = rate_hz
            total.settling |= settled_ns is not None and bool(times[inside][0] < settled_ns)

    def _add_to_span(self, times: Integers, values: Array, band: Band) -> None:
        settled = times >= (self._conditioner.settled_ns or 0)
        if self._spans is not None and settled.any():
            self._spans.add(times[settled], values[settled], band)
