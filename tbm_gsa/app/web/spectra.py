"""Spectra of the model and the field at every test point, a row every few seconds; rows of the last minutes."""

from __future__ import annotations

import base64
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from tbm_gsa.app.web.state import SpectrumRow, Waterfall
from tbm_gsa.comparison.streams import SIDES, Side
from tbm_gsa.history.summary import iso_time
from tbm_gsa.signals.conditioning import Band
from tbm_gsa.signals.spans import SpanCollector, SpanSpectrum
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.units import NANOSECONDS

SPAN_NS: Final = 4 * NANOSECONDS
"""Time of a row."""
ROWS: Final = 150
"""Rows that are kept: ten minutes."""
PATIENCE_NS: Final = SPAN_NS
"""How far a signal may lag behind before a row is closed without it."""
RESOLUTION_HZ: Final = 0.5
HIGH_HZ: Final = 400.0
LOWEST_DB, STEP_DB = -120.0, 0.75
"""Of the code of a density, dB over 1 m²/s⁴/Hz: from below the noise of any sensor to its range."""
_BATCH_NS: Final = NANOSECONDS  # worked off together
_BAND: Final = Band(0.0, HIGH_HZ)  # the samples are taken as they are


def coded(density: Array) -> str:
    """Densities (n,) as base64 of a byte each: steps from the lowest on; 0 is nothing, or less."""
    with np.errstate(divide="ignore"):
        level = (10.0 * np.log10(density) - LOWEST_DB) / STEP_DB
    return base64.b64encode(np.clip(np.rint(level), 0, 255).astype(np.uint8).tobytes()).decode("ascii")


class _Signal:
    """One signal of one point: its blocks until they are worth working off."""

    def __init__(self) -> None:
        self._collector = SpanCollector(SPAN_NS, RESOLUTION_HZ)
        self._latest_ns = -1
        self._waiting: list[tuple[Integers, Array]] = []

    def is_behind(self, times: Integers) -> bool:
        """Whether samples belong to a new run of the clock, as of a recording that loops."""
        return bool(times[0] < self._latest_ns - SPAN_NS)

    def add(self, times: Integers, values: Array) -> list[SpanSpectrum]:
        """Add samples in the machine's axes; the spectra that are complete with them."""
        fresh = times > np.maximum.accumulate(np.concatenate([[self._latest_ns], times[:-1]]))
        if not fresh.any():
            return []
        self._waiting.append((times[fresh], values[fresh]))
        self._latest_ns = int(times[fresh][-1])
        if self._latest_ns - self._waiting[0][0][0] < _BATCH_NS:
            return []
        stamps, rows = (np.concatenate(parts) for parts in zip(*self._waiting, strict=True))
        self._waiting = []
        self._collector.add(stamps, rows, _BAND)
        return self._collector.pop()


class LiveSpectra:
    """Spectra of all points while samples come.

    Parameters
    ----------
    points : sequence of str
    """

    def __init__(self, points: Sequence[str]) -> None:
        self._points = tuple(points)
        self._signals: dict[tuple[str, Side], _Signal] = {}
        self._open: dict[int, dict[str, dict[Side, str]]] = {}  # rows that are not complete, by their begin
        self._closed_ns = -1
        self._rows: deque[SpectrumRow] = deque(maxlen=ROWS)  # read by other threads, changed by this one

    def restart(self, point: str) -> None:
        """Begin a point of the field anew: its signal comes from elsewhere now."""
        self._signals.pop((point, "field"), None)

    def add(self, point: str, side: Side, times: Integers, values: Array) -> list[SpectrumRow]:
        """Add samples (n, 3) m/s² at times (n,) ns; the rows that are complete with them."""
        finite = np.isfinite(values).all(axis=1)
        times, values = times[finite], values[finite]
        if point not in self._points or not times.size:
            return []
        signal = self._signals.setdefault((point, side), _Signal())
        if signal.is_behind(times):
            self._signals[point, side] = signal = _Signal()
            self._open, self._closed_ns = {}, -1
        spans = signal.add(times, values)
        return [row for found in spans if found.start_ns > self._closed_ns for row in self._add(point, side, found)]

    def waterfall(self, point: str) -> Waterfall:
        """Rows of one point, the oldest first."""
        kept = (row.model_copy(update={"points": {point: row.points.get(point, {})}}) for row in tuple(self._rows))
        return Waterfall(point=point, rows=tuple(kept))

    def _add(self, point: str, side: Side, found: SpanSpectrum) -> Iterator[SpectrumRow]:
        row = self._open.setdefault(found.start_ns, {})
        row.setdefault(point, {})[side] = coded(found.density[: round(HIGH_HZ / found.step_hz) + 1, 0])
        whole = all(len(row.get(name, {})) == len(SIDES) for name in self._points)
        for start_ns in sorted(self._open):
            if (whole and start_ns <= found.start_ns) or start_ns < found.start_ns - PATIENCE_NS:
                yield self._close(start_ns)

    def _close(self, start_ns: int) -> SpectrumRow:
        self._closed_ns = start_ns
        row = SpectrumRow(time=iso_time(start_ns), step_hz=RESOLUTION_HZ, points=self._open.pop(start_ns))
        self._rows.append(row)
        return row
