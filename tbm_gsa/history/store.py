"""The SQLite file of the history, opened to write: a node and the command line share it (WAL)."""

import os
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import astuple, fields
from pathlib import Path
from typing import Final

from tbm_gsa.history.baseline import Baseline
from tbm_gsa.history.context import UNKNOWN, Context
from tbm_gsa.history.entries import HistoryEntry, StateEntry, WatchSource, WindowSource
from tbm_gsa.history.events import Event, StoredEvent
from tbm_gsa.history.queries import (
    BASELINE_COLUMNS,
    CONTEXT_COLUMNS,
    ENTRY_COLUMNS,
    EVENT_COLUMNS,
    SOURCE_COLUMNS,
    STATE_COLUMNS,
    WATCH_COLUMNS,
    Queries,
)
from tbm_gsa.history.reader import check_file
from tbm_gsa.history.schema import HistoryError, bring_up_to_date, unusable, version_of, write_ahead
from tbm_msgs_py.base.files import data_folder
from tbm_msgs_py.base.texts import LONGEST_LINE, quoted

WAIT_S: Final = 5.0  # for another writer
_ROW: Final = ", ".join("?" * (1 + len(fields(HistoryEntry))))  # with its source
_NAMED: Final = "baselines WHERE (machine, name) = (?, ?)"


def default_history() -> Path:
    """``$TBM_HISTORY``, else ``tbm_monitor/history.sqlite`` in the user's data folder (``$XDG_DATA_HOME``)."""
    named = os.environ.get("TBM_HISTORY")
    if named:
        return Path(named)
    try:
        return data_folder() / "history.sqlite"
    except RuntimeError:
        raise HistoryError("no home folder for the history, allowed: a file in TBM_HISTORY") from None


def check_history(path: Path) -> None:
    """Refuse a file that `History` would, and make none: one that is not there needs a folder that can be written."""
    if path.exists():
        History(path).close()
        return
    folder = next(folder for folder in path.absolute().parents if folder.exists())
    if not (folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)):
        raise HistoryError(f"{path}: no file can be made in {folder}, allowed: a folder that can be written")


class History(Queries):
    """An open history that can be written.

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
        if not create:
            check_file(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            super().__init__(path, sqlite3.connect(path, timeout=wait_s, isolation_level=None))
        except (OSError, sqlite3.Error) as error:
            raise HistoryError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
        try:
            self._prepare(wait_s)
        except sqlite3.DatabaseError as error:
            self.close()
            raise unusable(path, error) from None
        except HistoryError:
            self.close()
            raise

    def _prepare(self, wait_s: float) -> None:
        """Check what is in the file, write the schema into an empty one, bring an older one up to date."""
        ask = self._connection.execute
        ask("PRAGMA foreign_keys = OFF")  # an update may replace a table that others refer to
        with self._transaction():  # one of several that find an empty or older file writes the schema
            bring_up_to_date(version_of(self.path, self._connection), self._connection)
        ask("PRAGMA foreign_keys = ON")
        write_ahead(self._connection, wait_s)
        ask("PRAGMA synchronous = NORMAL")

    def add(
        self,
        source: WindowSource,
        entries: Iterable[HistoryEntry],
        context_at: Callable[[int], Context] = lambda _: UNKNOWN,
    ) -> int:
        """Commit windows of a source at once, with the context of their begins, replacing those of the same time.

        Returns
        -------
        int
            Number of entries.
        """
        with self._transaction() as ask:
            number = _number_of(ask, source)
            insert = f"INSERT OR REPLACE INTO windows (source, {ENTRY_COLUMNS}) VALUES ({_ROW})"  # noqa: S608
            count, noted = 0, None
            for entry in entries:
                ask(insert, (number, *astuple(entry)))
                count += 1
                if entry.start_ns != noted:
                    noted = entry.start_ns
                    _note_context(ask, number, noted, context_at(noted))
        return count

    def store_event(self, source: WindowSource, event: Event) -> StoredEvent:
        """Store an event, or what of one that is stored has changed: its end, text, severity, verdict and snapshot."""
        changing = "end_ns, text, severity, verdict, snapshot"
        with self._transaction() as ask:
            number = _number_of(ask, source)
            values = (number, *astuple(event)[:-1], *astuple(event.context))
            insert = f"INSERT INTO events (source, {EVENT_COLUMNS}, {CONTEXT_COLUMNS})"
            new = ", ".join(f"excluded.{name}" for name in changing.split(", "))
            found = ask(
                f"{insert} VALUES ({', '.join('?' * len(values))}) "
                "ON CONFLICT (source, begin_ns, event, point, level) "
                f"DO UPDATE SET ({changing}) = ({new}) RETURNING number",
                values,
            ).fetchone()
        return self.event(found[0])

    def acknowledge(
        self, numbers: Sequence[int], by: str, comment: str, now_ns: int, *, replace: bool = False
    ) -> list[StoredEvent]:
        """Acknowledge events, all or none; those that somebody has acknowledged only if that is asked for.

        Raises
        ------
        HistoryError
            No such event, or an acknowledged one; no name, or texts that are too long.
        """
        for what, text, least in (("name", by, 1), ("comment", comment, 0)):
            if not (least <= len(text.strip()) and len(text) <= LONGEST_LINE and text.isprintable()):
                raise HistoryError(f"{what} {quoted(text)}, allowed: {least} to {LONGEST_LINE} printable characters")
        with self._transaction() as ask:
            for found in map(self.event, numbers):
                if found.acknowledged_ns is not None and not replace:
                    raise HistoryError(
                        f"event {found.number}: acknowledged by {found.acknowledged_by} already, allowed: one that "
                        "nobody has acknowledged, or --replace"
                    )
                changed = "acknowledged_by = ?, acknowledged_ns = ?, comment = ?"
                ask(f"UPDATE events SET {changed} WHERE number = ?", (by, now_ns, comment, found.number))  # noqa: S608
            return [self.event(number) for number in numbers]

    def add_span(
        self,
        watch: WatchSource,
        start_ns: int,
        log_powers: bytes,
        states: Iterable[StateEntry],
        first: int,
        newest: int,
    ) -> None:
        """Commit a span of a watch and what the watch says after it, both or neither.

        Of its spans the first so many are kept, the baseline, and the newest so many.
        """
        described, count = astuple(watch), len(fields(WatchSource))
        with self._transaction() as ask:
            found = f"SELECT id FROM watches WHERE ({WATCH_COLUMNS}) = ({', '.join('?' * count)})"  # noqa: S608
            if ask(found, described).fetchone() is None:
                ask(f"INSERT INTO watches ({WATCH_COLUMNS}) VALUES ({', '.join('?' * count)})", described)  # noqa: S608
            number = ask(found, described).fetchone()[0]
            ask("INSERT OR REPLACE INTO spans VALUES (?, ?, ?)", (number, start_ns, log_powers))
            own = "SELECT start_ns FROM spans WHERE watch = ? ORDER BY start_ns"
            ask(
                f"DELETE FROM spans WHERE watch = ? AND start_ns NOT IN ({own} LIMIT ?) "  # noqa: S608
                f"AND start_ns NOT IN ({own} DESC LIMIT ?)",
                (number, number, first, number, newest),
            )
            for state in states:
                ask(
                    f"INSERT OR REPLACE INTO states (watch, start_ns, {STATE_COLUMNS}) "  # noqa: S608
                    "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                    (number, start_ns, *astuple(state)),
                )

    def discard(self, node: str, since_ns: int, until_ns: int, most: int) -> int:
        """Delete the live windows and states of a node among the first so many windows that begin in a span of time.

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
            watched = "watch IN (SELECT id FROM watches WHERE kind = 'live' AND node = ?)"
            spare = "SELECT max(since_ns) FROM contexts AS any WHERE any.source = contexts.source AND since_ns <= ?"
            ask(f"DELETE FROM contexts WHERE source IN ({own}) AND since_ns < ({spare})", (node, end))  # noqa: S608
            ask(f"DELETE FROM states WHERE start_ns >= ? AND start_ns < ? AND {watched}", (since_ns, end, node))  # noqa: S608
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
                f"INSERT INTO baselines ({BASELINE_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?)",  # noqa: S608
                tuple(getattr(baseline, name) for name in BASELINE_COLUMNS.split(", ")),
            )
            for (point, axis), usual in baseline.usual.items():
                row = (baseline.machine, baseline.name, point, axis, *astuple(usual))
                ask("INSERT INTO usual_errors VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", row)

    def delete_baseline(self, name: str, machine: str | None = None) -> Baseline:
        """Delete a baseline, found as `baseline` finds it, and return what it was."""
        with self._transaction() as ask:
            found = self.baseline(name, machine)
            ask(f"DELETE FROM {_NAMED}", (found.machine, name))  # noqa: S608
        return found

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


def _number_of(ask: Callable[..., sqlite3.Cursor], source: WindowSource) -> int:
    """Find the number of a source, which is stored where it is new."""
    described = astuple(source)
    ask(f"INSERT OR IGNORE INTO sources ({SOURCE_COLUMNS}) VALUES (?, ?, ?, ?, ?)", described)  # noqa: S608
    found = ask(f"SELECT id FROM sources WHERE ({SOURCE_COLUMNS}) = (?, ?, ?, ?, ?)", described)  # noqa: S608
    return int(found.fetchone()[0])


def _note_context(ask: Callable[..., sqlite3.Cursor], source: int, start_ns: int, context: Context) -> None:
    """Note the context of a window unless it is that of the windows before it."""
    before = f"SELECT {CONTEXT_COLUMNS} FROM contexts WHERE source = ? AND since_ns <= ? ORDER BY since_ns DESC LIMIT 1"  # noqa: S608
    known, now = ask(before, (source, start_ns)).fetchone(), astuple(context)
    if (known or astuple(UNKNOWN)) != now:
        ask("INSERT OR REPLACE INTO contexts VALUES (?, ?, ?, ?, ?, ?)", (source, start_ns, *now))
