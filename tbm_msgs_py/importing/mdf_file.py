"""MDF 4 files of measuring systems: channels by name, each with the times of its group."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

import numpy as np

from tbm_msgs_py.base.texts import listed, quoted
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.importing.layout import FileLayout, TimeBase
from tbm_msgs_py.importing.measurement_file import MeasurementFile, Rows, library

_LOCAL_TIME: Final = 1  # flag of the header
_ALL_INVALID: Final = 1  # flag of a channel
_OF_TIME: Final = 1  # kind of a master channel
_FORMULA: Final = 3  # kind of a conversion
_PROBE: Final = np.array([0.5, 2.0, -3.0])


class MdfFile(MeasurementFile):
    """An MDF file; the channels of one test point share their times."""

    kind = "an MDF"
    shared_rows = False
    clocks = ("file",)

    def __init__(self, path: Path, layout: FileLayout) -> None:
        super().__init__(path, layout)
        asammdf: Any = library("asammdf")
        asammdf.console.setLevel(logging.CRITICAL)  # what it says goes into the result; it would print it too
        with self.reading():
            self._file = asammdf.MDF(path)
        if not str(self._file.version).startswith("4"):
            raise self.error(f"MDF {self._file.version}, allowed: MDF 4")

    @property
    def start_ns(self) -> int:
        """Start of the measurement."""
        header = self._file.header
        since = int(header.abs_time)
        if not header.time_flags & _LOCAL_TIME:
            return since
        seconds, part = divmod(since, NANOSECONDS)
        with self.reading():
            clock = (datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds)).replace(tzinfo=None)
        return self.local_start(clock) + part

    def unit(self, column: str) -> str:
        """Return the unit that the file states."""
        return str(self._signal(column).unit)

    def _pieces(self, columns: Sequence[str], time: TimeBase) -> Iterator[Rows]:
        signals = [self._signal(column) for column in columns]
        times = signals[0].timestamps
        for column, signal in zip(columns, signals, strict=True):
            if not np.array_equal(signal.timestamps, times, equal_nan=True):
                raise self.error(f"channels {columns[0]} and {column} have different times, allowed: the same")
            self._check_marks(column, signal)
            self._check_formula(column)
        if time:
            self._check_clock(columns[0])
        elif len(times) > 1 and (step := float(np.median(np.diff(times)))) > 0.0:
            self.compare_rate(1.0 / step, columns[0])
        ticks = (lambda rows: times[rows] * NANOSECONDS) if time else None
        return self.in_pieces(columns, [signal.samples for signal in signals], ticks=ticks)

    def _check_marks(self, column: str, signal: Any) -> None:
        """Refuse samples that the file itself does not believe."""
        group, index = self._place(column)
        bits = signal.invalidation_bits
        invalid = np.zeros(len(signal), bool) if bits is None else np.asarray(bits, bool)
        if self._file.groups[group].channels[index].flags & _ALL_INVALID:
            invalid = np.ones(len(signal), bool)
        if invalid.any():
            place = f"{self.row(int(np.argmax(invalid)))}, column {column}"
            raise self.error(f"{place}: marked as invalid, allowed: samples that the file calls valid")

    def _check_formula(self, column: str) -> None:
        """Refuse a formula that asammdf cannot evaluate: it would give the raw counts and say nothing."""
        group, index = self._place(column)
        conversions = [self._file.groups[group].channels[index].conversion]
        for conversion in conversions:  # those that it refers to are added
            if not hasattr(conversion, "convert"):
                continue
            conversions += (conversion.referenced_blocks or {}).values()
            formula = conversion.formula if conversion.conversion_type == _FORMULA else ""
            if formula and np.array_equal(conversion.convert(_PROBE.copy()), _PROBE):
                try:
                    library("numexpr").evaluate(formula.replace("X1", "X"), {"X": _PROBE})
                except Exception as error:
                    raise self.error(
                        f"channel {column}: its formula {quoted(formula)} cannot be evaluated, allowed: one of X1"
                    ) from error

    def _check_clock(self, column: str) -> None:
        """Refuse a group whose master is none, or an angle or a distance."""
        group, _ = self._place(column)
        own = self._file.groups[group].channel_group
        if (remote := getattr(own, "cg_master_index", None)) is not None:
            group = remote
        master = self._file.masters_db.get(group)
        if master is None or self._file.groups[group].channels[master].sync_type != _OF_TIME:
            raise self.error(f"time: file: the group of channel {column} has no times, allowed: a rate")

    def _signal(self, column: str) -> Any:
        group, index = self._place(column)
        with self.reading():
            # Ignored, the marks come with the samples; heeded, the library would drop what they mark and say nothing.
            return self._file.get(group=group, index=index, ignore_invalidation_bits=True)

    def _place(self, column: str) -> tuple[int, int]:
        """Group and channel of a name, or of ``group/channel`` with the name or the number of the group."""
        known = self._file.channels_db
        group, _, name = column.rpartition("/")
        places = known.get(column) or [
            place for place in known.get(name, ()) if group in (str(place[0]), self._group_name(place[0]))
        ]
        if not places:
            raise self.no_column(column, sorted(known))
        if len(places) > 1:
            each = listed(f"{place[0]}/{column if column in known else name}" for place in places)
            raise self.error(f"channel {column} is in {len(places)} groups, allowed: {each}, or the group's name")
        return places[0][0], places[0][1]

    def _group_name(self, group: int) -> str:
        return str(getattr(self._file.groups[group].channel_group, "acq_name", "") or "")
