"""CSV files, read a piece at a time: every row has the cells of the header, every cell asked for is a number."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import IO, Final, NoReturn

import numpy as np

from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.texts import LONGEST_NAME, number_reader, quoted, shortened
from tbm_msgs_py.importing import csv_hints
from tbm_msgs_py.importing.layout import CsvLayout, FileLayout, TimeBase, TimeColumn
from tbm_msgs_py.importing.measurement_file import PIECE_ROWS, MeasurementFile, Rows, nanoseconds
from tbm_msgs_py.importing.moments import moment_ns

_LONGEST_LINE: Final = 1 << 20  # characters
_WHOLE: Final = re.compile(r"[+-]?\d{1,19}", re.ASCII)


class CsvFile(MeasurementFile):
    """A CSV file with a line of column names, or without names: then columns are numbered from 1.

    Parameters
    ----------
    path : Path
        File.
    layout : FileLayout
        Delimiter, decimal sign, lines; zone of dates without one.
    """

    kind = "a CSV"
    clocks = ("column", "datetime")

    def __init__(self, path: Path, layout: FileLayout) -> None:
        super().__init__(path, layout)
        self._layout = layout.csv
        self._number = number_reader(self._layout.decimal, self._layout.thousands)
        number, what = self._layout.header, "the column names"
        if not number:
            number, what = self._layout.first_line, "a row"
        try:
            with path.open(encoding=self._layout.encoding, newline="") as file:
                line = next(islice(self._lines_of(file), number - 1, None), None)
        except (ValueError, LookupError) as error:
            raise self._undecodable(error) from error
        if line is None or not line.strip():
            raise self.error(f"line {number}: empty, allowed: {what}")
        cells = self._cells(line.removeprefix("\ufeff"), f"line {number}")
        self.columns = [name.strip() if self._layout.header else str(k) for k, name in enumerate(cells, start=1)]

    def row(self, index: int) -> str:
        """Name of a row for a message."""
        return f"line {self._layout.first_line + index}"

    def _pieces(self, columns: Sequence[str], time: TimeBase) -> Iterator[Rows]:
        names = [*columns, *([time.column] if isinstance(time, TimeColumn) else [])]
        places = [self._index(name, names) for name in names]
        wanted, clock = places[: len(columns)], places[-1]
        first = 0
        for lines in self._lines():
            self._check_width(lines, first)
            times = None
            if isinstance(time, TimeColumn):
                times = self._times(lines, clock, time, first)
            yield Rows(self._numbers(lines, wanted, first), times)
            first += len(lines)
        if first == 0:
            raise self.error(f"no row after line {self._layout.header}, allowed: at least one")

    def _lines(self) -> Iterator[list[str]]:
        """Lines of rows, some at a time; empty lines may only follow the last row."""
        layout = self._layout
        with self.path.open(encoding=layout.encoding, newline="") as file:
            rows = _without_end(islice(self._lines_of(file), layout.first_line - 1, None))
            try:
                while lines := list(islice(rows, PIECE_ROWS)):
                    yield lines
            except UnicodeError as error:
                raise self._undecodable(error) from error

    def _lines_of(self, file: IO[str]) -> Iterator[str]:
        """Lines of a file; a line that does not end is none of a table."""
        while line := file.readline(_LONGEST_LINE + 1):
            if len(line) > _LONGEST_LINE:
                raise self.error(f"a line of more than {_LONGEST_LINE} characters, allowed: up to that many")
            yield line

    def _check_width(self, lines: Sequence[str], first: int) -> None:
        """Refuse a row whose number of cells is not that of the header: its columns are not where they seem."""
        expected, delimiter = len(self.columns), self._layout.delimiter
        for index, line in enumerate(lines):
            if line.count(delimiter) + 1 != expected or '"' in line or line[0] in "\r\n":
                row = self.row(first + index)
                cells = self._cells(line, row)
                if len(cells) != expected:
                    place = "header" if self._layout.header else "first row"
                    hint = csv_hints.of_width(cells, delimiter) if len(cells) > expected else ""
                    raise self.error(f"{row}: {len(cells)} cells, allowed: the {expected} of the {place}{hint}")

    def _numbers(self, lines: list[str], wanted: Sequence[int], first: int) -> Array:
        """Columns of some lines, (n, k)."""
        layout = self._layout
        if layout.thousands is not None:
            return self._grouped_numbers(lines, wanted, first)
        # What numpy takes for a finite number is just what `number_reader` allows.
        text = [line.replace(".", "x").replace(",", ".") for line in lines] if layout.decimal == "," else lines
        try:
            values = np.loadtxt(
                text, np.float64, comments=None, delimiter=layout.delimiter, quotechar='"', usecols=wanted, ndmin=2
            )
        except ValueError:
            self._refuse(lines, wanted, first)
        if len(values) != len(lines) or not np.isfinite(values).all():
            self._refuse(lines, wanted, first)
        return values

    def _grouped_numbers(self, lines: Sequence[str], wanted: Sequence[int], first: int) -> Array:
        values = np.empty((len(lines), len(wanted)))
        for index, line in enumerate(lines):
            cells = self._cells(line, self.row(first + index))
            numbers = [self._number(cells[column]) for column in wanted]
            if None in numbers:
                self._refuse(lines[index:], wanted, first + index)
            values[index] = numbers
        return values

    def _refuse(self, lines: Sequence[str], wanted: Sequence[int], first: int) -> NoReturn:
        """Raise an error that names the cell that is no number."""
        for index, line in enumerate(lines):
            row = self.row(first + index)
            cells = self._cells(line, row)
            for column in wanted:
                if self._number(cells[column]) is None:
                    hint = csv_hints.of_number(cells[column], self._layout)
                    if not (hint or first or index):
                        hint = csv_hints.of_first_row(lines, column, self._layout)
                    raise self.error(
                        f"{row}, column {shortened(self.columns[column], LONGEST_NAME)}: "
                        f"{quoted(cells[column].strip())}, allowed: a finite number, {_looks(self._layout)}{hint}"
                    )
        raise self.error(f"{self.row(first)} and after: not rows of numbers, allowed: finite numbers")

    def _times(self, lines: list[str], column: int, time: TimeColumn, first: int) -> Integers:
        # Parsed apart: float64 would round them.
        if time.unit not in ("ns", "datetime"):
            return nanoseconds(self._numbers(lines, [column], first)[:, 0], time.unit)
        times = np.empty(len(lines), np.int64)
        for index, line in enumerate(lines):
            row = self.row(first + index)
            cell = self._cells(line, row)[column].strip(" \t\r\n")
            try:
                times[index] = _whole(cell) if time.unit == "ns" else moment_ns(cell, self.zone)
            except OverflowError as error:
                raise self.error(f"{row}, column {time.column}: {quoted(cell)}, allowed: a time of ROS") from error
            except ValueError as error:
                raise self.error(f"{row}, column {time.column}: {quoted(cell)}: {error}") from error
        return times

    def _index(self, column: str, names: Sequence[str]) -> int:
        """Place of a column, one of the names that are asked for."""
        if column not in self.columns:
            raise self.no_column(column, self.columns, csv_hints.of_columns(self.path, names, self._layout))
        if self.columns.count(column) > 1:
            raise self.error(f"column {column} occurs twice in the header, allowed: once")
        return self.columns.index(column)

    def _cells(self, line: str, place: str) -> list[str]:
        """Cells of the line at a place."""
        try:
            return next(csv.reader([line], delimiter=self._layout.delimiter, strict=True), [])
        except csv.Error as error:
            raise self.error(f"{place}: {error}, allowed: cells of a CSV file") from error

    def _undecodable(self, error: Exception) -> Exception:
        hint = csv_hints.of_encoding(self.path, self._layout)
        return self.error(f"encoding {self._layout.encoding}: {error}, allowed: that of the file{hint}")


def _without_end(lines: Iterable[str]) -> Iterator[str]:
    """Lines without the empty ones behind the last row."""
    empty: list[str] = []
    for line in lines:
        if line.strip():
            yield from empty
            empty.clear()
            yield line
        else:
            empty.append(line)


def _looks(layout: CsvLayout) -> str:
    groups = "no thousands signs" if layout.thousands is None else f"{layout.thousands!r} between thousands"
    return f"decimal sign {layout.decimal!r}, {groups}"


def _whole(text: str) -> int:
    if not _WHOLE.fullmatch(text):
        raise ValueError("no whole number, allowed: digits, as ns are")
    return int(text)
