"""Spans of single test points → spans of all of them, whatever the clocks of some sensors say."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Mapping
from statistics import median_low
from typing import Final

from tbm_gsa.signals.spans import SpanSpectrum

SILENT: Final = 3
"""Spans of another point after which one that brought none is not waited for."""
MOST_OPEN: Final = 10
"""Spans that wait; those of a clock that is farther ahead than so many are lost."""
_REMEMBERED = 200


class SpanGatherer:
    """Puts the spans of all test points together.

    A span is over when the points of the last one have brought it, or half of the points that are there have come to a
    later one. One that fewer than half have brought, or that is brought later, is of no use, unless the clock of its
    point was set back: then all begin anew.
    """

    def __init__(self) -> None:
        self._restart()

    def _restart(self) -> None:
        self._open: dict[int, dict[str, SpanSpectrum]] = {}
        self._expected: set[str] = set()
        self._reached: dict[str, int] = {}
        self._brought: deque[str] = deque(maxlen=_REMEMBERED)  # points, the latest last
        self._last = -1

    def add(self, found: Mapping[str, Iterable[SpanSpectrum]]) -> list[dict[str, SpanSpectrum]]:
        """Spans that are over, in the order of time."""
        for point, spans in found.items():
            for one in spans:
                self._bring(point, one)
        over = []
        now, count = self._now()
        for start in sorted(self._open):
            there = self._open[start].keys()
            if start >= now and not (self._expected and self._expected <= there):
                break
            spectra = self._open.pop(start)
            if 2 * len(spectra) >= count:
                self._last, self._expected = start, set(spectra)
                over.append(spectra)
        for start in sorted(self._open)[MOST_OPEN:]:
            del self._open[start]
        return over

    def _bring(self, point: str, one: SpanSpectrum) -> None:
        if one.start_ns < self._reached.get(point, -1):
            self._restart()
        self._reached[point] = one.start_ns
        self._brought.append(point)
        if one.start_ns == self._last:
            self._expected.add(point)  # the next time it is waited for
        elif one.start_ns > self._last:
            self._open.setdefault(one.start_ns, {})[point] = one

    def _now(self) -> tuple[int, int]:
        """Begin of the span to which half of the points have come that are there, and how many are."""
        latest = list(reversed(self._brought))
        there = []
        for point, start in self._reached.items():
            others = latest[: latest.index(point)] if point in latest else latest
            if max(Counter(others).values(), default=0) < SILENT:
                there.append(start)
        return median_low(there) if there else -1, len(there)
