"""WAV files: channels ``1``, ``2`` ... as shares of full scale, at the rate of the file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.importing.description import TimeColumn
from tbm_msgs_py.importing.extra import library, reading
from tbm_msgs_py.importing.source import PIECE_ROWS, Piece, no_column, require_finite


class WavFile:
    """A WAV file of whole numbers or floats; its channels are numbered from 1."""

    shared_rows = True
    start_ns = None
    full_scale = True

    def __init__(self, path: Path) -> None:
        self.path = path
        wavfile: Any = library("scipy.io.wavfile")
        with reading(path, "a WAV"):
            self._rate, data = wavfile.read(path)
            self._data = data[:, None] if data.ndim == 1 else data
        self._zero, self._full = _scale(data.dtype)

    def row(self, index: int) -> str:
        """Name a row for a message."""
        return f"sample {index + 1}"

    def unit(self, column: str) -> str:  # noqa: ARG002
        """Give no unit: a WAV file states none."""
        return ""

    def pieces(self, columns: Sequence[str], time: TimeColumn | str | None) -> Iterator[Piece]:
        """Rows of these channels, see `Source`."""
        if isinstance(time, TimeColumn):
            raise RecordingError(f"{self.path}: time: a column, allowed: `file`, the rate of the WAV file, or a rate")
        there = [str(k + 1) for k in range(self._data.shape[1])]
        for column in columns:
            if column not in there:
                no_column(self.path, column, there)
        chosen = [there.index(column) for column in columns]
        for first in range(0, len(self._data), PIECE_ROWS):
            rows = self._data[first : first + PIECE_ROWS, chosen]
            values = (rows.astype(np.float64) - self._zero) / self._full
            require_finite(self.path, columns, values, first)
            ticks = np.arange(first, first + len(values)) * (NANOSECONDS / self._rate)
            yield Piece(values, np.rint(ticks).astype(np.int64) if time else None)


def _scale(dtype: np.dtype[Any]) -> tuple[float, float]:
    """Give the reading of no signal, and how far full scale is from it: 24 bits come left-aligned in 32."""
    if dtype.kind == "f":
        return 0.0, 1.0
    half = float(2 ** (8 * dtype.itemsize - 1))
    return (half if dtype.kind == "u" else 0.0), half
