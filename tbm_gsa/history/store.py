"""The SQLite file of the history: a node and the command line share it (WAL), its schema has a version."""

import math
import os
import sqlite3
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Self

import numpy as np

from tbm_gsa.errors import InputError
from tbm_gsa.history.baseline import Baseline, Usual
from tbm_gsa.history.entries import Entry, Group, Source, Window

SCHEMA_VERSION: Final = 3
APPLICATION_ID: Final = 0x54424D48  # "TBMH"
WAIT_S: Final = 5.0  # for another writer
_SOURCE: Final = "kind, name, digest, machine, machine_sha256"
_ENTRY: Final = ", ".join(field.name for field in fields(Entry))
_ROW: Final = ", ".join("?" * (1 + len(fields(Entry))))  # with its source
_COLUMNS: Final = [("start_ns", "i8"), ("length_ns", "i8"), ("field_rms", "f8"), ("relative_error", "f8")]
_NAMED: Final = "baselines WHERE (machine, name) = (?, ?)"
_BASELINES: Final = """
CREATE TABLE baselines (
    name TEXT NOT NULL,
    machine TEXT NOT NULL,
    machine_sha256 TEXT NOT NULL,
    created_ns INTEGER NOT NULL,
    since_ns INTEGER NOT NULL,
    until_ns INTEGER NOT NULL,
    PRIMARY KEY (machine, name)
) WITHOUT ROWID;
CREATE TABLE usual_errors (
    machine TEXT NOT NULL,
    baseline TEXT NOT NULL,
    point TEXT NOT NULL,
    axis TEXT NOT NULL,
    mean REAL NOT NULL,
    scatter REAL NOT NULL,
    windows INTEGER NOT NULL,
    PRIMARY KEY (machine, baseline, point, axis),
    FOREIGN KEY (machine, baseline) REFERENCES baselines (machine, name) ON DELETE CASCADE
) WITHOUT ROWID;
"""
_SCHEMA: Final = f"""
CREATE TABLE sources (
    id INTEGER PRIMARY KEY,
    kind TEXT NOT NULL CHECK (kind IN ('live', 'offline')),
    name TEXT NOT NULL,
    digest TEXT NOT NULL,
    machine TEXT NOT NULL,
    machine_sha256 TEXT NOT NULL,
    UNIQUE (kind, name, digest, machine, machine_sha256)
);
CREATE TABLE windows (
    source INTEGER NOT NULL REFERENCES sources (id),
    point TEXT NOT NULL,
    axis TEXT NOT NULL,
    start_ns INTEGER NOT NULL,
    length_ns INTEGER NOT NULL,
    field_rms REAL,
    model_rms REAL,
    relative_error REAL,
    coverage REAL NOT NULL,
    field_peak REAL,
    field_kurtosis REAL,
    PRIMARY KEY (start_ns, source, point, axis, length_ns)
) WITHOUT ROWID;
{_BASELINES}
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {SCHEMA_VERSION};
"""
_UPDATES: Final = {  # from the version to the next one
    1: """
ALTER TABLE windows ADD COLUMN field_peak REAL;
ALTER TABLE windows ADD COLUMN field_kurtosis REAL;
PRAGMA user_version = 2;
""",
    2: f"""
ALTER TABLE usual_errors RENAME TO old_errors;
ALTER TABLE baselines RENAME TO old_baselines;
{_BASELINES}
INSERT INTO baselines SELECT * FROM old_baselines;
INSERT INTO usual_errors
    SELECT machine, baseline, point, axis, mean, scatter, windows FROM old_errors JOIN old_baselines ON baseline = name;
DROP TABLE old_errors;
DROP TABLE old_baselines;
PRAGMA user_version = 3;
""",  # noqa: S608
}


class HistoryError(InputError):
    """A file that is no history, or one that cannot be used; one line."""


class HistoryLockedError(HistoryError):
    """A history that another program holds locked; it may be tried again."""


@dataclass(frozen=True)
class Selection:
    """Which windows are wanted; None leaves that out.

    Attributes
    ----------
    point : str
    since_ns, until_ns : int
        Windows that begin at or after, and before.
    source : str
        ``live``, ``offline``, or a part of the source's name.
    machine : str
    """

    point: str | None = None
    since_ns: int | None = None
    until_ns: int | None = None
    source: str | None = None
    machine: str | None = None

    def condition(self) -> tuple[str, list[str | int]]:
        """Give the condition in SQL and its values."""
        parts: list[tuple[str, str | int | None]] = [
            ("point = ?", self.point),
            ("start_ns >= ?", self.since_ns),
            ("start_ns < ?", self.until_ns),
            ("kind = ?" if self.source in ("live", "offline") else "instr(name, ?) > 0", self.source),
            ("machine = ?", self.machine),
        ]
        given = [(text, value) for text, value in parts if value is not None]
        return " AND ".join(text for text, _ in given) or "1", [value for _, value in given]


def default_history() -> Path:
    """``$TBM_HISTORY``, else ``tbm_monitor/history.sqlite`` in the user's data folder (``$XDG_DATA_HOME``)."""
    named = os.environ.get("TBM_HISTORY")
    if named:
        return Path(named)
    data = os.environ.get("XDG_DATA_HOME")
    try:
        return (Path(data) if data else Path.home() / ".local" / "share") / "tbm_monitor" / "history.sqlite"
    except RuntimeError:
        raise HistoryError("no home folder for the history, allowed: a file in TBM_HISTORY") from None


class History:
    """An open history; close it or use it as a context manager.

    Parameters
    ----------
    path : Path
    create : bool
        Make the file, and its folder, if it is not there.
    wait_s : float
        Longest wait for another writer, s.

    Raises
    ------
    HistoryError
        No file, no history, of a newer version, or not to be written; `HistoryLockedError` while another one writes.
    """

    def __init__(self, path: Path, *, create: bool = True, wait_s: float = WAIT_S) -> None:
        if not create and not path.is_file():
            raise HistoryError(f"{path}: no such history; `compare` and the analysis node write one")
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._connection = sqlite3.connect(path, timeout=wait_s, isolation_level=None)
        except (OSError, sqlite3.Error) as error:
            raise HistoryError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
        try:
            self._prepare()
        except sqlite3.DatabaseError as error:
            self._connection.close()
            if getattr(error, "sqlite_errorcode", 0) & 0xFF in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
                raise HistoryLockedError(f"{path}: {error}") from None
            raise HistoryError(f"{path}: not a history of tbm_monitor that can be used ({error})") from None
        except HistoryError:
            self._connection.close()
            raise

    def _prepare(self) -> None:
        """Check what is in the file, write the schema into an empty one, bring an older one up to date."""
        ask = self._connection.execute
        ask("PRAGMA foreign_keys = ON")
        ask("BEGIN IMMEDIATE")  # one of several that find an empty or older file writes the schema
        application, version = self._pragma("application_id"), self._pragma("user_version")
        if application == 0 and ask("SELECT COUNT(*) FROM sqlite_master").fetchone()[0] == 0:
            self._run(_SCHEMA)
        elif application != APPLICATION_ID:
            ask("ROLLBACK")
            raise HistoryError(f"{self.path}: a database of something else, allowed: a history of tbm_monitor")
        elif not 1 <= version <= SCHEMA_VERSION:
            ask("ROLLBACK")
            raise HistoryError(f"{self.path}: schema version {version}, allowed: 1 to {SCHEMA_VERSION}")
        else:
            for older in range(version, SCHEMA_VERSION):
                self._run(_UPDATES[older])
        ask("COMMIT")
        ask("PRAGMA journal_mode = WAL")
        ask("PRAGMA synchronous = NORMAL")

    def _run(self, script: str) -> None:
        """Run statements within the transaction that is open; `executescript` would commit it first."""
        for statement in filter(str.strip, script.split(";")):
            self._connection.execute(statement)

    def _pragma(self, name: str) -> int:
        return int(self._connection.execute(f"PRAGMA {name}").fetchone()[0])

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add(self, source: Source, entries: Iterable[Entry]) -> int:
        """Commit windows of a source at once, replacing those it had for the same time; the number of entries."""
        with self._transaction() as ask:
            described = astuple(source)
            ask(f"INSERT OR IGNORE INTO sources ({_SOURCE}) VALUES (?, ?, ?, ?, ?)", described)  # noqa: S608
            number = ask(f"SELECT id FROM sources WHERE ({_SOURCE}) = (?, ?, ?, ?, ?)", described).fetchone()[0]  # noqa: S608
            count = 0
            for entry in entries:
                ask(f"INSERT OR REPLACE INTO windows (source, {_ENTRY}) VALUES ({_ROW})", (number, *astuple(entry)))  # noqa: S608
                count += 1
        return count

    def windows(self, selection: Selection | None = None, newest: int | None = None) -> list[Window]:
        """Windows in the order of time, of the newest so many only if a number is given."""
        condition, values = (selection or Selection()).condition()
        limit = "" if newest is None else f" LIMIT {int(newest)}"
        rows = self._connection.execute(
            f"SELECT {_SOURCE}, {_ENTRY} FROM windows JOIN sources ON source = id WHERE {condition} "  # noqa: S608
            f"ORDER BY start_ns DESC, point DESC, axis DESC{limit}",
            values,
        )
        return [_window(*row) for row in rows][::-1]

    def count(self, selection: Selection | None = None) -> int:
        """Count the entries of a selection."""
        condition, values = (selection or Selection()).condition()
        query = f"SELECT COUNT(*) FROM windows JOIN sources ON source = id WHERE {condition}"  # noqa: S608
        return int(self._connection.execute(query, values).fetchone()[0])

    def groups(self, columns: Sequence[str], selection: Selection | None = None) -> Iterator[Group]:
        """Windows that have these columns in common, which begin with point and axis; one group is read at a time."""
        condition, values = (selection or Selection()).condition()
        chosen = f"FROM windows JOIN sources ON source = id WHERE {condition}"
        names = ", ".join(columns)
        same = f"({names}) = ({', '.join('?' * len(columns))})"
        numbers = "start_ns, length_ns, ifnull(field_rms, 0.0), ifnull(relative_error, 9e999)"  # infinity is not known
        for key in sorted(self._connection.execute(f"SELECT DISTINCT {names} {chosen}", values)):
            rows = self._connection.execute(f"SELECT {numbers} {chosen} AND {same} ORDER BY start_ns", [*values, *key])
            read = np.fromiter(rows, dtype=_COLUMNS)
            if read.size:  # not discarded meanwhile
                yield Group(key, *(read[name] for name, _ in _COLUMNS))

    def discard(self, node: str, since_ns: int, until_ns: int, most: int) -> int:
        """Delete what a node wrote among the first so many windows that begin in a span of time.

        Returns
        -------
        int
            Begin of the span that is left, ns; `until_ns` at its end.
        """
        with self._transaction() as ask:
            span = "FROM windows WHERE start_ns >= ? AND start_ns < ?"
            query = f"SELECT start_ns {span} ORDER BY start_ns LIMIT 1 OFFSET ?"
            beyond = ask(query, (since_ns, until_ns, most)).fetchone()
            end = max(beyond[0], since_ns + 1) if beyond else until_ns
            own = "SELECT id FROM sources WHERE kind = 'live' AND name = ?"
            ask(f"DELETE {span} AND source IN ({own})", (since_ns, end, node))
        return end

    def store_baseline(self, baseline: Baseline, *, replace: bool = False) -> None:
        """Store a baseline; one of its machine and name is replaced only if that is asked for.

        Raises
        ------
        HistoryError
            There is one already.
        """
        key = (baseline.machine, baseline.name)
        with self._transaction() as ask:
            there = ask(f"SELECT created_ns FROM {_NAMED}", key).fetchone()  # noqa: S608
            if there and not replace:
                raise HistoryError(
                    f"baseline {baseline.name}: there is one of {baseline.machine} already, "
                    "allowed: another name, or --replace"
                )
            ask(f"DELETE FROM {_NAMED}", key)  # noqa: S608
            ask(
                "INSERT INTO baselines VALUES (?, ?, ?, ?, ?, ?)",
                (
                    baseline.name,
                    baseline.machine,
                    baseline.machine_sha256,
                    baseline.created_ns,
                    baseline.since_ns,
                    baseline.until_ns,
                ),
            )
            for (point, axis), usual in baseline.usual.items():
                row = (baseline.machine, baseline.name, point, axis, *astuple(usual))
                ask("INSERT INTO usual_errors VALUES (?, ?, ?, ?, ?, ?, ?)", row)

    def delete_baseline(self, name: str, machine: str | None = None) -> Baseline:
        """Delete a baseline, found as `baseline` finds it, and give what it was."""
        with self._transaction() as ask:
            found = self.baseline(name, machine)
            ask(f"DELETE FROM {_NAMED}", (found.machine, name))  # noqa: S608
        return found

    def baselines(self) -> list[Baseline]:
        """All baselines, the oldest first."""
        rows = self._connection.execute("SELECT * FROM baselines ORDER BY created_ns, name, machine").fetchall()
        return [Baseline(*(*row, self._usual(*row[:2]))) for row in rows]

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
            there = ", ".join(dict.fromkeys(baseline.name for baseline in found))
            raise HistoryError(f"{self.path}: no baseline {name}, there: {there or 'none'}")
        if machine is None and len(named) > 1:
            raise HistoryError(f"baseline {name}: of several machines: {', '.join(named)}; choose by --machine")
        if machine is not None and machine not in named:
            raise HistoryError(f"baseline {name}: of machine {', '.join(named)}, allowed: one of {machine}")
        return named[next(iter(named)) if machine is None else machine]

    def _usual(self, name: str, machine: str) -> dict[tuple[str, str], Usual]:
        rows = self._connection.execute(
            "SELECT point, axis, mean, scatter, windows FROM usual_errors "
            "WHERE (machine, baseline) = (?, ?) ORDER BY point, axis",
            (machine, name),
        )
        return {(point, axis): Usual(*values) for point, axis, *values in rows}

    @contextmanager
    def _transaction(self) -> Iterator[Callable[..., sqlite3.Cursor]]:
        """Commit at the end, roll back on an error."""
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield self._connection.execute
        except BaseException:
            self._connection.execute("ROLLBACK")
            raise
        self._connection.execute("COMMIT")


def _window(*row: Any) -> Window:
    """Window from a row; SQLite keeps NaN as NULL."""
    entry: list[Any] = [math.nan if value is None else value for value in row[7:]]
    return Window(_source(*row[:5]), Entry(sys.intern(row[5]), sys.intern(row[6]), *entry))


@lru_cache(maxsize=256)
def _source(*row: Any) -> Source:
    """Source from its columns; many windows share one."""
    return Source(*row)
