"""CSV files, read a piece at a time: every row has the cells of the header, every cell asked for is a number."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import IO, Final, NoReturn

import numpy as np

from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.texts import LONGEST_NAME, quoted, shortened
from tbm_msgs_py.importing.description import CsvLayout, TimeBase, TimeColumn, to_ns
from tbm_msgs_py.importing.measurement_file import PIECE_ROWS, MeasurementFile, Rows, nanoseconds

_LONGEST_LINE: Final = 1 << 20  # characters

# Parsed apart: float64 would round them.
_EXACT: dict[str, Callable[[str], int]] = {"ns": int, "datetime": lambda text: to_ns(_moment(text))}


class CsvFile(MeasurementFile):
    """A CSV file with a line of column names.

    Parameters
    ----------
    path : Path
        File.
    layout : CsvLayout
        Delimiter, decimal sign, lines.
    """

    kind = "a CSV"
    clocks = ("column", "datetime")

    def __init__(self, path: Path, layout: CsvLayout) -> None:
        super().__init__(path)
        self._layout = layout
        try:
            with path.open(encoding=layout.encoding, newline="") as file:
                line = next(islice(self._lines_of(file), layout.header - 1, None), None)
        except (UnicodeError, LookupError) as error:
            raise self.error(f"encoding {layout.encoding}: {error}, allowed: that of the file") from error
        if line is None or not line.strip():
            raise self.error(f"line {layout.header}: empty, allowed: the column names")
        self.columns = [name.strip() for name in self._cells(line, f"line {layout.header}")]

    def row(self, index: int) -> str:
        """Name of a row for a message."""
        return f"line {self._layout.first_line + index}"

    def _pieces(self, columns: Sequence[str], time: TimeBase) -> Iterator[Rows]:
        wanted = [self._index(column) for column in columns]
        clock = self._index(time.column) if isinstance(time, TimeColumn) else None
        first = 0
        for lines in self._lines():
            self._check_width(lines, first)
            times = None
            if isinstance(time, TimeColumn) and clock is not None:
                times = self._times(lines, clock, time, first)
            yield Rows(self._numbers(lines, wanted, first), times)
            first += len(lines)
        if first == 0:
            raise self.error(f"no row after line {self._layout.header}, allowed: at least one")

    def _lines(self) -> Iterator[list[str]]:
        """Lines of rows, some at a time; empty lines may only follow the last row."""
        layout = self._layout
        with self.path.open(encoding=layout.encoding, newline="") as file:
            rows = islice(self._lines_of(file), layout.first_line - 1, None)
            try:
                while lines := list(islice(rows, PIECE_ROWS)):
                    ended = len(lines) < PIECE_ROWS
                    while ended and lines and not lines[-1].strip():
                        lines.pop()
                    if lines:
                        yield lines
            except UnicodeError as error:
                raise self.error(f"encoding {layout.encoding}: {error}, allowed: that of the file") from error

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
            if line.count(delimiter) + 1 != expected or '"' in line:
                row = self.row(first + index)
                cells = self._cells(line, row)
                if len(cells) != expected:
                    raise self.error(f"{row}: {len(cells)} cells, allowed: the {expected} of the header")

    def _numbers(self, lines: list[str], wanted: Sequence[int], first: int) -> Array:
        """Columns of some lines, (n, k)."""
        layout = self._layout
        text = [line.replace(",", ".") for line in lines] if layout.decimal == "," else lines
        try:
            values = np.loadtxt(
                text, np.float64, comments=None, delimiter=layout.delimiter, quotechar='"', usecols=wanted, ndmin=2
            )
        except ValueError:
            self._refuse(text, wanted, first)
        if len(values) != len(lines) or not np.isfinite(values).all():
            self._refuse(text, wanted, first)
        return values

    def _refuse(self, lines: Sequence[str], wanted: Sequence[int], first: int) -> NoReturn:
        """Raise an error that names the cell that is no number."""
        for index, line in enumerate(lines):
            row = self.row(first + index)
            cells = self._cells(line, row)
            for column in wanted:
                if not _is_number(cells[column]):
                    raise self.error(
                        f"{row}, column {shortened(self.columns[column], LONGEST_NAME)}: "
                        f"{quoted(cells[column].strip())}, allowed: a finite number"
                    )
        raise self.error(f"{self.row(first)} and after: not rows of numbers, allowed: finite numbers")

    def _times(self, lines: list[str], column: int, time: TimeColumn, first: int) -> Integers:
        exact = _EXACT.get(time.unit)
        if exact is None:
            return nanoseconds(self._numbers(lines, [column], first)[:, 0], time.unit)
        times = np.empty(len(lines), np.int64)
        for index, line in enumerate(lines):
            row = self.row(first + index)
            cell = self._cells(line, row)[column].strip()
            try:
                times[index] = exact(cell)
            except (ValueError, OverflowError) as error:
                allowed = "a whole number of ns" if time.unit == "ns" else "ISO 8601 with its zone"
                raise self.error(f"{row}, column {time.column}: {quoted(cell)}, allowed: {allowed}") from error
        return times

    def _index(self, column: str) -> int:
        if column not in self.columns:
            raise self.no_column(column, self.columns)
        if self.columns.count(column) > 1:
            raise self.error(f"column {column} occurs twice in the header, allowed: once")
        return self.columns.index(column)

    def _cells(self, line: str, place: str) -> list[str]:
        """Cells of the line at a place."""
        try:
            return next(csv.reader([line], delimiter=self._layout.delimiter), [])
        except csv.Error as error:
            raise self.error(f"{place}: {error}, allowed: cells of a CSV file") from error


def _is_number(cell: str) -> bool:
    try:
        return "_" not in cell and bool(np.isfinite(float(cell)))
    except ValueError:
        return False


def _moment(text: str) -> datetime:
    moment = datetime.fromisoformat(text)
    if moment.tzinfo is None:
        raise ValueError("no zone")
    return moment
