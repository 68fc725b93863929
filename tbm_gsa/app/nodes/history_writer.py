"""The analysis node's windows on their way into the history: a file that fails costs windows, never the comparison."""

from __future__ import annotations

import math
import sqlite3
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from tbm_gsa.app.nodes.settings import OFF
from tbm_gsa.comparison import UsualRatio, WindowResult
from tbm_gsa.history import (
    UNKNOWN,
    Context,
    History,
    HistoryEntry,
    HistoryError,
    HistoryLockedError,
    SourceKind,
    WindowSource,
    default_history,
    live_entries,
)

if TYPE_CHECKING:
    from rclpy.clock import Clock

WAIT_S = 0.2  # for another writer; callbacks wait meanwhile
RETRY_S = 5.0  # between two tries to open a file that cannot be used
MOST_WAITING = 10_000  # entries that are kept while the file is locked
DISCARD_S = 10.0  # between two looks for windows that are too old
# Entries that a look goes through, in some ms; windows of 0.1 s at five points are 1500 in that time.
MOST_DISCARDED = 2500
LIVE_WITHIN_NS = 60_000_000_000  # of the computer's clock; a window is complete some seconds after its end
_DAY_NS = 86_400_000_000_000
Result = TypeVar("Result")


def live_now(clock: Clock) -> int | None:
    """Time of the computer, ns, by a node's clock; None where that is simulated."""
    return None if clock.ros_time_is_active else int(clock.now().nanoseconds)


def kind_of(end_ns: int, now_ns: int | None) -> SourceKind:
    """Return the kind of what ends at a time: a replay on a simulated clock, or where its stamps are not of now."""
    return "replay" if now_ns is None or abs(now_ns - end_ns) > LIVE_WITHIN_NS else "live"


class HistoryWriter:
    """Writes windows, keeps those that a locked file refuses for now, and counts those that are lost.

    Parameters
    ----------
    file : str
        Path, empty for the default one, or ``none``.
    source : WindowSource
        The live one; windows of a replay go under the same name as a replay.
    warn : callable
        Called with one line when writing begins to fail.
    days : float
        Age at which live windows of this node are deleted; 0 keeps them all. It counts from the newest of them, and
        from now where a stamp is of the future. Windows of a replay have no age.

    Attributes
    ----------
    problem : str
        Why the last window could not be written; empty while all is well.
    written, lost : int
        Entries.

    Raises
    ------
    HistoryError
        A file that was named and cannot be used, unless it is only locked; the default one only warns.
    """

    def __init__(self, file: str, source: WindowSource, warn: Callable[[str], object], days: float = 0.0) -> None:
        self.problem, self.written, self.lost = "", 0, 0
        self._source, self._warn = source, warn
        self._waiting: list[tuple[SourceKind, Context, HistoryEntry]] = []
        self._history: History | None = None
        self._file: Path | None = None
        self._keep_ns = round(days * _DAY_NS)
        self._discarded_ns = 0  # up to here old windows have been deleted
        self._next_try = self._next_discard = -math.inf
        if file == OFF:
            return
        try:
            self._file = Path(file) if file else default_history()
            self._open()
        except HistoryError as error:
            if file and not isinstance(error, HistoryLockedError):
                raise
            self._fail(error)

    @property
    def path(self) -> str:
        """Where the windows go; empty if nowhere."""
        return str(self._file or "")

    def usual_ratios(self, baseline: str) -> dict[str, UsualRatio]:
        """Return what is usual by a baseline of the source's machine; none without a name.

        Raises
        ------
        HistoryError
            There is none, or the file cannot be read.
        """
        if not baseline:
            return {}
        try:
            history, reason = self._open(), self.problem or "it is none"
        except HistoryError as error:
            history, reason = None, str(error)
        if history is None:
            raise HistoryError(f"baseline {baseline}: no history to find it in ({reason})")
        try:
            found = history.baseline(baseline, self._source.machine)
        except sqlite3.Error as error:
            raise HistoryError(f"baseline {baseline}: {self.path}: {error}") from None
        if found.kind == "synthetic":
            self._warn(f"baseline {baseline}: of a synthetic recording: alarms are set against nothing measured")
        usual = found.usual_ratios()
        if not usual:
            self._warn(f"baseline {baseline}: of an older version, without logarithms of levels: make it anew")
        for point, one in usual.items():
            for axis, factor in one.blind.items():
                self._warn(
                    f"baseline {baseline}: {point} {axis} scatters so much that only a change by a factor of "
                    f"{factor:.2g} or more counts"
                )
        return usual

    def add(self, result: WindowResult, rotating: bool, now_ns: int | None, context: Context = UNKNOWN) -> None:
        """Write a window in which something was measured; `now_ns` as `live_now` returns it."""
        if self._file is None:
            return
        kind = kind_of(result.start_ns + result.length_ns, now_ns)
        self._waiting += ((kind, context, entry) for entry in live_entries(result, rotating))
        surplus = len(self._waiting) - MOST_WAITING
        if surplus > 0:
            self.lost += surplus
            del self._waiting[:surplus]
        if self._waiting:
            self.use(self._write)

    @property
    def source(self) -> WindowSource:
        """The live one."""
        return self._source

    def use(self, action: Callable[[History], Result]) -> Result | None:
        """Return the result of what is done with the open history; None where none is kept, or the file fails now."""
        if self._file is None or (self._history is None and time.monotonic() < self._next_try):
            return None
        try:
            history = self._open()
            found = None if history is None else action(history)
        except (HistoryError, sqlite3.Error) as error:
            self._fail(error)
            return None
        self.problem = ""
        return found

    def _open(self) -> History | None:
        """Open the file if it is not open yet; None where nothing is kept."""
        if self._history is None and self._file is not None:
            self._next_try = time.monotonic() + RETRY_S
            self._history = History(self._file, wait_s=WAIT_S)
        return self._history

    def _write(self, history: History) -> None:
        while self._waiting:
            (kind, context), run = next(groupby(self._waiting, key=itemgetter(0, 1)))
            entries = [entry for *_, entry in run]
            self.written += history.add(replace(self._source, kind=kind), entries, partial(_same, context))
            del self._waiting[: len(entries)]
            if kind == "live":
                self._discard(history, max(entry.start_ns for entry in entries))

    def _discard(self, history: History, newest_ns: int) -> None:
        """Delete a portion of the windows that are too old; from the oldest again once all have been looked through."""
        if not self._keep_ns or time.monotonic() < self._next_discard:
            return
        self._next_discard = time.monotonic() + DISCARD_S
        until_ns = min(newest_ns, time.time_ns()) - self._keep_ns
        if self._discarded_ns < until_ns:
            reached = history.discard(self._source.name, self._discarded_ns, until_ns, MOST_DISCARDED)
            self._discarded_ns = reached if reached < until_ns else 0

    def _fail(self, error: Exception) -> None:
        if not self.problem:
            self._warn(f"history: {error}; the comparison goes on")
        self.problem = str(error)

    def close(self) -> None:
        """Close the file; what still waits is tried once more."""
        if self._waiting:
            self._next_try = -math.inf
            self.use(self._write)
        if self._history is not None:
            self._history.close()


def _same(context: Context, _time_ns: int) -> Context:
    return context
