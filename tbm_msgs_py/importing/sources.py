"""The files of an import: which column is in which of them, and their rows with stamps, of one file or of several."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import numpy as np

from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.texts import listed
from tbm_msgs_py.importing.csv_file import CsvFile
from tbm_msgs_py.importing.description import Description, same_unit
from tbm_msgs_py.importing.layout import FileLayout, TimeColumn
from tbm_msgs_py.importing.matlab_file import MatlabFile
from tbm_msgs_py.importing.mdf_file import MdfFile
from tbm_msgs_py.importing.measurement_file import MeasurementFile
from tbm_msgs_py.importing.tdms_file import TdmsFile
from tbm_msgs_py.importing.timing import RowTimes
from tbm_msgs_py.importing.wav_file import WavFile

_FORMATS: dict[str, type[CsvFile | TdmsFile | MdfFile | WavFile | MatlabFile]] = {
    ".csv": CsvFile,
    ".txt": CsvFile,
    ".tdms": TdmsFile,
    ".mf4": MdfFile,
    ".wav": WavFile,
    ".mat": MatlabFile,
}


@dataclass(frozen=True)
class _Source:
    """One file and how it is read."""

    file: MeasurementFile
    layout: FileLayout

    def clock(self) -> RowTimes:
        """Time of its rows."""
        layout, start_ns = self.layout, self.layout.start_ns
        if layout.start == "file":
            if self.file.start_ns is None:
                raise self.file.error("start: file: the file states no moment, allowed: a date and time with its zone")
            start_ns = self.file.start_ns
        gap = layout.time.restart_gap if isinstance(layout.time, TimeColumn) else None
        return RowTimes(self.file, start_ns, layout.rate, gap)


class StampedRows:
    """Rows of columns, whose files have the same times, with the stamps of the rows; to be gone through once.

    Attributes
    ----------
    columns : list of str
        In the order of the values.
    clock : RowTimes
        Time of the rows.
    """

    def __init__(self, parts: Sequence[tuple[_Source, dict[str, str]]]) -> None:
        self._parts = parts
        self._clocks = [source.clock() for source, _ in parts]
        self._first = 0
        self.columns = [column for _, names in parts for column in names]
        self.clock = self._clocks[0]

    def __iter__(self) -> Iterator[tuple[Integers, Array]]:
        """Stamps (n,), ns since the epoch, and values (n, k) of some rows after the other."""
        file = self._parts[0][0].file
        for pieces in zip_longest(*map(self._of_part, range(len(self._parts)))):
            stamps = next(piece[0] for piece in pieces if piece is not None)
            for (source, _), piece in zip(self._parts, pieces, strict=True):
                if piece is None or not np.array_equal(piece[0], stamps):
                    raise source.file.error(
                        f"its samples are not at the times of those of {file.path.name}, from {file.row(self._first)} "
                        "or soon after, allowed: axes of a point with the same start, rate and length"
                    )
            yield stamps, np.hstack([piece[1] for piece in pieces])
            self._first += len(stamps)

    def place(self, row: int) -> str:
        """File and name of a row of those that came last."""
        file = self._parts[0][0].file
        return f"{file.path}: {file.row(self._first + row)}"

    def _of_part(self, index: int) -> Iterator[tuple[Integers, Array]]:
        (source, names), clock = self._parts[index], self._clocks[index]
        for piece in source.file.pieces(list(names.values()), source.layout.time):
            yield clock.stamps(piece.times_ns, len(piece.values)), piece.values


class Sources:
    """Open files; a column of one of several is called ``FILE:COLUMN``.

    Raises
    ------
    RecordingError
        A file that cannot be read, or that is named and not used.
    """

    def __init__(self, paths: Sequence[Path], description: Description) -> None:
        self._description = description
        names = [path.name for path in paths]
        for name in names:
            if names.count(name) > 1:
                raise RecordingError(f"{name}: given {names.count(name)} times, allowed: files of different names")
        for name in description.files:
            if name not in names:
                raise RecordingError(f"files.{name}: no such file is given, allowed: {listed(names)}")
        self._sources = {path.name: _opened(path, description) for path in paths}
        if "csv" in description.model_fields_set and not any(
            isinstance(s.file, CsvFile) for s in self._sources.values()
        ):
            raise RecordingError(f"{', '.join(names)}: csv is stated, allowed: for CSV files")
        used = {name for entry in description.streams.values() for name in self._split(entry.columns)}
        for name in names:
            if name not in used:
                raise RecordingError(f"{name}: no column of it is asked for, allowed: files that are used")

    def groups(self) -> list[list[str]]:
        """Names of the streams that are read together, as they share their rows; those without columns are in none."""
        groups: dict[tuple[str, ...], list[str]] = {}
        for name, entry in self._description.streams.items():
            files = tuple(self._split(entry.columns))
            shared = len(files) == 1 and self._sources[files[0]].file.shared_rows
            if files:
                groups.setdefault(files if shared else (*files, name), []).append(name)
        return list(groups.values())

    def rows(self, columns: Sequence[str]) -> StampedRows:
        """Rows of some columns; those of several files must be at the same times."""
        return StampedRows([(self._sources[file], names) for file, names in self._split(columns).items()])

    def check_units(self) -> list[str]:
        """Refuse a missing full scale; warnings where a file states another unit than the user."""
        warnings = []
        for stream, entry in self._description.streams.items():
            for file, names in self._split(entry.columns).items():
                source = self._sources[file].file
                point = self._description.points.get(stream)
                if source.full_scale and point and point.full_scale is None:
                    raise source.error(
                        f"points.{stream}.full_scale: missing, allowed: what full scale is in {point.units}"
                    )
                for column, unit in zip(entry.columns, entry.stated_units, strict=True):
                    if column is None or column not in names:
                        continue
                    label = source.unit(names[column]).strip()
                    if label and not same_unit(label, unit):
                        warnings.append(
                            f"{source.path}: column {names[column]}: the file says {label}, the description {unit}"
                        )
        return warnings

    def _split(self, columns: Sequence[str | None]) -> dict[str, dict[str, str]]:
        """Columns of each file: what the file calls them, by what the description does."""
        split: dict[str, dict[str, str]] = {}
        several = len(self._sources) > 1
        for column in (column for column in columns if column):
            file = next((name for name in self._sources if not several or column.startswith(f"{name}:")), None)
            if file is None:
                each = listed(f"{name}:COLUMN" for name in self._sources)
                raise RecordingError(f"column {column}: of none of the files, allowed: {each}")
            split.setdefault(file, {})[column] = column.removeprefix(f"{file}:") if several else column
        return split


def _opened(path: Path, description: Description) -> _Source:
    format_ = _FORMATS.get(path.suffix.lower())
    if format_ is None:
        raise RecordingError(f"{path}: suffix {path.suffix or 'missing'}, allowed: {', '.join(_FORMATS)}")
    if not path.is_file():
        raise RecordingError(f"{path}: no such file, allowed: a file of measurements")
    try:
        layout = description.layout(path.name)
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    try:
        return _Source(format_(path, layout), layout)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}), allowed: a file of measurements") from None
