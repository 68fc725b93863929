"""What `run` says while it goes on: on a terminal a line and a table, kept up to date; elsewhere a line at times."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from rich.console import Group
from rich.live import Live
from rich.text import Text

from tbm_gsa.app.cli.output import add_row, narrow_table, notes
from tbm_msgs_py.base.texts import listed, printable
from tbm_msgs_py.topics import status_name

PERIOD_S = 60.0
"""Between two lines in a pipe, as to the journal of a service."""
ALARM_S = 5.0
"""Between two lines there that tell of other alarms."""
_COMPARISON = status_name("comparison ")
_MACHINE, _ROCK = status_name("machine"), status_name("rock")
_STATES: Final = ("ok", "warning", "error", "stale")
_LONGEST: Final = 60  # characters of what a row says

Diagnostics = Mapping[str, tuple[int, str, Mapping[str, str]]]
"""Level, text and values by the name of the status."""


class StatusLine:
    """Shows the status of a run inside a `with` block.

    Parameters
    ----------
    logs : Path
        Folder of the logs.
    duration : float, optional
        Stream time at which the run ends, s.
    clock : callable
        Seconds.
    """

    def __init__(self, logs: Path, duration: float | None, clock: Callable[[], float] = time.monotonic) -> None:
        self._logs, self._duration, self._clock = logs, duration, clock
        self._live = Live(console=notes, transient=True, auto_refresh=False) if notes.is_terminal else None
        self._printed = -math.inf
        self._shown = math.inf  # stream time of the last line; without one there is none at the end, either
        self._alarms: list[str] = []
        self._since: dict[str, tuple[int, str]] = {}  # level of each status, and when it took it
        self._drawn: tuple[object, ...] = ()

    def __enter__(self) -> Self:
        if self._live:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live:
            self._live.stop()

    def update(self, diagnostics: Diagnostics, stream_time: float) -> None:
        """Show how things are at a stream time, s."""
        points = {
            name.removeprefix(_COMPARISON): values
            for name, (_, _, values) in sorted(diagnostics.items())
            if name.startswith(_COMPARISON)
        }
        watched = {"the machine": diagnostics[_MACHINE][2]} if _MACHINE in diagnostics else {}
        alarms = [name for name, values in (points | watched).items() if values.get("alarm") == "1"]
        if self._live:
            self._draw(self._live, Text(self._text(points, alarms, stream_time), no_wrap=True), diagnostics)
        elif self._clock() - self._printed >= (PERIOD_S if alarms == self._alarms else ALARM_S):
            self._printed, self._shown, self._alarms = self._clock(), stream_time, alarms
            notes.print(self._text(points, alarms, stream_time), highlight=False)

    def _draw(self, live: Live, line: Text, diagnostics: Diagnostics) -> None:
        """Draw line and table when one of them has changed."""
        rows = self._rows(diagnostics)
        if (line.plain, rows) != self._drawn:
            self._drawn = (line.plain, rows)
            table = narrow_table("", "", "=state", ">error", "=since", "what")
            for row in rows:
                add_row(table, *row)
            live.update(Group(line, table) if rows else line, refresh=True)

    def _rows(self, diagnostics: Diagnostics) -> list[tuple[str, ...]]:
        """Test points, machine and rock: their state and since when, axial error, and what they say."""
        shown = {name: name.removeprefix(_COMPARISON) for name in sorted(diagnostics) if name.startswith(_COMPARISON)}
        shown |= {name: name.removeprefix(status_name("")) for name in (_MACHINE, _ROCK) if name in diagnostics}
        rows: list[tuple[str, ...]] = []
        for name, short in shown.items():
            level, text, values = diagnostics[name]
            if self._since.get(name, (None,))[0] != level:
                self._since[name] = (level, time.strftime("%H:%M:%S"))
            error = _axial_error(values)
            figure = f"{error:.2f}" if math.isfinite(error) else "–"
            state = _STATES[level] if level < len(_STATES) else str(level)
            rows.append(
                (
                    short,
                    state,
                    figure,
                    self._since[name][1],
                    text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…",
                )
            )
        return rows

    def finish(self, diagnostics: Diagnostics, stream_time: float) -> None:
        """Print how things were at the end, where the last line is older; on a terminal the results take its place."""
        if not self._live and stream_time > self._shown:
            self._printed = -math.inf
            self.update(diagnostics, stream_time)

    def _text(self, points: Mapping[str, Mapping[str, str]], alarms: list[str], stream_time: float) -> str:
        of = "" if self._duration is None else f" of {self._duration:g}"
        errors = [error for values in points.values() if math.isfinite(error := _axial_error(values))]
        compared = f"{len(points)} points, {len(errors)} compared"
        if errors:
            compared += f", axial error {min(errors):.2f} to {max(errors):.2f}"
        alarm = f"alarm at {listed(alarms)}" if alarms else "no alarm"
        return printable(f"{stream_time:.0f}{of} s: {compared}; {alarm}; logs in {self._logs}")


def _axial_error(values: Mapping[str, str]) -> float:
    """Relative error along x; NaN without one, or where others publish nonsense under our names."""
    try:
        return float(values.get("relative_error_x", "nan"))
    except ValueError:
        return math.nan
