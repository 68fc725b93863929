"""A recording against the model, after the event: per test point, axis and window."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from tbm_gsa.signals.clock import sampling_rate
from tbm_gsa.signals.conditioning import Band, Frame, common_band, ordered
from tbm_gsa.signals.estimates import SignalStatistics, estimate, field_sample, level_shares, model_sample
from tbm_gsa.signals.intervals import Interval, error_interval
from tbm_gsa.signals.reduction import ReducedSignal, SignalReducer
from tbm_gsa.signals.settings import Settings, band_name
from tbm_gsa.signals.statistics import coverage, kurtosis, ratio, relative_error, rms
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError


class Record(Protocol):
    """What a comparison needs of a recording: time (n,) s, values (n, 3) m/s², nominal rate Hz."""

    @property
    def time(self) -> Array: ...  # noqa: D102
    @property
    def values(self) -> Array: ...  # noqa: D102
    @property
    def rate_hz(self) -> float: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class Windows:
    """Window by window along one axis; all arrays have shape (w,), NaN where a window holds no sample.

    Attributes
    ----------
    start : ndarray
        s after the first recorded sample.
    level : ndarray
        Level of operation, −1 of a window that belongs to none.
    coverage : ndarray
        Recorded share of the window.
    relative_error : ndarray
        Equation (4) against the whole model run at the level, which has no window that would be simultaneous.
    field_rms, field_peak : ndarray
        m/s².
    field_crest_factor, field_kurtosis : ndarray
    field_velocity_rms : ndarray
        m/s.
    field_band_rms : mapping of str to ndarray
        m/s².
    field_line_hz : ndarray
        Highest line of the window's own spectrum.
    """

    start: Array
    level: Integers
    coverage: Array
    relative_error: Array
    field_rms: Array
    field_peak: Array
    field_crest_factor: Array
    field_kurtosis: Array
    field_velocity_rms: Array
    field_band_rms: Mapping[str, Array]
    field_line_hz: Array

    def arrays(self) -> dict[str, Array]:
        """Arrays by name, without the bands."""
        return {item.name: getattr(self, item.name) for item in fields(self) if item.name != "field_band_rms"}


@dataclass(frozen=True, eq=False)
class LevelComparison:
    """One axis of one test point at one level of operation."""

    field: SignalStatistics
    model: SignalStatistics
    relative_error: float
    error_interval: Interval


@dataclass(frozen=True, eq=False)
class AxisComparison:
    """One axis of one test point.

    Attributes
    ----------
    field, model : SignalStatistics
        Over all windows at a level; the model's levels count as long as they were recorded.
    relative_error : float
    error_interval : (float, float)
    windows : Windows
    levels : mapping of int to LevelComparison
    """

    field: SignalStatistics
    model: SignalStatistics
    relative_error: float
    error_interval: Interval
    windows: Windows
    levels: Mapping[int, LevelComparison]


@dataclass(frozen=True, eq=False)
class PointComparison:
    """One test point.

    Attributes
    ----------
    axes : mapping of str to AxisComparison
        ``x y z``, or ``x yz`` of a sensor that turns with the head.
    band : Band
        What was compared, Hz.
    coverage : float
        Recorded share of the time from the first to the last sample, in stretches long enough to condition.
    field, model : ReducedSignal
        The signals; the model's at the level that was held longest.
    """

    axes: Mapping[str, AxisComparison]
    band: Band
    coverage: float
    field: ReducedSignal
    model: ReducedSignal


@dataclass(frozen=True, eq=False)
class Comparison:
    """All test points of a recording."""

    points: Mapping[str, PointComparison]
    window_s: float


def compare_records(
    field: Mapping[str, Record],
    model: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    frames: Mapping[str, Frame] | None = None,
    settings: Settings | None = None,
) -> Comparison:
    """Compare a recording with the model at every recorded test point, both in memory and at one level of operation.

    Parameters
    ----------
    field : mapping of str to Record
        Recorded accelerations by test point, in the machine axes.
    model : mapping of str to (array_like, array_like)
        Computed ones: time (m,) s and acceleration (m, 3) m/s².
    frames : mapping of str to {"fixed", "rotating"}
        Sensors that turn with the head; the others are fixed.
    settings : Settings
        Windows, bands, lines.

    Returns
    -------
    Comparison
    """
    missing = sorted(set(field) - set(model))
    if missing:
        raise InputError(f"the model has no test point {', '.join(missing)}; it has {', '.join(sorted(model))}")
    chosen, turning = settings or Settings(), frames or {}
    points = {}
    for name, record in field.items():
        try:
            model_rate = sampling_rate(model[name][0])
            band = compared_band(record.rate_hz, model_rate, chosen)
            frame = turning.get(name, "fixed")
            measured = _reduced(record.time, record.values, SignalReducer(record.rate_hz, band, frame, chosen))
            predicted = _reduced(*model[name], SignalReducer(model_rate, band, frame, chosen))
            points[name] = compare_signals(measured, {0: predicted}, chosen)
        except InputError as error:
            raise InputError(f"test point {name}: {error}") from error
    return Comparison(points, chosen.window_s)


def compared_band(field_rate_hz: float, model_rate_hz: float, settings: Settings) -> Band:
    """Band that both signals carry, or up to what the settings say."""
    band = common_band(field_rate_hz, model_rate_hz)
    return band if settings.high_hz is None else Band(band.low, settings.high_hz)


def compare_signals(field: ReducedSignal, model: Mapping[int, ReducedSignal], settings: Settings) -> PointComparison:
    """Compare what is left of both signals of a test point.

    Parameters
    ----------
    field : ReducedSignal
    model : mapping of int to ReducedSignal
        The model's run at each level of operation. Windows of the recording at another level are left out.
    settings : Settings

    Raises
    ------
    InputError
        No window of the recording belongs to a level.
    """
    shares = level_shares(field, model)
    if not shares:
        raise InputError("no window at a steady level of operation")
    measured, predicted = _both(field, model, shares, settings)
    apart = {level: {level: 1.0} for level in shares if level in field.spectra}
    by_level = {
        level: _both(field, model, share, settings) if len(shares) > 1 else (measured, predicted)
        for level, share in apart.items()
    }
    axes = {}
    for number, axis in enumerate(field.axes):
        levels = {
            level: LevelComparison(a[axis], b[axis], *_error(a[axis], b[axis])) for level, (a, b) in by_level.items()
        }
        model_rms = {level: one.model.rms for level, one in levels.items()}
        windows = _windows(field, number, model_rms, settings)
        error = _error(measured[axis], predicted[axis])
        axes[axis] = AxisComparison(measured[axis], predicted[axis], *error, windows, levels)
    share = coverage(float(field.windows.count.sum()), field.rate_hz, field.duration)
    return PointComparison(axes, field.band, share, field, model[max(shares, key=shares.__getitem__)])


def _reduced(time: ArrayLike, values: ArrayLike, reducer: SignalReducer) -> ReducedSignal:
    stamps, rows = ordered(time, values)
    reducer.feed(stamps - stamps[:1], rows)
    return reducer.finish()


def _both(
    field: ReducedSignal, model: Mapping[int, ReducedSignal], shares: Mapping[int, float], settings: Settings
) -> tuple[dict[str, SignalStatistics], dict[str, SignalStatistics]]:
    """Statistics of field and model over some levels, by axis."""
    return (
        estimate(field_sample(field, shares), field, settings),
        estimate(model_sample(model, shares), next(iter(model.values())), settings),
    )


def _error(field: SignalStatistics, model: SignalStatistics) -> tuple[float, Interval]:
    widths = field.rms_width, model.rms_width
    return float(relative_error(field.rms, model.rms)), error_interval(field.rms, model.rms, widths)


def _windows(field: ReducedSignal, axis: int, model_rms: Mapping[int, float], settings: Settings) -> Windows:
    """Every whole window from the first sample on, recorded or not."""
    length, table = settings.window_s, field.windows
    # A sensor clock that drifts makes the last window short by a sample or two: it counts.
    count = math.floor(field.duration / length + 1e-3)
    there = table.index < count
    place = table.index[there]

    def dense(values: Array) -> Array:
        whole = np.full(count, np.nan)
        whole[place] = values[there]
        return whole

    level = np.full(count, -1, dtype=np.int64)
    level[place] = field.level[there]
    root = rms(table.count, table.moments)[:, axis]
    bands = np.sqrt(ratio(table.bands[:, :, axis], table.count[:, None]))
    return Windows(
        start=length * np.arange(count, dtype=np.float64),
        level=level,
        coverage=np.minimum(1.0, np.nan_to_num(dense(table.count)) / (field.rate_hz * length)),
        relative_error=relative_error(dense(root), [model_rms.get(int(one), math.nan) for one in level]),
        field_rms=dense(root),
        field_peak=dense(table.peak[:, axis]),
        field_crest_factor=dense(ratio(table.peak[:, axis], root)),
        field_kurtosis=dense(kurtosis(table.count, table.moments)[:, axis]),
        field_velocity_rms=dense(np.sqrt(ratio(table.velocity[:, axis], table.count))),
        field_band_rms={band_name(*limits): dense(bands[:, i]) for i, limits in enumerate(settings.bands)},
        field_line_hz=dense(table.line[:, axis]),
    )
