"""Rock or machine, span by span, at one level of operation: commissioning, then the chart and what it means."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
import scipy.linalg
import scipy.special

from tbm_dynamics.loads.description import LOAD_GROUPS
from tbm_gsa.explanation.machine_state import CauseGrid, InputState, MachineState
from tbm_gsa.explanation.rock_fit import RockFit, RockModel
from tbm_gsa.explanation.sensor_fault import SensorFault, sensor_fault
from tbm_gsa.explanation.sequential import MachineBaseline, MachineChart, commission
from tbm_msgs_py.base.arrays import Array

COMMISSIONING: Final = 240
"""Spans that a baseline is made of: four hours of minutes."""
RUN_LENGTH: Final = 43_200.0
"""Spans from one false alarm to the next: 30 days of minutes."""
LIKELY: Final = 0.8
"""Probability from which a change of the rock counts, and an input is named if it leaves nothing that would alarm."""
REMEMBERED: Final = 60
"""Spans of which those since a change are looked at; of what was before the chart keeps 0.2 %."""
_JUDGED = 10  # spans after a change in which what nothing explains may yet turn out to be a sensor
_FALLEN = 0.5  # of the limit, below which an alarm is over
_INTERVAL = 1.645


@dataclass(frozen=True)
class LoadState:
    """Factor of a group of loads: most likely value, 90 % interval, and whether the rock has changed.

    Attributes
    ----------
    name : str
        Of `LOAD_GROUPS`.
    value, low, high : float
    probability : float
        That it is not what it was while the machine was commissioned.
    since_ns : int or None
        Begin of the first span from which that has been likely.
    """

    name: str
    value: float
    low: float
    high: float
    probability: float
    since_ns: int | None = None


@dataclass(frozen=True)
class MachineAlarm:
    """What has changed, since when, and what to look at.

    Attributes
    ----------
    kind : {"machine", "sensor"}
    since_ns : int
        Begin of the span at which the change began, as far as that shows.
    text : str
    sensor : SensorFault or None
    input : str
        Code of the input that has changed; empty where none is named.
    """

    kind: Literal["machine", "sensor"]
    since_ns: int
    text: str
    sensor: SensorFault | None
    input: str = ""


@dataclass(frozen=True)
class WatchState:
    """The state after a span.

    Attributes
    ----------
    commissioned : int
        Spans of the baseline so far.
    loads : tuple of LoadState
    inputs : tuple of InputState
        None before the baseline is complete, without a grid, and while a sensor is at fault.
    alarm : MachineAlarm or None
        It stands until the machine has been for some time what it was.
    """

    commissioned: int
    loads: tuple[LoadState, ...]
    inputs: tuple[InputState, ...]
    alarm: MachineAlarm | None


class MachineWatch:
    """Learns the baseline of a machine at one level of operation from its first spans, then watches it.

    Parameters
    ----------
    model : RockModel
    grid : CauseGrid, optional
        By which inputs are named.
    commissioning : int
        Spans of the baseline.
    length : float
        Mean number of spans from one false alarm to the next.
    """

    def __init__(
        self,
        model: RockModel,
        grid: CauseGrid | None = None,
        commissioning: int = COMMISSIONING,
        length: float = RUN_LENGTH,
    ) -> None:
        self._model, self._grid, self._wanted, self._length = model, grid, commissioning, length
        self._first: list[Array] = []
        self._watching: _Watching | None = None
        self._loads = [LoadState(name, 1.0, 1.0, 1.0, 0.0) for name in LOAD_GROUPS]

    def add(self, start_ns: int, log_powers: Array) -> WatchState:
        """Add a span; logarithms (k,) of its band powers, NaN of one that was not measured."""
        if self._watching is None:
            self._first.append(log_powers)
            fit = self._model.fit(log_powers, np.zeros(len(log_powers)))
            if len(self._first) >= self._wanted:
                self._watching = _Watching(self._model, self._grid, commission(self._model, self._first), self._length)
            self._loads = [_load(name, fit, place, None) for place, name in enumerate(LOAD_GROUPS)]
            return WatchState(len(self._first), tuple(self._loads), (), None)
        watching = self._watching
        fit = watching.add(start_ns, log_powers)
        found = [_load(name, fit, place, watching.baseline) for place, name in enumerate(LOAD_GROUPS)]
        self._loads = [_since(now, before, start_ns) for now, before in zip(found, self._loads, strict=True)]
        return WatchState(watching.baseline.spans, tuple(self._loads), watching.inputs, watching.alarm)

    @property
    def alarm(self) -> MachineAlarm | None:
        """The alarm that stands."""
        return None if self._watching is None else self._watching.alarm

    @property
    def offset(self) -> Array | None:
        """Logarithms (k,) of the band powers over the model's as the machine was commissioned; None before it is."""
        return None if self._watching is None else self._watching.baseline.offset

    def resume(self, alarm: MachineAlarm | None, since_ns: Mapping[str, int]) -> None:
        """Restore the alarm and the begins of changes of an earlier run, after its latest spans have been added again.

        Parameters
        ----------
        alarm : MachineAlarm or None
            That stood then.
        since_ns : mapping of str to int
            Begin of the change of each group of loads that had changed.
        """
        self._loads = [
            one
            if one.since_ns is None
            else replace(one, since_ns=min(one.since_ns, since_ns.get(one.name, one.since_ns)))
            for one in self._loads
        ]
        if alarm is not None and self._watching is not None:
            self._watching.resume(alarm)


class _Watching:
    """What follows the baseline."""

    def __init__(self, model: RockModel, grid: CauseGrid | None, baseline: MachineBaseline, length: float) -> None:
        self.baseline, self._model = baseline, model
        self.inputs: tuple[InputState, ...] = ()
        self.alarm: MachineAlarm | None = None
        self._chart = MachineChart(model, baseline, length)
        self._state = None if grid is None else MachineState(model, grid, self._chart)
        self._spans = np.inf  # since a change began
        self._share = 0.0  # of the limit that the chart has got to
        self._latest: deque[tuple[int, Array, Array]] = deque(maxlen=REMEMBERED)

    def add(self, start_ns: int, log_powers: Array) -> RockFit:
        point = self._chart.update(log_powers)
        self._latest.append((start_ns, log_powers, point.fit.residual))
        self._spans += 1.0
        self._share = point.distance / point.limit
        if self.alarm is None and point.signals:
            since = list(self._latest)[self._changed() :]
            self._spans = float(len(since))
            self.alarm = self._judge(since[0][0], [powers for _, powers, _ in since])
        elif self._share < _FALLEN:
            self.alarm, self._spans = None, np.inf
        elif self.alarm is not None and not (self.alarm.sensor or self.alarm.input) and self._spans <= _JUDGED:
            since = list(self._latest)[-int(self._spans) :]
            self.alarm = self._judge(self.alarm.since_ns, [powers for _, powers, _ in since])
        if self._state is not None:
            self._state.add(point.fit)
            faulty = self.alarm is not None and self.alarm.kind == "sensor"  # nothing is known of the machine then
            self.inputs = () if faulty else self._state.inputs(self._spans)
        if self.alarm is not None and self.alarm.kind == "machine":  # the longer it stands, the better it is known
            code, text = self._cause(point.limit)
            self.alarm = replace(self.alarm, text=text, input=code)
        return point.fit

    def resume(self, alarm: MachineAlarm) -> None:
        """Take over an alarm, unless it has fallen."""
        if self._share < _FALLEN:
            return
        now = self.alarm or alarm
        if alarm.since_ns <= now.since_ns:
            self._spans = np.inf
        self.alarm = replace(now, since_ns=min(alarm.since_ns, now.since_ns))

    def _judge(self, begin_ns: int, log_powers: list[Array]) -> MachineAlarm:
        sensor = sensor_fault(self._model, self.baseline, log_powers)
        if sensor is not None:
            channel = f"{sensor.point} {', '.join(sensor.axes)}"
            size = f"{sensor.gain:.3g} ({sensor.low:.3g} to {sensor.high:.3g})"
            return MachineAlarm("sensor", begin_ns, f"sensor: {sensor.kind} at {channel}, factor {size}", sensor)
        return MachineAlarm("machine", begin_ns, "", None)

    def _cause(self, limit: float) -> tuple[str, str]:
        """Return what of the machine has changed, as far as it is known: the input's code, and a line."""
        best = max(self.inputs, key=lambda one: one.probability, default=None)
        if best is not None and best.probability >= LIKELY and best.rest < limit:
            size = f"{best.value:.3g} ({best.low:.3g} to {best.high:.3g})"
            return best.name, f"machine: {best.name} is {size}, probability {best.probability:.2f}"
        farthest = int(np.argmax(np.abs(self._chart.mean) / np.sqrt(np.diag(self._chart.covariance))))
        name = self._model.scatter.transfer.statistics[farthest].name
        return "", f"machine: no single input explains it; farthest off: {name}"

    def _changed(self) -> int:
        """Return the span at which the change began: from where the residuals lean most to where the chart has got."""
        towards = scipy.linalg.solve(self._chart.covariance, self._chart.mean, assume_a="pos")
        lean = np.array([residual for *_, residual in self._latest]) @ towards
        sums, count = np.cumsum(lean[::-1]), np.arange(1, len(lean) + 1)
        return len(lean) - 1 - int(np.argmax(np.sign(sums) * np.square(sums) / count))


def _load(name: str, fit: RockFit, place: int, baseline: MachineBaseline | None) -> LoadState:
    """State of a group beside its baseline."""
    log, variance = float(fit.log_factors[place]), float(fit.covariance[place, place])
    low, value, high = (float(np.exp(log + reach * np.sqrt(variance))) for reach in (-_INTERVAL, 0.0, _INTERVAL))
    if baseline is None:
        return LoadState(name, value, low, high, 0.0)
    off = (log - baseline.log_factors[place]) / np.sqrt(variance + baseline.spread[place] ** 2)
    return LoadState(name, value, low, high, float(scipy.special.erf(abs(off) / np.sqrt(2.0))))


def _since(now: LoadState, before: LoadState, start_ns: int) -> LoadState:
    """Return a state with the begin of its change."""
    if now.probability < LIKELY:
        return now
    return replace(now, since_ns=start_ns if before.since_ns is None else before.since_ns)
