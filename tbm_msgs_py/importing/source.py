"""What an opened file of measurements is to the import, whatever its format."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, Protocol

import numpy as np
from numpy.typing import NDArray

from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.texts import listed
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.importing.description import TimeColumn

PIECE_ROWS = 50_000  # read at a time; a multiple of the samples of a block
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


@dataclass(frozen=True)
class Piece:
    """Some rows of a file.

    Attributes
    ----------
    values : ndarray (n, k)
        Columns asked for, finite.
    times_ns : ndarray (n,) or None
        Time of each row, ns after the start; None where the rate gives it.
    """

    values: NDArray[np.float64]
    times_ns: NDArray[np.int64] | None


class Source(Protocol):
    """A file that is open for reading."""

    @property
    def shared_rows(self) -> bool:
        """All columns have the same rows; else each has its own time base and length."""
        ...

    @property
    def start_ns(self) -> int | None:
        """Moment of time 0 that the file states."""
        ...

    @property
    def full_scale(self) -> bool:
        """Readings are shares of a full scale that only the user knows."""
        ...

    def pieces(self, columns: Sequence[str], time: TimeColumn | str | None) -> Iterator[Piece]:
        """Rows of these columns in their order, with the time that is asked for.

        Raises
        ------
        RecordingError
            A column is not there or not of numbers, a value is missing: which row and column.
        """
        ...

    def row(self, index: int) -> str:
        """Name a row for a message: `line 17`."""
        ...

    def unit(self, column: str) -> str:
        """Give the unit that the file states for a column; empty when it states none."""
        ...


def array_pieces(
    path: Path, columns: Sequence[str], arrays: Sequence[NDArray[np.generic]], times: NDArray[np.int64] | None
) -> Iterator[Piece]:
    """Pieces of whole columns that are in memory or mapped; refuses what is no number."""
    lengths = {len(array) for array in arrays} | ({len(times)} if times is not None else set())
    if len(lengths) > 1:
        raise RecordingError(
            f"{path}: columns {', '.join(columns)} have {' and '.join(map(str, sorted(lengths)))} rows, "
            "allowed: columns of the same length"
        )
    for column, array in zip(columns, arrays, strict=True):
        if array.ndim != 1 or array.dtype.kind not in "iuf":
            raise RecordingError(
                f"{path}: column {column}: {array.ndim} dimensions of {array.dtype}, allowed: real numbers, one a row"
            )
    for first in range(0, max(lengths), PIECE_ROWS):
        rows = slice(first, first + PIECE_ROWS)
        values = np.column_stack([np.asarray(array[rows], np.float64) for array in arrays])
        require_finite(path, columns, values, first)
        yield Piece(values, None if times is None else times[rows])


def require_finite(path: Path, columns: Sequence[str], values: NDArray[np.float64], first: int) -> None:
    """Refuse a value that is missing or not finite, by its row (counted from 1) and column."""
    finite = np.isfinite(values)
    if not finite.all():
        row, column = np.argwhere(~finite)[0]
        raise RecordingError(
            f"{path}: row {first + row + 1}, column {columns[column]}: {values[row, column]}, allowed: a finite number"
        )


def nanoseconds(values: NDArray[np.generic], unit: str) -> NDArray[np.int64]:
    """Time in ns of numbers in ``s``, ``ms``, ``us`` or ``ns``; whole numbers of ns stay exact."""
    if unit == "ns" and values.dtype.kind in "iu":
        return values.astype(np.int64)
    return np.rint(np.asarray(values, np.float64) * (_SECONDS[unit] * NANOSECONDS)).astype(np.int64)


def no_column(path: Path, column: str, there: Sequence[str]) -> NoReturn:
    """Refuse a column that the file does not have."""
    allowed = listed(there) or "none, the file has no columns"
    raise RecordingError(f"{path}: column {column} is not there, allowed: {allowed}")


def no_time_of_its_own(path: Path, kind: str) -> NoReturn:
    """Refuse `time: file` for a file that states no time."""
    raise RecordingError(f"{path}: time: file: {kind} states no time of its own, allowed: a time column or a rate")
