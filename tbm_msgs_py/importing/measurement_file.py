"""An opened file of measurements as the import sees it, and what the formats have in common."""

from __future__ import annotations

import logging
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.texts import listed, quoted
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.importing.layout import FileLayout, TimeBase, TimeColumn
from tbm_msgs_py.importing.moments import local_ns

PIECE_ROWS = 50_000  # read at a time; a multiple of the samples of a block
_EXTRA = "import"
_IGNORED = (DeprecationWarning, PendingDeprecationWarning, FutureWarning, ResourceWarning, ImportWarning)
_LIBRARIES = ("nptdms", "asammdf", "canmatrix")
_FAR_NS = 2**62
_SAME_RATE = 1e-3  # of the rate: clocks of real systems are better
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


@dataclass(frozen=True)
class Rows:
    """Some rows of a file.

    Attributes
    ----------
    values : ndarray (n, k)
        Columns asked for, finite.
    times_ns : ndarray (n,) or None
        Time of each row, ns after the start; None where the rate gives it.
    """

    values: Array
    times_ns: Integers | None


class ColumnValues(Protocol):
    """Values of a column, read when a slice of them is asked for."""

    def __len__(self) -> int: ...
    def __getitem__(self, rows: slice, /) -> NDArray[np.generic]: ...


class MeasurementFile(ABC):
    """A file that is open for reading.

    Attributes
    ----------
    path : Path
    zone : tzinfo or None
        Where the clocks stood that showed times without a zone, as the user states it.
    rate : float or None
        Sample rate, Hz, as the user states it.
    kind : str
        Its format with an article, for messages.
    row_name : str
        What a row is called in messages.
    shared_rows : bool
        All columns have the same rows; else each has its own time base and length.
    full_scale : bool
        Readings are shares of a full scale that only the user knows.
    clocks : collection of str
        Where times may come from: the ``file`` itself, a ``column`` of numbers, or one of ``datetime``.
    """

    kind: ClassVar[str]
    row_name: ClassVar[str] = "sample"
    shared_rows: ClassVar[bool] = True
    full_scale: ClassVar[bool] = False
    clocks: ClassVar[Collection[str]]

    def __init__(self, path: Path, layout: FileLayout) -> None:
        self.path = path
        self.zone = layout.zone
        self.rate = layout.rate

    @property
    def start_ns(self) -> int | None:
        """Moment of time 0 that the file states."""
        return None

    def local_start(self, clock: datetime) -> int:
        """Moment, ns, of a start that the file states without a zone: never in that of this computer."""
        try:
            return local_ns(clock, self.zone)
        except ValueError as error:
            raise self.error(f"start: file: {clock} {error}") from None

    def pieces(self, columns: Sequence[str], time: TimeBase) -> Iterator[Rows]:
        """Rows of these columns in their order, with the time that is asked for.

        Raises
        ------
        RecordingError
            A column is not there or not of numbers, a value is missing: which row and column.
        """
        if time == "file" and "file" not in self.clocks:
            raise self.error(f"time: file: {self.kind} file states no time, allowed: a time column or a rate")
        if isinstance(time, TimeColumn):
            if "column" not in self.clocks:
                raise self.error("time: a column, allowed: `file`, the times of the file, or a rate")
            if time.unit == "datetime" and "datetime" not in self.clocks:
                raise self.error(f"time: unit datetime, allowed: s, ms, us or ns in {self.kind} file")
        return self._pieces(columns, time)

    @abstractmethod
    def _pieces(self, columns: Sequence[str], time: TimeBase) -> Iterator[Rows]: ...

    def row(self, index: int) -> str:
        """Name of a row for a message: `line 17`."""
        return f"{self.row_name} {index + 1}"

    def unit(self, column: str) -> str:  # noqa: ARG002
        """Return the unit that the file states for a column, empty when it states none."""
        return ""

    def error(self, problem: str) -> RecordingError:
        """Error of one line that names the file."""
        return RecordingError(f"{self.path}: {problem}")

    def warn(self, problem: str) -> None:
        """Say what of the file the user should look at."""
        warnings.warn(f"{self.path}: {problem}", stacklevel=2)

    def compare_rate(self, own: float, column: str) -> None:
        """Warn where the file states another rate, Hz, than the user, who is believed."""
        if self.rate is not None and abs(own / self.rate - 1.0) > _SAME_RATE:
            self.warn(f"column {column}: the file says {own:g} Hz, the description {self.rate:g}")

    def no_column(self, column: str, there: Sequence[str], hint: str = "") -> RecordingError:
        """Error of a column that the file does not have, and what may be the reason."""
        return self.error(f"column {column} is not there, allowed: {listed(there)}{hint}")

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Turn what a library raises into one line; on a damaged file they raise errors of any kind."""
        try:
            yield
        except RecordingError:
            raise
        except Exception as error:
            why = " ".join(str(error).split()) or type(error).__name__
            raise self.error(
                f"not {self.kind} file that can be read ({why}), allowed: one that is not damaged"
            ) from error

    def in_pieces(
        self,
        columns: Sequence[str],
        arrays: Sequence[ColumnValues],
        time: TimeColumn | None = None,
        ticks: Callable[[Integers], NDArray[np.floating[Any]]] | None = None,
    ) -> Iterator[Rows]:
        """Pieces of whole columns; refuses what is no number.

        Parameters
        ----------
        columns : sequence of str
        arrays : sequence of ColumnValues
            Values of the columns and, behind them, of a time column.
        time : TimeColumn, optional
            What the last array is, unless it is a column.
        ticks : callable, optional
            Time, ns, of rows by their numbers.
        """
        names = [*columns, *([time.column] if time else [])]
        lengths = {len(array) for array in arrays}
        if len(lengths) > 1:
            counts = ", ".join(f"{name} {len(array)}" for name, array in zip(names, arrays, strict=True))
            raise self.error(f"{self.row_name}s of the columns: {counts}; allowed: columns of the same length")
        if not max(lengths):
            raise self.error(f"columns {', '.join(names)}: no {self.row_name}, allowed: at least one")
        for first in range(0, max(lengths), PIECE_ROWS):
            with self.reading():
                rows = [np.asarray(array[slice(first, first + PIECE_ROWS)]) for array in arrays]
            for name, found in zip(names, rows, strict=True):
                self._check_numbers(name, found, first)
            values = np.column_stack(rows).astype(np.float64)
            finite = np.isfinite(values)
            if not finite.all():
                row, column = np.argwhere(~finite)[0]
                place = f"{self.row(first + row)}, column {names[column]}"
                raise self.error(f"{place}: {values[row, column]}, allowed: a finite number")
            times = nanoseconds(rows[-1], time.unit) if time else None
            if ticks:
                times = whole_ns(ticks(np.arange(first, first + len(values))))
            yield Rows(values[:, : len(columns)], times)

    def _check_numbers(self, name: str, found: NDArray[np.generic], first: int) -> None:
        """Refuse what is no column of real numbers, with its first text where it is one of texts."""
        if found.ndim == 1 and found.dtype.kind in "SUO" and len(found):
            text = found[0].decode("latin-1") if isinstance(found[0], bytes) else str(found[0])
            raise self.error(f"{self.row(first)}, column {name}: {quoted(text)}, allowed: a number")
        if found.dtype.kind == "M":
            raise self.error(
                f"column {name}: dates, allowed: numbers; of time s, ms, us or ns after the start, or a rate"
            )
        if found.ndim != 1 or found.dtype.kind not in "iuf":
            kind = f"{found.ndim} dimensions of {found.dtype}"
            raise self.error(f"column {name}: {kind}, allowed: real numbers, one a row")


def nanoseconds(values: NDArray[np.generic], unit: str) -> Integers:
    """Time in ns of numbers in ``s``, ``ms``, ``us`` or ``ns``; whole numbers of ns stay exact."""
    if unit == "ns" and values.dtype.kind in "iu":
        return np.asarray(np.clip(values, -_FAR_NS if values.dtype.kind == "i" else 0, _FAR_NS), np.int64)
    return whole_ns(np.asarray(values, np.float64) * (_SECONDS[unit] * NANOSECONDS))


def whole_ns(times: NDArray[np.floating[Any]]) -> Integers:
    """Round times in ns; those that int64 cannot hold, or that are none, become one that ROS does not have either."""
    held: Integers = np.rint(np.clip(np.nan_to_num(times, nan=_FAR_NS), -_FAR_NS, _FAR_NS)).astype(np.int64)
    return held


def library(name: str) -> ModuleType:
    """Import a library by name; where it is missing, say in one line what installs it."""
    try:
        return import_module(name)
    except ImportError as error:
        raise RecordingError(
            f"{name.partition('.')[0]} is not installed ({error}), allowed: a format that does not need it, "
            f"or this one after pip install 'tbm_monitor[{_EXTRA}]'"
        ) from error


@contextmanager
def library_warnings(paths: Sequence[str]) -> Iterator[list[str]]:
    """Collect what is warned of, such as a file that ends too early, instead of printing it.

    Libraries do not name the file: it is one of those that are read.
    """
    texts: list[str] = []
    listener = _WarningCollector(texts)
    logging.getLogger().addHandler(listener)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            yield texts
            texts += [str(warning.message) for warning in caught if not issubclass(warning.category, _IGNORED)]
            lines = dict.fromkeys(" ".join(text.split()) for text in texts)
            named, label = tuple(f"{' '.join(path.split())}: " for path in paths), ", ".join(paths)
            texts[:] = [line if line.startswith(named) else f"{label}: {line}" for line in lines]
    finally:
        logging.getLogger().removeHandler(listener)


class _WarningCollector(logging.Handler):
    def __init__(self, texts: list[str]) -> None:
        super().__init__(logging.WARNING)
        self._texts = texts

    def emit(self, record: logging.LogRecord) -> None:
        """Add what one of the libraries logs."""
        if record.name.partition(".")[0] in _LIBRARIES:
            self._texts.append(record.getMessage())
