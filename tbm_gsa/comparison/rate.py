"""How fast one signal comes while it arrives: what the stamps within its blocks declare, and what is between them."""

from dataclasses import dataclass

import numpy as np

from tbm_gsa.signals.clock import GAP_PERIODS, RATE_TOLERANCE, sampling_rate
from tbm_msgs_py.base.arrays import Integers
from tbm_msgs_py.base.units import NANOSECONDS

EVIDENCE = 256  # samples; single ones whose stamps jitter by 40 % of a period (σ) say their rate within 15 %
RATE_CHANGE = 0.15  # relative
LEAST_BLOCKS = 8


@dataclass
class StreamCounters:
    """What happened to one signal of one point since the beginning."""

    rejected: int = 0  # samples that were not finite
    late: int = 0  # samples not newer than the ones before, of a window already closed, or beside the signal
    gaps: int = 0  # times without samples that were longer than a window
    restarts: int = 0  # jumps back of the stamps, by more than a window
    rate_changes: int = 0  # of the rate that stamps declare, while they run on
    declared_hz: float = 0.0  # the rate since then
    came_hz: float = 0.0  # samples a second in the last time as long as a window
    block_gaps: int = 0  # in it, if they follow most blocks: another rate comes than is declared


class RateEstimator:
    """Rate of a signal: learnt from its first stamps, forgotten once later ones declare another.

    A lost block now and then is no other rate, nor are blocks whose stamps jitter: only gaps after most blocks are
    counted, and only if less came than was declared.

    Parameters
    ----------
    window_ns : int
        Length of time over which blocks are judged.
    counters : StreamCounters

    Attributes
    ----------
    hz : float or None
        None until it is learnt, and after a change.
    """

    def __init__(self, window_ns: int, counters: StreamCounters) -> None:
        self.hz: float | None = None
        self._window_ns, self._counters = window_ns, counters
        self._changing = False
        self._begin()

    def _begin(self) -> None:
        self._since_ns: int | None = None
        self._blocks = self._samples = self._gaps = 0  # since then
        self._recent: list[Integers] = []

    @property
    def period_ns(self) -> int:
        """Time from sample to sample; zero while it is not known."""
        return round(NANOSECONDS / self.hz) if self.hz else 0

    def learn(self, times: Integers) -> None:
        """Learn the rate from samples at times (n,), ns."""
        self.hz = sampling_rate((times - times[0]) / NANOSECONDS)
        counters = self._counters
        counters.declared_hz, counters.came_hz, counters.block_gaps = self.hz, 0.0, 0
        counters.rate_changes += self._changing
        self._changing = False
        self._begin()

    def add_block(self, times: Integers, latest_ns: int) -> None:
        """Count a block with samples at times (n,), ns, after one that ended with the sample at `latest_ns`."""
        assert self.hz is not None  # noqa: S101 - called once the rate is learnt
        first = int(times[0])
        if self._since_ns is None:
            self._since_ns, latest_ns = first, first
        self._gaps += (first - latest_ns) * self.hz > GAP_PERIODS * NANOSECONDS
        if self._blocks >= LEAST_BLOCKS and first - self._since_ns >= self._window_ns:
            came_hz = self._samples * NANOSECONDS / (first - self._since_ns)
            short = came_hz < (1.0 - RATE_TOLERANCE) * self.hz
            self._counters.came_hz = came_hz
            self._counters.block_gaps = self._gaps if short and 2 * self._gaps > self._blocks else 0
            self._since_ns, self._blocks, self._samples, self._gaps = first, 0, 0, 0
        self._blocks += 1
        self._samples += len(times)

    def changed_since(self, times: Integers) -> int | None:
        """First time in ns at which the rate may be another, if samples at times (n,), ns, now say that it is."""
        self._recent.append(times)
        if sum(map(len, self._recent)) < EVIDENCE:
            return None
        recent = np.concatenate(self._recent)
        self._recent = []
        rate = sampling_rate((recent - recent[0]) / NANOSECONDS)
        if self.hz is None or abs(rate / self.hz - 1.0) <= RATE_CHANGE:
            return None
        self.hz, self._changing = None, True
        return int(recent[0])
