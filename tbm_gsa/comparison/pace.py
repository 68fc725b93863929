"""How fast one signal comes while it arrives: what the stamps within its blocks declare, and what is between them."""

import numpy as np

from tbm_gsa.signals.clock import GAP_PERIODS, RATE_TOLERANCE, sampling_rate
from tbm_msgs_py.base.arrays import Integers
from tbm_msgs_py.base.units import NANOSECONDS

EVIDENCE = 256  # samples; single ones whose stamps jitter by 40 % of a period (σ) say their rate within 15 %
RATE_CHANGE = 0.15  # relative
LEAST_BLOCKS = 8


class Pace:
    """Holds a signal against the rate that its first stamps declared.

    A lost block now and then is no other rate, nor are blocks whose stamps jitter: only gaps after most blocks are
    told, and only if less came than was declared.

    Parameters
    ----------
    rate_hz : float
        Declared rate.
    stretch_ns : int
        Length of time over which blocks are judged.

    Attributes
    ----------
    gaps : int
        Gaps between the blocks of the last stretch; zero if they are as they should be.
    came_hz : float
        Samples a second in it, gaps included; zero before the first one ends.
    """

    def __init__(self, rate_hz: float, stretch_ns: int) -> None:
        self.gaps, self.came_hz = 0, 0.0
        self._rate = rate_hz
        self._stretch_ns = stretch_ns
        self._since_ns: int | None = None
        self._blocks = self._samples = self._gaps = 0  # since then
        self._recent: list[Integers] = []
        self._evidence = 0  # samples of it

    def count(self, times: Integers, latest_ns: int) -> None:
        """Take a block with samples at times (n,), ns, after one that ended with the sample at `latest_ns`."""
        first = int(times[0])
        if self._since_ns is None:
            self._since_ns, latest_ns = first, first
        self._gaps += (first - latest_ns) * self._rate > GAP_PERIODS * NANOSECONDS
        if self._blocks >= LEAST_BLOCKS and first - self._since_ns >= self._stretch_ns:
            self.came_hz = self._samples * NANOSECONDS / (first - self._since_ns)
            short = self.came_hz < (1.0 - RATE_TOLERANCE) * self._rate
            self.gaps = self._gaps if short and 2 * self._gaps > self._blocks else 0
            self._since_ns, self._blocks, self._samples, self._gaps = first, 0, 0, 0
        self._blocks += 1
        self._samples += len(times)

    def changed_since(self, times: Integers) -> int | None:
        """Take samples at times (n,), ns; if they say another rate, give the first time in ns at which it may be so."""
        self._recent.append(times)
        self._evidence += len(times)
        if self._evidence < EVIDENCE:
            return None
        recent = np.concatenate(self._recent)
        self._recent, self._evidence = [], 0
        rate = sampling_rate((recent - recent[0]) / NANOSECONDS)
        return int(recent[0]) if abs(rate / self._rate - 1.0) > RATE_CHANGE else None
