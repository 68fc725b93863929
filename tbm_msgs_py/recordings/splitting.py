"""Where the timelines of a recording are split into pieces while it is read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from tbm_msgs_py.recordings.timeline import LATENESS_NS, DecodedStream, Timeline

_NEVER_NS = (1 << 63) - 1


class RecordSplitter:
    """Splits timelines at common header times, a piece length apart.

    A timeline whose clock is more than a piece from that of the one that has got furthest has cuts of its own, at what
    it has reached itself: no piece waits for a time that a clock never shows.

    Parameters
    ----------
    lines : mapping of str to Timeline
        By test point.
    length_s : float
        Length of a piece, s; ``inf`` for one piece.
    """

    def __init__(self, lines: Mapping[str, Timeline], length_s: float) -> None:
        self._lines = lines
        self._length = round(min(length_s * 1e9, _NEVER_NS))
        self._origin: int | None = None
        self._cuts: dict[str, int] = {}

    def due(self) -> Iterator[dict[str, DecodedStream]]:
        """Pieces that are complete: samples may be late by `LATENESS_NS`."""
        self._begin()
        while leader := next((point for point in self._cuts if self._reached(point)), None):
            yield from self._cut(self._cuts[leader])

    def rest(self) -> Iterator[dict[str, DecodedStream]]:
        """Pieces of what is left when all is read."""
        self._begin()
        while left := [point for point in self._cuts if self._lines[point].first_ns() is not None]:
            yield from self._cut(min(self._cuts[point] for point in left), last=True)

    def _begin(self) -> None:
        """Set for every timeline that has samples by now its first cut."""
        new = {point: line.first_ns() for point, line in self._lines.items() if point not in self._cuts}
        firsts = {point: first for point, first in new.items() if first is not None}
        if firsts and self._origin is None:
            some = next(iter(firsts.values()))
            self._origin = min(first for first in firsts.values() if abs(first - some) < LATENESS_NS)
        for point, first in firsts.items():
            self._cuts[point] = self._after(first)

    def _after(self, time_ns: int) -> int:
        """Next cut of the common grid after a time."""
        if self._length == _NEVER_NS:
            return _NEVER_NS
        origin = self._origin or 0
        return origin + ((time_ns - origin) // self._length + 1) * self._length

    def _reached(self, point: str) -> bool:
        latest = self._lines[point].latest_ns
        return latest is not None and latest >= self._cuts[point] + LATENESS_NS

    def _cut(self, until: int, *, last: bool = False) -> Iterator[dict[str, DecodedStream]]:
        piece: dict[str, DecodedStream] = {}
        for point, cut in self._cuts.items():
            line = self._lines[point]
            in_step = cut == until
            if last and not in_step:
                continue
            own = (line.latest_ns or 0) - LATENESS_NS
            here = until if in_step else own
            if (stream := line.pop(here)) is not None:
                piece[point] = stream
            first = line.first_ns()
            self._cuts[point] = self._after(max(here, own if first is None else first))
        if piece:
            yield piece
