"""The watch in the history: what it is resumed from after a restart, and what it says span by span."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from pydantic import TypeAdapter, ValidationError

from tbm_gsa.app.nodes.history_writer import HistoryWriter
from tbm_gsa.comparison.levels import alike
from tbm_gsa.explanation.live_reading import LiveReading
from tbm_gsa.explanation.machine_watch import REMEMBERED, MachineAlarm, WatchState
from tbm_gsa.history import History, SourceKind, StateEntry, StoredState, WatchSource
from tbm_msgs_py.base.arrays import Array

READING: Final = TypeAdapter(LiveReading)
MOST_WAITING: Final = 1000
"""Spans that are kept while the file is locked."""


@dataclass(frozen=True, eq=False)
class StoredWatch:
    """What a watch is resumed from.

    Attributes
    ----------
    source : WatchSource
    live : LiveReading
    spans : tuple of (int, ndarray)
        Begin and logarithms of the used band powers: the baseline's and the newest.
    alarm : MachineAlarm or None
        That stood.
    since_ns : mapping of str to int
        Begin of the change of each group of loads that had changed.
    """

    source: WatchSource
    live: LiveReading
    spans: tuple[tuple[int, Array], ...] = ()
    alarm: MachineAlarm | None = None
    since_ns: Mapping[str, int] = field(default_factory=dict)


class WatchStore:
    """Watches of one node and machine.

    Parameters
    ----------
    history : HistoryWriter
    """

    def __init__(self, history: HistoryWriter) -> None:
        self._history, self._own = history, history.source
        self._waiting: deque[tuple[WatchSource, int, Array, tuple[StateEntry, ...], int]] = deque(maxlen=MOST_WAITING)

    @property
    def failing(self) -> bool:
        """Whether the history cannot be used now."""
        return bool(self._history.path and self._history.problem)

    def find(
        self, kind: SourceKind, baseline: str, point: Array, covers: Callable[[LiveReading], bool]
    ) -> StoredWatch | None:
        """Find the newest watch of a name at a level of operation whose reading covers what is read now."""
        return self._history.use(lambda history: self._find(history, kind, baseline, point, covers))

    def source(self, kind: SourceKind, baseline: str, point: Array, live: LiveReading) -> WatchSource:
        """Describe a new watch."""
        own, (speed, torque, thrust) = self._own, (float(value) for value in point)
        reading = READING.dump_json(live).decode()
        return WatchSource(kind, own.name, own.machine, own.machine_sha256, baseline, speed, torque, thrust, reading)

    def add(self, source: WatchSource, start_ns: int, log_powers: Array, state: WatchState, baseline: int) -> None:
        """Write a span, and those that a locked file has refused; of the first so many spans the baseline is made."""
        self._waiting.append((source, start_ns, log_powers, tuple(state_entries(state)), baseline))
        self._history.use(self._write)

    def _write(self, history: History) -> None:
        while self._waiting:
            source, start_ns, log_powers, states, baseline = self._waiting[0]
            history.add_span(source, start_ns, log_powers.astype("<f8").tobytes(), states, baseline, REMEMBERED)
            self._waiting.popleft()

    def _find(
        self, history: History, kind: SourceKind, baseline: str, point: Array, covers: Callable[[LiveReading], bool]
    ) -> StoredWatch | None:
        own = self._own
        for source in reversed(history.watches()):
            same = (source.kind, source.node, source.machine_sha256, source.baseline)
            level = np.array([source.speed, source.torque, source.thrust])
            if same != (kind, own.name, own.machine_sha256, baseline) or not alike(level, point):
                continue
            try:
                live = READING.validate_json(source.reading)
            except ValidationError:  # of another version
                continue
            if covers(live):
                last = [one for one in history.states() if one.watch == source]
                return StoredWatch(source, live, tuple(_spans(history, source, live)), _alarm(last), _since(last))
        return None


def state_entries(state: WatchState) -> Iterator[StateEntry]:
    """Lines of what a watch says."""
    for load in state.loads:
        yield StateEntry("rock", load.name, load.value, load.low, load.high, load.probability, load.since_ns)
    alarm = state.alarm
    since_ns = alarm.since_ns if alarm is not None and alarm.kind == "machine" else None
    for one in state.inputs:
        yield StateEntry("machine", one.name, one.value, one.low, one.high, one.probability, since_ns)
    if alarm is not None:
        fault = alarm.sensor
        size = (math.nan, math.nan, math.nan) if fault is None else (fault.gain, fault.low, fault.high)
        yield StateEntry("alarm", alarm.kind, *size, math.nan, alarm.since_ns, alarm.text)


def _spans(history: History, source: WatchSource, live: LiveReading) -> Iterator[tuple[int, Array]]:
    for start_ns, content in history.spans(source):
        if len(content) == 8 * len(live.used):  # else of another version
            yield start_ns, np.frombuffer(content, "<f8")


def _alarm(states: list[StoredState]) -> MachineAlarm | None:
    for one in (state.entry for state in states):
        if one.part == "alarm" and one.since_ns is not None:
            return MachineAlarm("sensor" if one.name == "sensor" else "machine", one.since_ns, one.text, None)
    return None


def _since(states: list[StoredState]) -> dict[str, int]:
    lines = [state.entry for state in states]
    return {one.name: one.since_ns for one in lines if one.part == "rock" and one.since_ns is not None}
