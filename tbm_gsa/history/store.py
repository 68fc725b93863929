"""The SQLite file of the history: a node and the command line share it (WAL), its schema has a version."""

import math
import os
import sqlite3
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any, Final, Self

from tbm_gsa.errors import InputError
from tbm_gsa.history.baseline import Baseline, Usual
from tbm_gsa.history.entries import Entry, Source, Window

SCHEMA_VERSION: Final = 2
APPLICATION_ID: Final = 0x54424D48  # "TBMH"
WAIT_S: Final = 5.0  # for another writer
_SOURCE: Final = "kind, name, digest, machine, machine_sha256"
_ENTRY: Final = ", ".join(field.name for field in fields(Entry))
_ROW: Final = ", ".join("?" * (1 + len(fields(Entry))))  # with its source
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
CREATE TABLE baselines (
    name TEXT PRIMARY KEY,
    machine TEXT NOT NULL,
    machine_sha256 TEXT NOT NULL,
    created_ns INTEGER NOT NULL,
    since_ns INTEGER NOT NULL,
    until_ns INTEGER NOT NULL
) WITHOUT ROWID;
CREATE TABLE usual_errors (
    baseline TEXT NOT NULL REFERENCES baselines (name) ON DELETE CASCADE,
    point TEXT NOT NULL,
    axis TEXT NOT NULL,
    mean REAL NOT NULL,
    scatter REAL NOT NULL,
    windows INTEGER NOT NULL,
    PRIMARY KEY (baseline, point, axis)
) WITHOUT ROWID;
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {SCHEMA_VERSION};
"""
_FROM_VERSION_1: Final = f"""
ALTER TABLE windows ADD COLUMN field_peak REAL;
ALTER TABLE windows ADD COLUMN field_kurtosis REAL;
PRAGMA user_version = {SCHEMA_VERSION};
"""


class HistoryError(InputError):
    """A file that is no history, or one that cannot be used; one line."""


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
        No file, no history, of a newer version, or not to be written.
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
        elif version == 1:
            self._run(_FROM_VERSION_1)
        elif version != SCHEMA_VERSION:
            ask("ROLLBACK")
            raise HistoryError(f"{self.path}: schema version {version}, allowed: 1 to {SCHEMA_VERSION}")
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

    def store_baseline(self, baseline: Baseline) -> None:
        """Store a baseline, replacing the one of its name."""
        with self._transaction() as ask:
            ask("DELETE FROM baselines WHERE name = ?", (baseline.name,))
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
                ask("INSERT INTO usual_errors VALUES (?, ?, ?, ?, ?, ?)", (baseline.name, point, axis, *astuple(usual)))

    def baselines(self) -> list[Baseline]:
        """All baselines, the oldest first."""
        rows = self._connection.execute("SELECT * FROM baselines ORDER BY created_ns, name").fetchall()
        return [Baseline(*(*row, self._usual(row[0]))) for row in rows]

    def baseline(self, name: str) -> Baseline:
        """Find a baseline by its name."""
        found = {baseline.name: baseline for baseline in self.baselines()}
        if name not in found:
            raise HistoryError(f"{self.path}: no baseline {name}, there: {', '.join(found) or 'none'}")
        return found[name]

    def _usual(self, name: str) -> dict[tuple[str, str], Usual]:
        rows = self._connection.execute(
            "SELECT point, axis, mean, scatter, windows FROM usual_errors WHERE baseline = ? ORDER BY point, axis",
            (name,),
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
    entry: list[Any] = [math.nan if value is None else value for value in row[5:]]
    return Window(Source(*row[:5]), Entry(*entry))
