"""Rock and machine as statuses: on `analysis/rock`, `analysis/machine` and `/diagnostics`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus

from tbm_gsa.app.nodes.live_watch import LiveWatch
from tbm_gsa.app.nodes.watch_store import state_entries
from tbm_gsa.explanation.machine_watch import LIKELY, MachineAlarm, WatchState
from tbm_gsa.history import StateEntry
from tbm_gsa.history.entries import StatePart
from tbm_gsa.sensitivity.study.inputs import known_input
from tbm_msgs_py.base.units import iso_time
from tbm_msgs_py.nodes import messages

_SENSOR = "the sensor, its mounting, cable and range"
_UNNAMED = "what is near the point that is named, and changes that the model does not have"


@dataclass(frozen=True)
class WatchStatuses:
    """What the watch says now.

    Attributes
    ----------
    name : callable
        Makes the name of a status of the machine.
    machine : str
    doing : str
        What keeps it from watching; empty if nothing does.
    level : str
        Of operation, in words; empty before there is one.
    state : WatchState or None
    lacking : tuple of str
        Test points that were not measured in the latest minute.
    """

    name: Callable[[str], str]
    machine: str
    doing: str
    level: str
    state: WatchState | None
    lacking: tuple[str, ...] = ()

    @classmethod
    def of(cls, name: Callable[[str], str], machine: str, watch: LiveWatch) -> WatchStatuses:
        """Of a watch, at the level of its latest span."""
        level = watch.current
        if level is None:
            return cls(name, machine, watch.doing, "", None)
        return cls(name, machine, watch.doing, level.level, level.state, tuple(level.lacking))

    def rock(self) -> list[DiagnosticStatus]:
        """State of the rock, then of each group of loads."""
        return [self.rock_summary(), *self._lines("rock")]

    def machine_state(self) -> list[DiagnosticStatus]:
        """State of the machine, then of each of its inputs."""
        return [self.machine_summary(), *self._lines("machine")]

    def rock_summary(self) -> DiagnosticStatus:
        """Whether the rock is what it was at the commissioning."""
        if self.state is None:
            return self._status("rock", "stale", self.doing, {})
        values = {one.name: one.value for one in self.state.loads}
        return self._status("rock", "ok", self.doing or rock_text(self.state), values)

    def machine_summary(self) -> DiagnosticStatus:
        """Whether the machine is what it was at the commissioning; an alarm has its values."""
        if self.state is None:
            return self._status("machine", "stale", self.doing, {"alarm": 0})
        values: dict[str, object] = {"alarm": 0, "commissioned": self.state.commissioned}
        for line in self._entries("alarm"):
            return self._status("machine", "warn", alarm_text(self.state), values | {"alarm": 1} | _values(line))
        return self._status("machine", "ok", self.doing or "as at the commissioning", values)

    def _status(self, task: str, level: messages.Level, text: str, values: messages.Values) -> DiagnosticStatus:
        lacking = f"; not measured in the last minute: {', '.join(self.lacking)}" if self.lacking else ""
        return messages.status(self.name(task), level, text + lacking, {"level": self.level, **values}, self.machine)

    def _lines(self, part: StatePart) -> Iterator[DiagnosticStatus]:
        for line in self._entries(part):
            changed = line.probability >= LIKELY
            level: messages.Level = "warn" if changed and part == "machine" else "ok"
            text = f"{line.value:.3g} ({line.low:.3g} to {line.high:.3g})"
            name = self.name(f"{part} {line.name}")
            yield messages.status(name, level, text, _values(line), self.machine)

    def _entries(self, part: StatePart) -> Iterable[StateEntry]:
        return () if self.state is None else (one for one in state_entries(self.state) if one.part == part)


def _values(line: StateEntry) -> dict[str, object]:
    names = ("name", "value", "low", "high", "probability")
    since = "" if line.since_ns is None else iso_time(line.since_ns)
    return {name: getattr(line, name) for name in names} | {"since": since}


def rock_text(state: WatchState) -> str:
    """Name the groups of loads that are not what they were at the commissioning."""
    changed = [one for one in state.loads if one.probability >= LIKELY]
    if not changed:
        return "as at the commissioning"
    return "changed: " + ", ".join(f"{one.name} {one.value:.3g} ({one.low:.3g} to {one.high:.3g})" for one in changed)


def alarm_text(state: WatchState) -> str:
    """Return what has changed, since when, and what to look at; empty without an alarm."""
    alarm = state.alarm
    if alarm is None:
        return ""
    return f"{alarm.text}; since {iso_time(alarm.since_ns)}; look at {_place(alarm)}; rock: {rock_text(state)}"


def _place(alarm: MachineAlarm) -> str:
    if alarm.kind == "sensor":
        return _SENSOR
    return known_input(alarm.input).name if alarm.input else _UNNAMED
