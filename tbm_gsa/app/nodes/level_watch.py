"""The watch at one level of operation: trained in a process of its own, resumed, then fed in a thread of its own."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from tbm_dynamics import Machine
from tbm_gsa.app.nodes.start import child_command
from tbm_gsa.app.nodes.watch_store import StoredWatch
from tbm_gsa.explanation.curve_cache import kept_curves
from tbm_gsa.explanation.live_observation import LiveObservation
from tbm_gsa.explanation.live_reading import Spectra
from tbm_gsa.explanation.machine_state import CauseGrid
from tbm_gsa.explanation.machine_watch import REMEMBERED, MachineAlarm, MachineWatch, WatchState
from tbm_gsa.explanation.ranges import loads_prior
from tbm_gsa.explanation.rock_fit import RockModel
from tbm_gsa.explanation.training import CurveJob
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.nodes.processes import ChildProcess

SPAN_S: Final = 60.0
"""Minutes: neighbouring windows of two seconds correlate."""
_MOST_WAITING = 240  # spans that wait for the training
_PRIORITY = 10  # of the training, as of a study
_GRACE_S = 1.0
_Opened = tuple[MachineWatch, WatchState | None]


@dataclass(frozen=True)
class WatchOptions:
    """How a change is watched for, in spans.

    Attributes
    ----------
    commissioning : int
        Of the baseline.
    length : float
        Mean number from one false alarm to the next.
    """

    commissioning: int
    length: float


class CurveTraining:
    """The process that computes the curves of a level.

    Parameters
    ----------
    job : CurveJob
    folder : Path
        Gets its log.
    """

    def __init__(self, job: CurveJob, folder: Path) -> None:
        command = child_command("tbm_gsa.explanation.training", job.model_dump_json())
        self._process = ChildProcess(command, folder / "training.log")
        os.setpriority(os.PRIO_PROCESS, self._process.pid, _PRIORITY)

    def poll(self) -> int | None:
        """Exit code; None while it runs."""
        return self._process.poll()

    def progress(self) -> str:
        """Return the last line that it has written."""
        return self._process.last_line()

    def end(self) -> None:
        """End it."""
        self._process.end(_GRACE_S)


class LevelWatch:
    """The watch at one level of operation; nothing of it waits.

    Parameters
    ----------
    machine : Machine
    job : CurveJob
        The level.
    stored : StoredWatch
        What is read, and what the watch is resumed from.
    options : WatchOptions
    pool : Executor
        Does one task after the other.

    Attributes
    ----------
    problem : str
        Why there is no watch; empty while there may be one.
    state : WatchState or None
        After the latest span.
    latest : deque of (int, ndarray)
        Begin and logarithms of the used band powers of the latest spans.
    """

    def __init__(
        self, machine: Machine, job: CurveJob, stored: StoredWatch, options: WatchOptions, pool: Executor
    ) -> None:
        self.stored, self.problem = stored, ""
        self.state: WatchState | None = None
        self.latest: deque[tuple[int, Array]] = deque(stored.spans[-REMEMBERED:], maxlen=REMEMBERED)
        self._machine, self._job, self._options, self._pool = machine, job, options, pool
        self._watch: MachineWatch | None = None
        self._training: CurveTraining | None = None
        self._trained = False
        self._spectra: Spectra = {}
        self._waiting: deque[tuple[int, Array]] = deque(maxlen=_MOST_WAITING)
        self._adding: deque[tuple[int, Array, Future[WatchState]]] = deque()
        self._opening: Future[_Opened | None] | None = pool.submit(self._open)

    @property
    def level(self) -> str:
        """The level in words."""
        job = self._job
        return f"{job.speed_r_min:.3g} r/min, {job.torque_kn_m:.3g} kN·m, {job.thrust_kn:.3g} kN"

    @property
    def alarm(self) -> MachineAlarm | None:
        """The alarm that stands."""
        return None if self.state is None else self.state.alarm

    @property
    def lacking(self) -> list[str]:
        """Test points of the reading that were not measured in the latest span."""
        return [point for point in self.stored.live.reading.sensors if self._spectra and point not in self._spectra]

    @property
    def wants_training(self) -> bool:
        """Whether its curves are not on the disk."""
        return not (self._opening or self._watch or self._training or self.problem)

    @property
    def doing(self) -> str:
        """What it does before it watches; empty once it does."""
        if self.problem:
            return self.problem
        if self._training is not None:
            return f"computes the machine: {self._training.progress()}"
        if self._watch is None:
            return "is prepared"
        done, wanted = 0 if self.state is None else self.state.commissioned, self._options.commissioning
        return "" if done >= wanted else f"commissioning: {done} of {wanted} min"

    def train(self, folder: Path) -> None:
        """Compute the curves in a process of its own."""
        try:
            self._training = CurveTraining(self._job, folder)
        except OSError as error:
            self.problem = f"the machine could not be computed: {error}"

    @property
    def training(self) -> bool:
        """Whether that process runs."""
        return self._training is not None

    def add(self, start_ns: int, spectra: Spectra) -> None:
        """Add a span; one of which nothing that is used was measured is left out."""
        self._spectra, row = spectra, self.stored.live.log_powers(spectra)
        if not np.isfinite(row).any():
            return
        self.latest.append((start_ns, row))
        self._waiting.append((start_ns, row))

    def observation(self, since_ns: int) -> LiveObservation | None:
        """Mean band powers since a time, as they would be if the model were right of the commissioned machine."""
        offset = None if self._watch is None else self._watch.offset
        spans = [(start_ns, row) for start_ns, row in self.latest if start_ns >= since_ns]
        if offset is None or not spans:
            return None
        floor = self.stored.live.floor(self._spectra)
        cleared = [row - offset for _, row in spans]
        begin_ns = spans[0][0]
        return LiveObservation.of(self._machine, self._job, self.stored.live, cleared, floor, SPAN_S, begin_ns)

    def poll(self) -> Iterator[tuple[int, Array, WatchState, MachineAlarm | None]]:
        """Spans that have been worked off, the state after each, and the alarm that was raised by it."""
        if self._training is not None and (code := self._training.poll()) is not None:
            self._trained, said, self._training = code == 0, self._training.progress(), None
            if self._trained:
                self._opening = self._pool.submit(self._open)
            else:
                self.problem = f"the machine could not be computed: {said}"
        if self._opening is not None and self._opening.done():
            self._take(self._opening)
        if self._watch is not None:
            while self._waiting:
                start_ns, row = self._waiting.popleft()
                self._adding.append((start_ns, row, self._pool.submit(self._watch.add, start_ns, row)))
        while self._adding and self._adding[0][2].done():
            start_ns, row, future = self._adding.popleft()
            before, self.state = self.alarm, future.result()
            yield start_ns, row, self.state, None if before else self.state.alarm

    def _take(self, opening: Future[_Opened | None]) -> None:
        """Go on with the watch that was opened."""
        self._opening = None
        try:
            found = opening.result()
        except InputError as error:  # a level that the machine does not have
            self.problem = str(error)
            return
        if found is not None:
            self._watch, self.state = found
        elif self._trained:
            self.problem = "the machine could not be computed: its file has changed since the node was configured"

    def close(self) -> None:
        """End its training."""
        if self._training is not None:
            self._training.end()
            self._training = None

    def _open(self) -> _Opened | None:
        """Watch after the spans that it is resumed from, and its state; None while its curves are not on the disk."""
        live, state, prior = self.stored.live, None, loads_prior(self._machine)
        curves = kept_curves(self._job.variant(self._machine), live.reading)
        if curves is None:
            return None
        places = np.array(live.used)
        told = curves.only(places)
        noise, coverage = (np.array(values)[places] for values in (live.noise, live.coverage))
        model = RockModel(told.nominal, prior, noise, SPAN_S, coverage)
        watch = MachineWatch(model, CauseGrid.of(told), self._options.commissioning, self._options.length)
        for start_ns, row in self.stored.spans:
            state = watch.add(start_ns, row)
        watch.resume(self.stored.alarm, self.stored.since_ns)
        return watch, None if state is None else replace(state, alarm=watch.alarm)
