"""Whether one sensor explains that the machine seems to have changed: gain, dead channel or noise.

Without the channel, or without all channels of the sensor, the others must be what they were; then what the channel
shows beside what they expect of it says the kind. A gain moves all its bands alike, noise adds power, most to the weak
bands. Anything else at one point is the machine nearby.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from tbm_gsa.explanation.rock_fit import RockModel
from tbm_gsa.explanation.sequential import MachineBaseline, MachineChart
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

FaultKind = Literal["gain", "dead", "noise"]
ORDINARY: Final = 0.01
"""Least probability of what the other channels show."""
DEAD: Final = 1e-4
"""Share of the expected power below which a channel is dead: a hundredth of the RMS, as everywhere."""
_LENGTH = 1000.0  # of the charts; their limit is not asked for
_SIGMAS = 3.0
_EVEN = 0.1  # of a gain's logarithm, by which bands may differ: rock and chance are known no better


@dataclass(frozen=True)
class SensorFault:
    """What is wrong with a sensor.

    Attributes
    ----------
    kind : {"gain", "dead", "noise"}
    point : str
    axes : tuple of str
        Its channels; all of the sensor if it is not one alone.
    gain, low, high : float
        Factor on the amplitude with its 90 % interval; of noise that of the mean of the bands.
    """

    kind: FaultKind
    point: str
    axes: tuple[str, ...]
    gain: float
    low: float
    high: float


def sensor_fault(model: RockModel, baseline: MachineBaseline, log_powers: Sequence[Array]) -> SensorFault | None:
    """Find the sensor whose fault explains spans since the change; None if none does.

    Parameters
    ----------
    model : RockModel
    baseline : MachineBaseline
    log_powers : sequence of ndarray, n of shape (k,)
        Of the spans since the change.

    Raises
    ------
    InputError
        No span.
    """
    if not len(log_powers):
        raise InputError("no span of time since the change: nothing can be said of a sensor")
    rows = np.array(log_powers)
    found = []
    for point, axes, inside in _candidates(model):
        if inside.all():
            continue
        fault, ordinary = _without(model, baseline, rows, point, axes, inside)
        if fault is not None:
            found.append((len(axes), -ordinary, fault))
    # One channel before a whole sensor, then the one without which the others are most ordinary.
    return min(found, key=lambda one: one[:2])[2] if found else None


def _candidates(model: RockModel) -> Iterator[tuple[str, tuple[str, ...], NDArray[np.bool_]]]:
    """Channels, then sensors: point, axes, and which statistics are theirs."""
    statistics = model.scatter.transfer.statistics
    channels = list(dict.fromkeys((one.point, one.axis) for one in statistics))
    for point, axis in channels:
        yield point, (axis,), np.array([(one.point, one.axis) == (point, axis) for one in statistics])
    for point in dict.fromkeys(point for point, _ in channels):
        axes = tuple(axis for other, axis in channels if other == point)
        if len(axes) > 1:
            yield point, axes, np.array([one.point == point for one in statistics])


def _without(
    model: RockModel,
    baseline: MachineBaseline,
    rows: Array,
    point: str,
    axes: tuple[str, ...],
    inside: NDArray[np.bool_],
) -> tuple[SensorFault | None, float]:
    """Fault of channels, if the others are what they were without them, and how ordinary those are."""
    chart = MachineChart(model, baseline, _LENGTH)
    shifts, ordinary, within = [], 0.0, np.ix_(inside, inside)
    scatter = np.zeros((int(inside.sum()), int(inside.sum())))
    for row in rows:
        others = np.where(inside, np.nan, row)
        if not np.isfinite(others).any():
            return None, 0.0
        now = chart.update(others)
        ordinary = now.surprise
        shifts.append((row - baseline.offset - model.expected(now.fit))[inside])
        slope = now.fit.slope[inside]
        scatter += now.fit.chance[within] + slope @ now.fit.covariance @ slope.T
    if ordinary < ORDINARY:
        return None, ordinary
    measured = np.isfinite(shifts).any(axis=0)
    if not measured.any():
        return None, ordinary
    shift = np.nanmean(np.array(shifts)[:, measured], axis=0)
    scatter = scatter / len(rows) ** 2 + baseline.chance[within] / baseline.spans
    return _kind(point, axes, shift, scatter[np.ix_(measured, measured)]), ordinary


def _kind(point: str, axes: tuple[str, ...], shift: Array, scatter: Array) -> SensorFault | None:
    """Fault that shows as shifts (b,) of the logarithms of bands with their covariance (b, b)."""
    spread = np.sqrt(np.diag(scatter))
    weight = scipy.linalg.solve(scatter, np.ones(len(shift)), assume_a="pos")
    mean, sigma = float(weight @ shift / weight.sum()), float(1.0 / np.sqrt(weight.sum()))
    if abs(mean) < _SIGMAS * sigma:
        return None
    even = bool((np.abs(shift - mean) < _SIGMAS * spread + _EVEN * abs(mean)).all())
    kind: FaultKind
    if mean < np.log(DEAD):
        kind = "dead"
    elif even:
        kind = "gain"
    elif (shift > -_SIGMAS * spread).all():
        kind = "noise"
    else:
        return None
    low, gain, high = (float(np.exp(0.5 * (mean + reach * 1.645 * sigma))) for reach in (-1.0, 0.0, 1.0))
    return SensorFault(kind, point, axes, gain, low, high)
