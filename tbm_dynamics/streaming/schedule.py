"""An operating point that changes with time: a table, or the columns of a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tbm_msgs_py.base.errors import MachineError
from tbm_msgs_py.base.files import LARGEST_TABLE, read_text
from tbm_msgs_py.base.operating_point import OperatingPoint, OperatingPointError
from tbm_msgs_py.base.texts import doubled, listed, number_reader, quoted
from tbm_msgs_py.base.units import R_MIN

COLUMNS: Final = {"time": "time_s", "speed": "speed_r_min", "torque": "torque_kn_m", "thrust": "thrust_kn"}
"""Column that each quantity is read from unless the caller names another; units are always these."""

_PLAIN: Final = number_reader()
_TO_SI: Final = {"time": 1.0, "speed": R_MIN, "torque": 1e3, "thrust": 1e3}


@dataclass(frozen=True, eq=False)
class Schedule:
    """Operating points over time, linear in between and held before the first and after the last.

    Attributes
    ----------
    time : (n,) array_like
        Stream time, s, increasing.
    speed, torque, thrust : (n,) array_like
        rad/s, N·m, N.
    places : tuple of str
        Names of the rows in error messages, e.g. ``cycle.csv: line 7``; ``schedule: row 1`` … by default.

    Raises
    ------
    MachineError
        Columns of different lengths, numbers that are not finite, times that do not increase.
    """

    time: ArrayLike
    speed: ArrayLike
    torque: ArrayLike
    thrust: ArrayLike
    places: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        columns = {name: np.asarray(getattr(self, name), dtype=float) for name in COLUMNS}
        shapes = {values.shape for values in columns.values()}
        (shape, *others) = shapes
        if others or len(shape) != 1 or shape[0] == 0:
            raise MachineError("schedule: time, speed, torque and thrust must be of one shape (n,), n at least 1")
        places = self.places or tuple(f"schedule: row {row}" for row in range(1, shape[0] + 1))
        for name, values in columns.items():
            if not np.isfinite(values).all():
                raise MachineError(f"{places[int(np.isfinite(values).argmin())]}: {name} is no finite number")
            object.__setattr__(self, name, values)
        late = np.flatnonzero(np.diff(columns["time"]) <= 0.0)
        if late.size:
            row = int(late[0]) + 1
            raise MachineError(f"{places[row]}: time {columns['time'][row]:g} s, allowed is later than the row before")
        object.__setattr__(self, "places", places)

    def at(self, time: float) -> OperatingPoint:
        """Operating point at a stream time in s."""
        columns = (np.asarray(values, dtype=float) for values in (self.time, self.speed, self.torque, self.thrust))
        times, *values = columns
        return OperatingPoint(*(float(np.interp(time, times, column)) for column in values))

    def rows(self) -> Iterator[tuple[str, OperatingPoint]]:
        """Name in messages and operating point of each row, in order."""
        table: NDArray[np.float64] = np.array([self.speed, self.torque, self.thrust]).T
        for place, row in zip(self.places, table, strict=True):
            try:
                yield place, OperatingPoint(*map(float, row))
            except OperatingPointError as error:
                raise MachineError(f"{place}: {error}") from None


def read_schedule(
    path: str | Path, columns: Mapping[str, str] | None = None, where: Mapping[str, str] | None = None
) -> Schedule:
    """Read a schedule from a CSV file with a header; its first row is the start of the stream.

    Parameters
    ----------
    path : str or Path
    columns : mapping of str to str, optional
        Column of ``time`` (s), ``speed`` (r/min), ``torque`` (kN·m) or ``thrust`` (kN), where it is not that of
        `COLUMNS`.
    where : mapping of str to str, optional
        Only rows whose cell in a column is this text.

    Raises
    ------
    MachineError
        A file that cannot be read, a column that is not there, or a cell that is missing or no number: line and column.
    """
    chosen = {**COLUMNS, **(columns or {})}
    if unknown := sorted(set(chosen) - set(COLUMNS)):
        raise MachineError(f"columns: {unknown[0]}: allowed are {', '.join(COLUMNS)}")
    if Path(path).exists() and not Path(path).is_file():
        raise MachineError(f"{path}: no regular file, allowed: a CSV file")
    try:
        lines = read_text(Path(path), "utf-8-sig", LARGEST_TABLE).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "no UTF-8 text"
        raise MachineError(f"{path}: {reason}, allowed: a CSV file") from None
    try:
        return _schedule(path, lines, chosen, where or {})
    except csv.Error as error:  # a cell of more than 131 072 characters
        raise MachineError(f"{path}: {error}, allowed: a CSV file") from None


def _schedule(path: str | Path, lines: Iterable[str], chosen: Mapping[str, str], where: Mapping[str, str]) -> Schedule:
    """Schedule of the chosen columns, in SI units, of the rows whose cells are those of `where`."""
    rows = csv.DictReader(lines)
    header = [name.strip() for name in rows.fieldnames or ()]
    rows.fieldnames = header
    wanted_columns = (*chosen.values(), *where)
    for name in wanted_columns:
        if name not in header:
            # Nothing is quoted of a file without any of them: over ROS anybody may name it.
            there = f", there are {listed(header)}" if set(header) & set(wanted_columns) else ""
            allowed = ", allowed: names in the first line, commas between them, and decimal points"
            raise MachineError(f"{path}: line 1: no column {name!r}{there or allowed}")
    if twice := doubled(name for name in header if name in wanted_columns):
        raise MachineError(f"{path}: line 1: column {twice!r} stands twice, allowed: once")
    chosen_rows = [
        (f"{path}: line {rows.line_num}", row)
        for row in rows
        if all((row[name] or "").strip() == text for name, text in where.items())
    ]
    for place, row in chosen_rows:
        if None in row:  # a decimal comma, say: the cells behind it stand under the wrong names
            raise MachineError(f"{place}: more cells than the {len(header)} of the header, allowed: one a column")
    if not chosen_rows:
        wanted = " and ".join(f"{name} = {text!r}" for name, text in where.items())
        raise MachineError(f"{path}: no row{f' with {wanted}' if wanted else ''}")
    table = {
        key: np.array([_number(place, column, row[column]) for place, row in chosen_rows]) * _TO_SI[key]
        for key, column in chosen.items()
    }
    table["time"] -= table["time"][0]
    return Schedule(**table, places=tuple(place for place, _ in chosen_rows))


def pairs(name: str, given: Iterable[str]) -> dict[str, str]:
    """Read texts of the form ``key=value``, as of parameters and options.

    Raises
    ------
    MachineError
        A text without an equals sign, or a key given twice; the message begins with `name`.
    """
    values = {}
    for text in given:
        key, sign, value = text.partition("=")
        if not sign:
            raise MachineError(f"{name}: {quoted(text)}, allowed is key=value")
        if key.strip() in values:
            raise MachineError(f"{name}: {quoted(key.strip())} twice, allowed: each once")
        values[key.strip()] = value.strip()
    return values


def _number(place: str, column: str, cell: str | None) -> float:
    value = _PLAIN(cell or "")
    if value is None:
        given = quoted(cell) if cell and cell.strip() else "empty"
        raise MachineError(f"{place}, column {column}: {given}, allowed is a finite number")
    return value
