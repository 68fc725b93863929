"""The trends of the page, read from the history bin by bin: what is over is read once."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Final

from tbm_gsa.app.web.expected import Expectation, usual_limits
from tbm_gsa.app.web.state import TREND_SPANS, Trend, TrendBin, TrendSpan
from tbm_gsa.history import HistoryError, HistoryReader, Selection, SourceKind
from tbm_gsa.history.trends import TrendRow, trend_rows
from tbm_msgs_py.base.units import NANOSECONDS, iso_time

WAIT_S: Final = 1.0  # for a program that holds the history locked
_LATE_NS: Final = 60 * NANOSECONDS
"""After the end of a bin, in which windows may still come."""


@dataclass
class TrendReader:
    """Reads the trends of one machine; for one thread.

    Attributes
    ----------
    path : Path or None
        Of the history; None: nothing is kept.
    machine : str
        Digits of its SHA-256.
    alarm : Expectation or None
        Limits of the alarm; None: what the last week was.
    lock : Lock
        Held while the history is open: one process cannot open it to write while it has it open to read.
    ending : bool
        Set by another thread to break off.
    """

    path: Path | None
    machine: str
    alarm: Expectation | None
    lock: Lock = field(default_factory=Lock)
    ending: bool = False
    _bins: dict[TrendSpan, dict[int, Sequence[TrendRow]]] = field(default_factory=dict)
    _kind: SourceKind = "live"

    def expectation(self) -> Expectation:
        """Return what level is expected, by what was read last."""
        return self.alarm or usual_limits(row for rows in self._bins.get("week", {}).values() for row in rows)

    def read(self, span: TrendSpan, now_ns: int, kind: SourceKind) -> Trend:
        """Trend that ends at a time, of windows of the machine or of a replay."""
        seconds, count = TREND_SPANS[span]
        bin_ns, problem = seconds * NANOSECONDS, ""
        if kind != self._kind:
            self._bins, self._kind = {}, kind
        known = self._bins.setdefault(span, {})
        last = now_ns // bin_ns
        wanted = range(last - count + 1, last + 1)
        try:
            self._read(known, wanted, bin_ns, now_ns)
        except (HistoryError, sqlite3.Error) as error:
            problem = str(error)
        if self.path is None:
            problem = "no history is kept"
        return self._trend(span, wanted, now_ns, problem)

    def _read(self, known: dict[int, Sequence[TrendRow]], wanted: range, bin_ns: int, now_ns: int) -> None:
        """Read the bins that are not known or not over, one by one: who acknowledges an event waits for one at most."""
        for number in known.keys() - set(wanted):
            del known[number]
        for number in wanted:
            over = (number + 1) * bin_ns + _LATE_NS <= now_ns
            if self.path is None or self.ending or (number in known and over):
                continue
            begin = number * bin_ns
            chosen = Selection(
                since_ns=begin, until_ns=begin + bin_ns, source=self._kind, machine=self.machine, axis="x"
            )
            with self.lock, HistoryReader(self.path, WAIT_S) as history:
                known[number] = trend_rows(history, chosen, bin_ns)

    def _trend(self, span: TrendSpan, wanted: range, now_ns: int, problem: str) -> Trend:
        seconds, count = TREND_SPANS[span]
        points: dict[str, list[TrendBin]] = {}
        for number in wanted:
            for row in self._bins.get(span, {}).get(number, ()):
                points.setdefault(row.point, []).append(
                    TrendBin(
                        begin=iso_time(row.begin_ns),
                        windows=row.windows,
                        low=row.low,
                        median=row.median,
                        high=row.high,
                        level=row.level,
                    )
                )
        return Trend(
            span=span,
            bin_s=seconds,
            bins=count,
            end=iso_time(now_ns),
            problem=problem,
            points={point: tuple(bins) for point, bins in points.items()},
        )
