"""MDF 4 files of measuring systems: channels by name, each with the times of its group."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from datetime import UTC
from pathlib import Path
from typing import Any

import numpy as np

from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.importing.description import TimeColumn, to_ns
from tbm_msgs_py.importing.extra import library, reading
from tbm_msgs_py.importing.source import Piece, array_pieces, nanoseconds, no_column


class MdfFile:
    """An MDF file; the channels of one test point share their times."""

    shared_rows = False
    full_scale = False

    def __init__(self, path: Path) -> None:
        self.path = path
        asammdf: Any = library("asammdf")
        asammdf.console.setLevel(logging.CRITICAL)  # what it says goes into the result; it would print it too
        with reading(path, "an MDF"):
            self._file = asammdf.MDF(path)

    @property
    def start_ns(self) -> int:
        """Start of the measurement."""
        with reading(self.path, "an MDF"):
            return to_ns(self._file.start_time.astimezone(UTC))

    def row(self, index: int) -> str:
        """Name a row for a message."""
        return f"sample {index + 1}"

    def unit(self, column: str) -> str:
        """Give the unit that the file states."""
        return str(self._signal(column).unit)

    def pieces(self, columns: Sequence[str], time: TimeColumn | str | None) -> Iterator[Piece]:
        """Rows of these channels, see `Source`."""
        if isinstance(time, TimeColumn):
            raise RecordingError(f"{self.path}: time: a column, allowed: `file`, the times of the channels, or a rate")
        signals = [self._signal(column) for column in columns]
        times = signals[0].timestamps
        for column, signal in zip(columns, signals, strict=True):
            if not np.array_equal(signal.timestamps, times):
                raise RecordingError(
                    f"{self.path}: channels {columns[0]} and {column} have different times, allowed: the same"
                )
            invalid = signal.invalidation_bits
            if invalid is not None and np.any(invalid):
                row = int(np.flatnonzero(np.asarray(invalid))[0])
                raise RecordingError(
                    f"{self.path}: {self.row(row)}, column {column}: marked as invalid, "
                    "allowed: samples that the file calls valid"
                )
        stamps = nanoseconds(times, "s") if time else None
        yield from array_pieces(self.path, columns, [signal.samples for signal in signals], stamps)

    def _signal(self, column: str) -> Any:
        places = self._file.channels_db.get(column, ())
        if not places:
            no_column(self.path, column, sorted(self._file.channels_db))
        if len(places) > 1:
            raise RecordingError(
                f"{self.path}: channel {column} is in {len(places)} groups, allowed: a name that occurs once"
            )
        with reading(self.path, "an MDF"):
            # Ignored, the marks come with the samples; heeded, the library would drop what they mark and say nothing.
            return self._file.get(column, ignore_invalidation_bits=True)
