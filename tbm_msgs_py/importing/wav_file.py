"""WAV files: channels ``1``, ``2`` ... as shares of full scale, at the rate of the file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.importing.description import TimeBase
from tbm_msgs_py.importing.measurement_file import MeasurementFile, Rows, library


@dataclass(frozen=True)
class _Channel:
    """Readings of a channel: that of no signal is `zero`, that of full scale `full` away from it."""

    readings: NDArray[np.generic]
    zero: float
    full: float

    def __len__(self) -> int:
        return len(self.readings)

    def __getitem__(self, rows: slice) -> Array:
        return (self.readings[rows].astype(np.float64) - self.zero) / self.full


class WavFile(MeasurementFile):
    """A WAV file of whole numbers or floats; its channels are numbered from 1."""

    kind = "a WAV"
    full_scale = True
    clocks = ("file",)

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        wavfile: Any = library("scipy.io.wavfile")
        with self.reading():
            self._rate, data = wavfile.read(path)
        self._data = data[:, None] if data.ndim == 1 else data

    def _pieces(self, columns: Sequence[str], time: TimeBase) -> Iterator[Rows]:
        there = [str(k + 1) for k in range(self._data.shape[1])]
        for column in columns:
            if column not in there:
                raise self.no_column(column, there)
        zero, full = _scale(self._data.dtype)
        channels = [_Channel(self._data[:, there.index(column)], zero, full) for column in columns]
        ticks = (lambda rows: rows * (NANOSECONDS / self._rate)) if time else None
        return self.in_pieces(columns, channels, ticks=ticks)


def _scale(dtype: np.dtype[Any]) -> tuple[float, float]:
    """Return the reading of no signal, and how far full scale is from it: 24 bits come left-aligned in 32."""
    if dtype.kind == "f":
        return 0.0, 1.0
    half = float(2 ** (8 * dtype.itemsize - 1))
    return (half if dtype.kind == "u" else 0.0), half
