"""Spectra of the model and the field at every test point, a row every few seconds; rows of the last minutes."""

from __future__ import annotations

import base64
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from tbm_gsa.app.web.state import SpectrumRow, Waterfall
from tbm_gsa.comparison.results import ExpectedLine
from tbm_gsa.comparison.streams import SIDES, Side
from tbm_gsa.signals.conditioning import Band
from tbm_gsa.signals.spans import SpanCollector, SpanSpectrum
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.units import NANOSECONDS, iso_time

SPAN_NS: Final = 4 * NANOSECONDS
"""Time of a row."""
ROWS: Final = 150
"""Rows that are kept: ten minutes."""
PATIENCE_NS: Final = SPAN_NS
"""How far a signal may lag behind before a row is closed without it."""
RESOLUTION_HZ: Final = 0.5
APART_HZ: Final = 3.0 * RESOLUTION_HZ
"""Beyond the main lobe of a line."""
HIGH_HZ: Final = 400.0
LOWEST_DB, STEP_DB = -120.0, 0.75
"""Of the code of a density, dB over 1 m²/s⁴/Hz: from below the noise of any sensor to its range."""
_BATCH_NS: Final = NANOSECONDS  # worked off together
_BAND: Final = Band(0.0, HIGH_HZ)  # the samples are taken as they are


def told_apart(lines: Sequence[ExpectedLine]) -> tuple[ExpectedLine, ...]:
    """Lines without the sidebands that a spectrum of these rows does not tell from their mesh."""
    meshes = [line.frequency_hz for line in lines if line.kind == "mesh"]
    return tuple(
        line
        for line in lines
        if line.kind != "sideband" or min(abs(line.frequency_hz - mesh) for mesh in meshes) > APART_HZ
    )


def coded(density: Array) -> str:
    """Densities (n,) as base64 of a byte each: steps from the lowest on; 0 is nothing, or less."""
    with np.errstate(divide="ignore"):
        level = (10.0 * np.log10(density) - LOWEST_DB) / STEP_DB
    return base64.b64encode(np.clip(np.rint(level), 0, 255).astype(np.uint8).tobytes()).decode("ascii")


class _Signal:
    """One signal of one point: its blocks until they are worth working off, a second of them."""

    def __init__(self) -> None:
        self._collector = SpanCollector(SPAN_NS, RESOLUTION_HZ)
        self._begun_ns, self._latest_ns = -1, -1
        self._waiting: list[tuple[int, np.ndarray, np.ndarray]] = []

    def is_behind(self, stamp_ns: int) -> bool:
        """Whether a block belongs to a new run of the clock, as of a recording that loops."""
        return stamp_ns < max(self._latest_ns, self._begun_ns) - SPAN_NS

    def add(self, stamp_ns: int, offsets: np.ndarray, values: np.ndarray, matrix: Array) -> list[SpanSpectrum]:
        """Add a block; the spectra that are complete with it."""
        if not self._waiting:
            self._begun_ns = stamp_ns
        self._waiting.append((stamp_ns, offsets, values))
        if stamp_ns + int(offsets[-1] * NANOSECONDS) - self._begun_ns < _BATCH_NS:
            return []
        times = np.concatenate(
            [stamp + np.rint(after * NANOSECONDS).astype(np.int64) for stamp, after, _ in self._waiting]
        )
        rows = np.concatenate([part for _, _, part in self._waiting]).astype(np.float64)
        self._waiting = []
        finite = np.isfinite(rows).all(axis=1)
        times, rows = times[finite], rows[finite]
        fresh = times > np.maximum.accumulate(np.concatenate([[self._latest_ns], times[:-1]]))[: len(times)]
        if not fresh.any():
            return []
        self._latest_ns = int(times[fresh][-1])
        self._collector.add(times[fresh], rows[fresh] @ matrix.T, _BAND)
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

    def add(
        self, point: str, side: Side, stamp_ns: int, offsets: np.ndarray, values: np.ndarray, matrix: Array
    ) -> list[SpectrumRow]:
        """Add a block of a signal; the rows that are complete with it.

        Parameters
        ----------
        point : str
        side : {"model", "field"}
        stamp_ns : int
        offsets : ndarray (n,)
            Time of each sample after the stamp, s.
        values : ndarray (n, 3)
            As the sensor has them; what is not finite is left out.
        matrix : ndarray (3, 3)
            From these to m/s² in the machine's axes.
        """
        if point not in self._points or not len(offsets):
            return []
        signal = self._signals.setdefault((point, side), _Signal())
        if signal.is_behind(stamp_ns):
            self._signals[point, side] = signal = _Signal()
            self._open, self._closed_ns = {}, -1
        spans = signal.add(stamp_ns, offsets, values, matrix)
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
