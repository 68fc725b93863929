"""MDF 4 files of measuring systems: channels by name, each with the times of its group."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from datetime import UTC
from pathlib import Path
from typing import Any

import numpy as np

from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.importing.description import TimeBase, to_ns
from tbm_msgs_py.importing.measurement_file import MeasurementFile, Rows, library


class MdfFile(MeasurementFile):
    """An MDF file; the channels of one test point share their times."""

    kind = "an MDF"
    shared_rows = False
    clocks = ("file",)

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        asammdf: Any = library("asammdf")
        asammdf.console.setLevel(logging.CRITICAL)  # what it says goes into the result; it would print it too
        with self.reading():
            self._file = asammdf.MDF(path)

    @property
    def start_ns(self) -> int:
        """Start of the measurement."""
        with self.reading():
            return to_ns(self._file.start_time.astimezone(UTC))

    def unit(self, column: str) -> str:
        """Return the unit that the file states."""
        return str(self._signal(column).unit)

    def _pieces(self, columns: Sequence[str], time: TimeBase) -> Iterator[Rows]:
        signals = [self._signal(column) for column in columns]
        times = signals[0].timestamps
        for column, signal in zip(columns, signals, strict=True):
            if not np.array_equal(signal.timestamps, times):
                raise self.error(f"channels {columns[0]} and {column} have different times, allowed: the same")
            invalid = signal.invalidation_bits
            if invalid is not None and np.any(invalid):
                place = f"{self.row(int(np.flatnonzero(np.asarray(invalid))[0]))}, column {column}"
                raise self.error(f"{place}: marked as invalid, allowed: samples that the file calls valid")
        ticks = (lambda rows: times[rows] * NANOSECONDS) if time else None
        return self.in_pieces(columns, [signal.samples for signal in signals], ticks=ticks)

    def _signal(self, column: str) -> Any:
        places = self._file.channels_db.get(column, ())
        if not places:
            raise self.no_column(column, sorted(self._file.channels_db))
        if len(places) > 1:
            raise self.error(f"channel {column} is in {len(places)} groups, allowed: a name that occurs once")
        with self.reading():
            # Ignored, the marks come with the samples; heeded, the library would drop what they mark and say nothing.
            return self._file.get(column, ignore_invalidation_bits=True)
