"""The samples of one topic, put in order of header time while they are read, piece by piece."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.recordings.decoding import DecodedSamples
from tbm_msgs_py.recordings.faults import CLOCK_JUMP_NS, Clock, FaultCounts, clock_of, other_clocks

LATENESS_NS = CLOCK_JUMP_NS  # a piece waits so long for samples that are late
_LARGEST = float(np.finfo(np.float32).max)  # what a block holds; powers of more than that are no numbers
_NONE = FaultCounts()
NO_STAMPS = "every header stamp is 0, allowed: stamped samples"


@dataclass(frozen=True, eq=False)
class DecodedStream:
    """Samples of one piece.

    Attributes
    ----------
    times_ns : ndarray (n,)
        Header times, strictly increasing, also from one piece to the next.
    values : ndarray (n, 3)
        Sensor axes, unit as recorded.
    before_ns : int or None
        Time of the last sample of the piece before.
    faults, clock : FaultCounts, Clock
        Since the piece before.
    """

    times_ns: Integers
    values: Array
    before_ns: int | None
    faults: FaultCounts
    clock: Clock


class Timeline:
    """Samples of one topic, added in file order and read in time order.

    Attributes
    ----------
    latest_ns : int or None
        About the header time reached: the middle one of the last stamps, which a single wrong one does not move.
    total : FaultCounts
        All that was found so far.
    problem : str
        Why samples were dropped, the first reason.
    """

    def __init__(self) -> None:
        self.latest_ns: int | None = None
        self.total = FaultCounts()
        self.problem = ""
        self._pending: list[DecodedSamples] = []
        self._times: Integers = np.empty(0, np.int64)
        self._values: Array = np.empty((0, 3))
        self._popped_ns: int | None = None
        self._newest_ns = np.iinfo(np.int64).min  # of all samples so far
        self._last: tuple[int, int] | None = None  # stamp and log time of the last message that was not astray
        self._faults = FaultCounts()
        self._messages = self._times, self._times  # stamps and log times of the messages that wait
        self._clock = Clock()

    def add(self, samples: DecodedSamples) -> None:
        """Add the samples of the next messages."""
        self.problem = self.problem or samples.problem
        self._count(samples.faults)
        if len(samples.stamps_ns):
            self._pending.append(samples)
            middle = len(samples.stamps_ns) // 2
            self.latest_ns = int(np.partition(samples.stamps_ns, middle)[middle])

    def first_ns(self) -> int | None:
        """Time of the first sample that waits."""
        self._order()
        return int(self._times[0]) if len(self._times) else None

    def pop(self, until_ns: int) -> DecodedStream | None:
        """Remove and return all samples before a time; None when there are none."""
        self._order()
        count = int(np.searchsorted(self._times, until_ns))
        if not count:
            return None
        times, values = self._times[:count], self._values[:count]
        stream = DecodedStream(times, values, self._popped_ns, self._faults, self._clock_until(until_ns))
        self._popped_ns = int(self._times[count - 1])
        self._times, self._values = self._times[count:].copy(), self._values[count:].copy()
        self._faults = FaultCounts()
        return stream

    def _clock_until(self, until_ns: int) -> Clock:
        """Clock of the messages that begin before a time; as before when there are none."""
        stamps, log = self._messages
        here = stamps < until_ns
        if here.any():
            self._clock = clock_of(stamps[here], log[here])
            self._messages = stamps[~here], log[~here]
        return self._clock

    def _count(self, faults: FaultCounts) -> None:
        if faults != _NONE:
            self._faults += faults
            self.total += faults

    def _order(self) -> None:
        """Put what was added into the order of time."""
        if not self._pending:
            return
        columns = [np.concatenate(column) for column in list(zip(*self._pending, strict=True))[:5]]
        self._pending = []
        stamps, log, counts, times, values = columns
        if not stamps.any():
            self._count(FaultCounts(unstamped=len(stamps)))
            self.problem = self.problem or NO_STAMPS
            return
        times, values, stamps, log = self._one_clock(stamps, log, counts, times, values)
        self._messages = np.concatenate((self._messages[0], stamps)), np.concatenate((self._messages[1], log))
        self._merge(*self._usable(times, values))

    def _one_clock(
        self, stamps: Integers, log: Integers, counts: Integers, times: Integers, values: Array
    ) -> tuple[Integers, Array, Integers, Integers]:
        """Drop the messages of another clock, and what a clock that was set back states a second time."""
        astray, steps, self._last = other_clocks(stamps, log, self._last)
        if not astray.any() and not steps:
            return times, values, stamps, log
        sample_of = np.repeat(np.arange(len(stamps)), counts)
        keep = ~astray[sample_of]
        late = 0
        for step in steps:
            before, after = keep & (sample_of < step), sample_of >= step
            passed = max(self._newest_ns, int(times[before].max(initial=self._newest_ns)))
            again = keep & after & (times <= passed) if stamps[step] <= passed else np.zeros_like(keep)
            late += int(np.count_nonzero(again))
            keep &= ~again
        self._count(FaultCounts(astray=int(np.count_nonzero(astray)), late=late, clock_steps=len(steps)))
        return times[keep], values[keep], stamps[~astray], log[~astray]

    def _usable(self, times: Integers, values: Array) -> tuple[Integers, Array]:
        """Drop samples that are not finite or that no block holds, and those for which it is too late."""
        finite = (np.abs(values) <= _LARGEST).all(axis=1)
        if not finite.all():
            times, values = times[finite], values[finite]
            self._count(FaultCounts(invalid=int(np.count_nonzero(~finite))))
        if self._popped_ns is not None and len(times) and times.min() <= self._popped_ns:
            keep = times > self._popped_ns
            self._count(FaultCounts(late=int(np.count_nonzero(~keep))))
            times, values = times[keep], values[keep]
        return times, values

    def _merge(self, times: Integers, values: Array) -> None:
        if not len(times):
            return
        reached = np.maximum.accumulate(np.concatenate(([self._newest_ns], times)))
        self._newest_ns = int(reached[-1])
        times, values = np.concatenate((self._times, times)), np.concatenate((self._values, values))
        if not (np.diff(times) > 0).all():
            behind = int(np.count_nonzero(times[len(self._times) :] < reached[:-1]))
            order = np.argsort(times, kind="stable")
            times, values = times[order], values[order]
            first = np.concatenate(([True], np.diff(times) > 0))
            self._count(FaultCounts(disordered=behind, duplicates=int(np.count_nonzero(~first))))
            times, values = times[first], values[first]
        self._times, self._values = times, values
