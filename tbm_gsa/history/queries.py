"""What can be asked of an open history, whether it was opened to write or only to read."""

import math
import sqlite3
import sys
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Self

import numpy as np

from tbm_gsa.history.baseline import Baseline, ErrorStatistics
from tbm_gsa.history.context import Context, ContextKey
from tbm_gsa.history.entries import (
    AXES,
    SOURCE_KINDS,
    HistoryEntry,
    StateEntry,
    StoredEntry,
    StoredState,
    WatchSource,
    WindowGroup,
    WindowSource,
    machine_condition,
)
from tbm_gsa.history.events import Event, EventSelection, StoredEvent
from tbm_gsa.history.schema import (
    BASELINE_IS_SOUND,
    CONTEXT_IS_SOUND,
    EVENT_IS_SOUND,
    STATE_IS_SOUND,
    USUAL_ERROR_IS_SOUND,
    WATCH_IS_SOUND,
    WINDOW_IS_SOUND,
    HistoryError,
)
from tbm_msgs_py.base.texts import LONGEST_LINE, listed

SOURCE_COLUMNS: Final = "kind, name, digest, machine, machine_sha256"
BASELINE_COLUMNS: Final = "name, machine, machine_sha256, created_ns, since_ns, until_ns, kind"
ENTRY_COLUMNS: Final = ", ".join(field.name for field in fields(HistoryEntry))
WATCH_COLUMNS: Final = ", ".join(field.name for field in fields(WatchSource))
STATE_COLUMNS: Final = ", ".join(field.name for field in fields(StateEntry))
CONTEXT_COLUMNS: Final = ", ".join(field.name for field in fields(Context))
EVENT_COLUMNS: Final = "begin_ns, event, point, severity, verdict, text, level, end_ns, snapshot"
SPREAD_COLUMNS: Final = (
    "sources.id, point, axis, start_ns, length_ns, ifnull(field_rms, 0.0), ifnull(model_rms, 0.0), "
    "ifnull(relative_error, 9e999), ifnull(field_peak, 9e999), ifnull(field_kurtosis, 9e999)"  # infinity is not known
)
_IN_TIME: Final = "windows CROSS JOIN sources ON windows.source = sources.id"  # in this order, by the key of windows
_JOINED: Final = "windows JOIN sources ON windows.source = sources.id"
# Each window with what the site said last before it began.
_WITH_CONTEXT: Final = f"""{_JOINED} LEFT JOIN contexts ON contexts.source = windows.source AND contexts.since_ns =
(SELECT max(since_ns) FROM contexts AS any WHERE any.source = windows.source AND any.since_ns <= windows.start_ns)"""  # noqa: S608
_COLUMNS: Final = [
    ("start_ns", "i8"),
    ("length_ns", "i8"),
    ("field_rms", "f8"),
    ("model_rms", "f8"),
    ("relative_error", "f8"),
]


@dataclass(frozen=True)
class Selection:
    """Which windows are wanted; None leaves that out.

    Attributes
    ----------
    point : str
    since_ns, until_ns : int
        Windows that begin at or after, and before.
    source : str
        One of `SOURCE_KINDS`, or a part of the source's name.
    machine : str
        Its name, or the first digits, eight at least, of its SHA-256.
    axis : str
    """

    point: str | None = None
    since_ns: int | None = None
    until_ns: int | None = None
    source: str | None = None
    machine: str | None = None
    axis: str | None = None

    def condition(self) -> tuple[str, list[str | int]]:
        """Condition in SQL and its values."""
        parts: list[tuple[str, str | int | None]] = [
            ("point = ?", self.point),
            ("start_ns >= ?", self.since_ns),
            ("start_ns < ?", self.until_ns),
            ("kind = ?" if self.source in SOURCE_KINDS else "instr(name, ?) > 0", self.source),
            (machine_condition(self.machine), self.machine),
            ("axis = ?", self.axis),
        ]
        given = [(text, value) for text, value in parts if value is not None]
        return " AND ".join(text for text, _ in given) or "1", [value for _, value in given]


class Queries:
    """An open history; close it or use it as a context manager.

    Parameters
    ----------
    path : Path
    connection : sqlite3.Connection
        To a history of the current schema version.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def windows(self, selection: Selection | None = None, newest: int | None = None) -> list[StoredEntry]:
        """Windows in the order of time, of the newest so many only if a number is given."""
        limit = "" if newest is None else f" LIMIT {int(newest)}"
        return list(self._windows(selection, f"start_ns DESC, point DESC, axis DESC{limit}"))[::-1]

    def all_windows(self, selection: Selection | None = None) -> Iterator[StoredEntry]:
        """Windows in the order of time, one at a time."""
        return self._windows(selection, "start_ns, point, axis")

    def _windows(self, selection: Selection | None, order: str) -> Iterator[StoredEntry]:
        condition, values = self._sound(selection)
        self._refuse(f"contexts WHERE NOT ({CONTEXT_IS_SOUND})", "a context")
        rows = self._connection.execute(
            f"SELECT {SOURCE_COLUMNS}, {CONTEXT_COLUMNS}, {ENTRY_COLUMNS} FROM {_WITH_CONTEXT} "  # noqa: S608
            f"WHERE {condition} ORDER BY {order}",
            values,
        )
        return (_window(*row) for row in rows)

    def check(self, selection: Selection) -> None:
        """Refuse a selection by a name that no window has; known ones that choose nothing together are no mistake.

        Raises
        ------
        HistoryError
            It names those that are there.
        """
        joined = f"FROM {_JOINED}"
        for what, column, chosen, others in (
            ("test point", "point", Selection(point=selection.point), ()),
            ("source", "name", Selection(source=selection.source), SOURCE_KINDS),
            ("machine", "machine || ' ' || substr(machine_sha256, 1, 8)", Selection(machine=selection.machine), ()),
        ):
            condition, values = chosen.condition()
            if not values or values[0] in others:
                continue
            if self._connection.execute(f"SELECT 1 {joined} WHERE {condition} LIMIT 1", values).fetchone() is None:
                names = [name for (name,) in self._connection.execute(f"SELECT DISTINCT {column} {joined} ORDER BY 1")]
                raise HistoryError(f"{self.path}: no {what} {values[0]}, there: {listed([*others, *names])}")

    def count(self, selection: Selection | None = None) -> int:
        """Count the entries of a selection."""
        condition, values = (selection or Selection()).condition()
        query = f"SELECT COUNT(*) FROM {_JOINED} WHERE {condition}"  # noqa: S608
        return int(self._connection.execute(query, values).fetchone()[0])

    def span(self, selection: Selection) -> tuple[int, int] | None:
        """Begins of the first and the last window of a selection, ns; None without any."""
        condition, values = self._sound(selection)
        query = f"SELECT MIN(start_ns), MAX(start_ns) FROM {_JOINED} WHERE {condition}"  # noqa: S608
        first, last = self._connection.execute(query, values).fetchone()
        return None if first is None else (int(first), int(last))

    def groups(
        self, columns: Sequence[str], selection: Selection | None = None, by: ContextKey | None = None
    ) -> Iterator[WindowGroup]:
        """Windows that have these columns in common, which begin with point and axis; one group is read at a time.

        With `by` also this of their context, which is the last of the key, as text: empty where it is not known.
        """
        condition, values = self._sound(selection)
        chosen = f"FROM {_WITH_CONTEXT if by else _JOINED} WHERE {condition}"
        names = ", ".join([*columns, f"ifnull(CAST({by} AS TEXT), '')"] if by else columns)
        order = ", ".join([*columns, f"min({by})"] if by else columns)
        keys = self._connection.execute(f"SELECT {names} {chosen} GROUP BY {names} ORDER BY {order}", values).fetchall()
        same = f"({names}) = ({', '.join('?' * (len(columns) + bool(by)))})"
        levels = "ifnull(field_rms, 0.0), ifnull(model_rms, 0.0)"
        numbers = f"start_ns, length_ns, {levels}, ifnull(relative_error, 9e999)"  # infinity is not known
        for key in keys:
            rows = self._connection.execute(f"SELECT {numbers} {chosen} AND {same} ORDER BY start_ns", [*values, *key])
            read = np.fromiter(rows, dtype=_COLUMNS)
            if read.size:  # not discarded meanwhile
                yield WindowGroup(key, *(read[name] for name, _ in _COLUMNS))

    def sources(self) -> dict[int, WindowSource]:
        """All sources by their number."""
        rows = self._connection.execute(f"SELECT id, {SOURCE_COLUMNS} FROM sources")  # noqa: S608
        return {number: _source(*row) for number, *row in rows}

    def ends(self, selection: Selection) -> tuple[int, int] | None:
        """Begins of the first and the last window of a selection, found without reading those between."""
        condition, values = selection.condition()
        query = f"SELECT start_ns FROM {_IN_TIME} WHERE {condition} ORDER BY start_ns {{}} LIMIT 1"  # noqa: S608
        first, last = (self._connection.execute(query.format(order), values).fetchone() for order in ("ASC", "DESC"))
        if first is None or last is None:
            return None
        return self._time(first[0]), self._time(last[0])

    def stretch(
        self, begin_ns: int, end_ns: int, selection: Selection, by: ContextKey | None, most: int, moments: int
    ) -> tuple[list[tuple[Any, ...]], bool]:
        """Windows that begin in a stretch of time: all, or of more than `most` those of moments spread over it.

        A moment is as long as the longest of the first windows. Columns as `SPREAD_COLUMNS`, the context and whether
        the row is sound; and whether these are all.
        """
        condition, values = selection.condition()
        if by:
            self._refuse(f"contexts WHERE NOT ({CONTEXT_IS_SOUND})", "a context")
        span = f"{_WITH_CONTEXT if by else _IN_TIME} WHERE {condition} AND start_ns >= ? AND start_ns < ?"
        group = f"ifnull(CAST({by} AS TEXT), '')" if by else "''"
        columns = f"{SPREAD_COLUMNS}, {group}, {WINDOW_IS_SOUND}"
        read = f"SELECT {columns} FROM {span} ORDER BY start_ns"  # noqa: S608
        counted = f"SELECT count(*), max(length_ns) FROM (SELECT length_ns FROM {span} LIMIT ?)"  # noqa: S608
        ask = self._connection.execute
        count, longest = ask(counted, [*values, begin_ns, end_ns, most + 1]).fetchone()
        if count <= most:
            spans = [(begin_ns, end_ns)]
        else:
            length = max(1, self._time(longest))
            step = max(length, -(-(end_ns - begin_ns) // moments))
            spans = [(at, min(at + length, end_ns)) for at in range(begin_ns, end_ns, step)]
        rows = [row for ends in spans for row in ask(read, [*values, *ends])]
        if not all(row[-1] for row in rows):
            raise self._no_row_of_ours("a window")
        return rows, count <= most

    def _time(self, value: object) -> int:
        """Time of a window as this program writes it."""
        if not isinstance(value, int) or abs(value) > 1 << 62:
            raise self._no_row_of_ours("a window")
        return value

    def ask(self, query: str, selection: Selection, before: Sequence[int] = ()) -> Iterator[tuple[Any, ...]]:
        """Rows of a query in SQL that has a place ``{condition}`` for a selection, after values of its own."""
        condition, values = self._sound(selection)
        yield from self._connection.execute(query.format(condition=condition), [*before, *values])

    def _sound(self, selection: Selection | None) -> tuple[str, list[str | int]]:
        """Condition of a selection and its values; a HistoryError where a window is none that this program wrote."""
        condition, values = (selection or Selection()).condition()
        self._refuse(f"{_JOINED} WHERE ({condition}) AND NOT ({WINDOW_IS_SOUND})", "a window", values)
        return condition, values

    def _refuse(self, found: str, what: str, values: Sequence[str | int] = ()) -> None:
        """Refuse rows of other types than this program writes: SQLite takes any."""
        if self._connection.execute(f"SELECT 1 FROM {found} LIMIT 1", values).fetchone():  # noqa: S608
            raise self._no_row_of_ours(what)

    def _no_row_of_ours(self, what: str) -> HistoryError:
        return HistoryError(
            f"{self.path}: {what} that is not one of tbm_monitor, allowed: texts of up to {LONGEST_LINE} "
            f"characters, axes {', '.join(AXES)}, whole times, numbers"
        )

    def baselines(self) -> list[Baseline]:
        """All baselines, the oldest first."""
        self._refuse(f"baselines WHERE NOT ({BASELINE_IS_SOUND})", "a baseline")
        self._refuse(f"usual_errors WHERE NOT ({USUAL_ERROR_IS_SOUND})", "a baseline")
        rows = self._connection.execute(
            f"SELECT {BASELINE_COLUMNS} FROM baselines ORDER BY created_ns, name, machine"  # noqa: S608
        ).fetchall()
        return [Baseline(*(*row[:6], self._usual(*row[:2]), row[6])) for row in rows]

    def baseline(self, name: str, machine: str | None = None) -> Baseline:
        """Find a baseline by its name and machine; the machine may be left out where only one has that name.

        Raises
        ------
        HistoryError
            There is none, or several machines have one.
        """
        found = self.baselines()
        named = {baseline.machine: baseline for baseline in found if baseline.name == name}
        if not named:
            there = listed(baseline.name for baseline in found)
            raise HistoryError(f"{self.path}: no baseline {name}, there: {there}")
        if machine is None and len(named) > 1:
            raise HistoryError(f"baseline {name}: of several machines: {listed(named)}; choose by --machine")
        if machine is not None and machine not in named:
            raise HistoryError(f"baseline {name}: of machine {listed(named)}, allowed: one of {machine}")
        return named[next(iter(named)) if machine is None else machine]

    def watches(self) -> list[WatchSource]:
        """All watches for a change of a machine, the oldest first."""
        self._refuse(f"watches WHERE NOT ({WATCH_IS_SOUND})", "a watch")
        rows = self._connection.execute(f"SELECT {WATCH_COLUMNS} FROM watches ORDER BY id")  # noqa: S608
        return [WatchSource(*row) for row in rows]

    def spans(self, watch: WatchSource) -> list[tuple[int, bytes]]:
        """Begin and band powers of every span that a watch is resumed from, in the order of time."""
        chosen = f"watch IN (SELECT id FROM watches WHERE ({WATCH_COLUMNS}) = (?, ?, ?, ?, ?, ?, ?, ?, ?))"  # noqa: S608
        self._refuse(f"spans WHERE {chosen} AND typeof(log_powers) <> 'blob'", "a span", astuple(watch))
        query = f"SELECT start_ns, log_powers FROM spans WHERE {chosen} ORDER BY start_ns"  # noqa: S608
        return self._connection.execute(query, astuple(watch)).fetchall()

    def states(self) -> list[StoredState]:
        """Return what every watch said last, the newest last."""
        self._refuse(f"watches WHERE NOT ({WATCH_IS_SOUND})", "a watch")
        last = "(SELECT max(start_ns) FROM states AS other WHERE other.watch = id)"
        newest = f"watches CROSS JOIN states ON watch = id AND start_ns = {last}"  # in this order, by their keys
        self._refuse(f"{newest} WHERE NOT ({STATE_IS_SOUND})", "a state")
        rows = self._connection.execute(
            f"SELECT {WATCH_COLUMNS}, start_ns, {STATE_COLUMNS} FROM {newest} ORDER BY start_ns, watch, part, name"  # noqa: S608
        )
        count = len(fields(WatchSource))
        return [StoredState(WatchSource(*row[:count]), row[count], _state(*row[count + 1 :])) for row in rows]

    def events(self, selection: EventSelection | None = None, newest: int | None = None) -> list[StoredEvent]:
        """Events in the order of their begin, the newest so many only if a number is given."""
        condition, values = (selection or EventSelection()).condition()
        return self._events(condition, values, newest)

    def state(self) -> int:
        """Return a number that changes when another program writes."""
        return int(self._connection.execute("PRAGMA data_version").fetchone()[0])

    def event(self, number: int) -> StoredEvent:
        """Find an event by its number; a HistoryError where there is none."""
        for found in self._events("number = ?", [number], None):
            return found
        span = self._connection.execute("SELECT min(number), max(number) FROM events").fetchone()
        there = "none" if span[0] is None else f"{span[0]} to {span[1]}"
        raise HistoryError(f"{self.path}: no event {number}, there: {there}")

    def _events(self, condition: str, values: Sequence[str | int], newest: int | None) -> list[StoredEvent]:
        joined = f"events JOIN sources ON events.source = sources.id WHERE {condition}"
        self._refuse(f"{joined} AND NOT ({EVENT_IS_SOUND})", "an event", values)
        limit = "" if newest is None else f" LIMIT {int(newest)}"
        rows = self._connection.execute(
            f"SELECT number, {SOURCE_COLUMNS}, {EVENT_COLUMNS}, {CONTEXT_COLUMNS}, "  # noqa: S608
            f"acknowledged_by, acknowledged_ns, comment FROM {joined} ORDER BY begin_ns DESC, number DESC{limit}",
            values,
        )
        return [_event(*row) for row in rows][::-1]

    def _usual(self, name: str, machine: str) -> dict[tuple[str, str], ErrorStatistics]:
        rows = self._connection.execute(
            "SELECT point, axis, mean, scatter, windows, log_mean, log_scatter FROM usual_errors "
            "WHERE (machine, baseline) = (?, ?) ORDER BY point, axis",
            (machine, name),
        )
        return {(point, axis): ErrorStatistics(*values) for point, axis, *values in rows}


def _window(*row: Any) -> StoredEntry:
    """Entry with source and context from a row of SQLite, which keeps NaN as NULL."""
    numbers: list[Any] = [math.nan if value is None else value for value in row[11:]]
    entry = HistoryEntry(sys.intern(row[9]), sys.intern(row[10]), *numbers)
    return StoredEntry(_source(*row[:5]), entry, _context(*row[5:9]))


def _event(number: int, *row: Any) -> StoredEvent:
    said: list[Any] = [*row[5:14], _context(*row[14:18])]
    return StoredEvent(number, _source(*row[:5]), Event(*said), *row[18:])


def _state(part: Any, name: str, *row: Any) -> StateEntry:
    value, low, high, probability = (math.nan if number is None else number for number in row[:4])
    return StateEntry(part, name, value, low, high, probability, *row[4:])


@lru_cache(maxsize=256)
def _source(*row: Any) -> WindowSource:
    """Source from its columns; many windows share one."""
    return WindowSource(*row)


@lru_cache(maxsize=256)
def _context(*row: Any) -> Context:
    """Context from its columns; many windows share one."""
    return Context(*row)
