"""Rock or machine, live: spans of all test points together, and a watch at every level of operation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from tbm_dynamics import Machine
from tbm_gsa.app.nodes.history_writer import kind_of
from tbm_gsa.app.nodes.level_watch import SPAN_S, LevelWatch, WatchOptions
from tbm_gsa.app.nodes.settings import WatchSettings
from tbm_gsa.app.nodes.span_gatherer import SpanGatherer
from tbm_gsa.app.nodes.watch_store import StoredWatch, WatchStore
from tbm_gsa.comparison.levels import alike
from tbm_gsa.explanation.live_reading import LiveReading
from tbm_gsa.explanation.machine_watch import MachineAlarm, WatchState
from tbm_gsa.explanation.training import CurveJob
from tbm_gsa.history import SourceKind
from tbm_gsa.signals.spans import SpanSpectrum
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.recordings.mapping import SensorMapping

MOST_LEVELS: Final = 16
"""That are held at a time; the one that was left longest ago goes, and is resumed from the history."""
_PATIENCE: Final = 5
"""Spans for which a history that cannot be read now is tried again, before a watch begins without it."""


@dataclass(frozen=True, eq=False)
class WatchUpdate:
    """What a watch says after a span.

    Attributes
    ----------
    level : LevelWatch
    start_ns : int
        Begin of the span.
    state : WatchState
    raised : MachineAlarm or None
        Alarm that was raised by the span.
    """

    level: LevelWatch
    start_ns: int
    state: WatchState
    raised: MachineAlarm | None


class LiveWatch:
    """Watches of a machine while its signals arrive.

    Parameters
    ----------
    machine : Machine
    sensors : mapping of str to SensorMapping
        By test point.
    settings : WatchSettings
    store : WatchStore
    steady_point : callable
        Speed, torque and thrust (3,) that were held from a begin to an end, ns; None if they were not.
    pool : Executor, optional
        Does one task after the other.

    Attributes
    ----------
    current : LevelWatch or None
        At the level of the latest span.
    note : str
        Why the latest span is not watched; empty if it is.
    """

    def __init__(
        self,
        machine: Machine,
        sensors: Mapping[str, SensorMapping],
        settings: WatchSettings,
        store: WatchStore,
        steady_point: Callable[[int, int], Array | None],
        pool: Executor | None = None,
    ) -> None:
        self._machine, self._sensors, self._store, self._steady_point = machine, dict(sensors), store, steady_point
        self._pool = pool or ThreadPoolExecutor(1, "watch")
        self._folder = TemporaryDirectory(prefix="tbm_watch_")
        self._gatherer, self._tries = SpanGatherer(), 0
        self._levels: list[LevelWatch] = []  # the one that was left longest ago first
        self.set_options(settings)

    @property
    def doing(self) -> str:
        """What keeps the watch from watching; empty if nothing does."""
        current = self.current
        if self.note or current is None or not current.doing:
            return self.note
        return f"{current.level}: {current.doing}"

    def set_options(self, settings: WatchSettings) -> None:
        """Begin anew with other settings; what was learnt is in the history."""
        self._end_levels()
        self.current: LevelWatch | None = None
        self.note = "no minute of steady boring yet"
        self._settings = settings
        self._options = WatchOptions(
            round(settings.commissioning * 3600.0 / SPAN_S), settings.false_alarm * 86400.0 / SPAN_S
        )

    @property
    def commissioning(self) -> int:
        """Spans of a baseline."""
        return self._options.commissioning

    def add(self, found: Mapping[str, Iterable[SpanSpectrum]], now_ns: int | None) -> None:
        """Add spans of test points; `now_ns` as `live_now` returns it."""
        for spectra in self._gatherer.add(found):
            self._add({point: one for point, one in spectra.items() if one.enough}, now_ns)

    def _add(self, spectra: dict[str, SpanSpectrum], now_ns: int | None) -> None:
        if not spectra:
            self.note = "no test point was measured for enough of the last minute"
            return
        first = next(iter(spectra.values()))
        start, end = first.start_ns, first.start_ns + first.length_ns
        point = self._steady_point(start, end)
        if point is None:
            self.note = "the operating point is not known, or did not stay for the last minute"
            return
        try:
            # A span may come as late as another one takes.
            kinds = {kind_of(end, now_ns), kind_of(end + first.length_ns, now_ns)}
            level = self._level(point, spectra, "live" if "live" in kinds else "replay")
        except InputError as error:
            self.note = str(error)
            return
        if level is not None:
            self.note, self.current = "", level
            level.add(start, spectra)

    def _level(self, point: Array, spectra: dict[str, SpanSpectrum], kind: SourceKind) -> LevelWatch | None:
        """Watch at an operating point; None while the history, which may hold it, cannot be read."""

        def covers(one: LiveReading) -> bool:
            return one.covers(spectra, self._sensors)

        for level in self._levels:
            source = level.stored.source
            held = np.array([source.speed, source.torque, source.thrust])
            if source.kind == kind and alike(held, point) and covers(level.stored.live):
                self._levels.remove(level)
                self._levels.append(level)
                return level
        name = self._settings.baseline
        stored = self._store.find(kind, name, point, covers)
        if stored is None and self._store.failing and self._tries < _PATIENCE:
            self._tries += 1
            self.note = "the history cannot be read now: it may hold the baseline"
            return None
        self._tries = 0
        if stored is None:
            reading = LiveReading.of(spectra, self._sensors, self._machine.description.loads.bands)
            stored = StoredWatch(self._store.source(kind, name, point, reading), reading)
        return self._new_level(stored)

    def _new_level(self, stored: StoredWatch) -> LevelWatch:
        held = np.array([stored.source.speed, stored.source.torque, stored.source.thrust])
        job = CurveJob.at(self._machine.origin, held, stored.live.reading, self._settings.workers)
        if len(self._levels) == MOST_LEVELS:
            self._levels.pop(0).close()
        self._levels.append(LevelWatch(self._machine, job, stored, self._options, self._pool))
        return self._levels[-1]

    def poll(self) -> list[WatchUpdate]:
        """Return the updates since the last call; train what has to be trained, one level at a time."""
        found = []
        for level in self._levels:
            for start_ns, row, state, raised in level.poll():
                self._store.add(level.stored.source, start_ns, row, state, self.commissioning)
                found.append(WatchUpdate(level, start_ns, state, raised))
        if not any(level.training for level in self._levels):
            for level in (one for one in self._levels if one.wants_training):
                level.train(Path(self._folder.name))
                break
        return found

    def close(self) -> None:
        """End trainings and tasks."""
        self._end_levels()
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._folder.cleanup()

    def _end_levels(self) -> None:
        for level in self._levels:
            level.close()
        self._levels = []
