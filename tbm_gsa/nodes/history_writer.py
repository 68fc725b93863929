"""The analysis node's windows on their way into the history: a file that fails costs windows, never the comparison."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

from tbm_gsa.comparison import UsualError, WindowResult
from tbm_gsa.history import Entry, History, HistoryError, Source, default_history, live_entries

OFF = "none"
WAIT_S = 0.2  # for another writer; callbacks wait meanwhile
MOST_WAITING = 10_000  # entries that are kept while the file is locked


class HistoryWriter:
    """Writes windows, keeps those that a locked file does not take yet, and counts those that are lost.

    Parameters
    ----------
    file : str
        Path, empty for the default one, or ``none``.
    source : Source
    warn : callable
        Called with one line when writing begins to fail.

    Attributes
    ----------
    problem : str
        Why the last window could not be written; empty while all is well.
    written, lost : int
        Entries.

    Raises
    ------
    HistoryError
        A file that was named and cannot be used; the default one only warns.
    """

    def __init__(self, file: str, source: Source, warn: Callable[[str], object]) -> None:
        self.problem, self.written, self.lost = "", 0, 0
        self._source, self._warn = source, warn
        self._waiting: list[Entry] = []
        self._history: History | None = None
        if file == OFF:
            return
        try:
            self._history = History(Path(file) if file else default_history(), wait_s=WAIT_S)
        except HistoryError as error:
            if file:
                raise
            self._fail(error)

    @property
    def path(self) -> str:
        """Where the windows go; empty if nowhere."""
        return str(self._history.path) if self._history else ""

    def usual_errors(self, baseline: str) -> dict[str, UsualError]:
        """Give the usual errors of a baseline, which has to be of the source's machine; none without a name."""
        if not baseline:
            return {}
        if self._history is None:
            raise HistoryError(f"baseline {baseline}: no history to find it in ({self.problem or 'it is none'})")
        found = self._history.baseline(baseline)
        if found.machine != self._source.machine:
            raise HistoryError(
                f"baseline {baseline}: of machine {found.machine}, allowed: one of {self._source.machine}"
            )
        return found.usual_errors()

    def add(self, result: WindowResult, rotating: bool) -> None:
        """Write a window in which something was measured."""
        if self._history is None:
            return
        self._waiting += live_entries(result, rotating)
        surplus = len(self._waiting) - MOST_WAITING
        if surplus > 0:
            self.lost += surplus
            del self._waiting[:surplus]
        if self._waiting:
            self._write(self._history)

    def _write(self, history: History) -> None:
        try:
            self.written += history.add(self._source, self._waiting)
        except sqlite3.Error as error:
            self._fail(error)
            return
        self._waiting, self.problem = [], ""

    def _fail(self, error: Exception) -> None:
        if not self.problem:
            self._warn(f"history: {error}; the comparison goes on")
        self.problem = str(error)

    def close(self) -> None:
        """Close the file; what still waits is tried once more."""
        if self._history is not None:
            if self._waiting:
                self._write(self._history)
            self._history.close()
