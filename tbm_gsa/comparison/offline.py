"""Reduced signals of field and model → results of a test point: per axis, window and level of operation."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tbm_gsa.comparison.results import (
    AxisResult,
    AxisSpectra,
    LevelAxis,
    LevelIntervals,
    PointBand,
    SpectralPeak,
    SpectrumResult,
    WindowColumns,
    finite,
    finite_interval,
    rounded,
)
from tbm_gsa.signals.conditioning import LOW_PASS_LIMIT_HZ, LOW_PASS_SHARE, Band, common_band
from tbm_gsa.signals.estimates import STATISTICS, SignalStatistics, estimate, level_shares
from tbm_gsa.signals.intervals import error_interval
from tbm_gsa.signals.reduction import ReducedSignal, Series
from tbm_gsa.signals.settings import Settings, band_name
from tbm_gsa.signals.spectrogram import Spectrogram
from tbm_gsa.signals.statistics import coverage, kurtosis, ratio, relative_error, rms
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.units import STANDARD_GRAVITY

_DRIFT = 1e-3  # of a sensor's clock, whose nominal rate carries the band


@dataclass(frozen=True, eq=False)
class PointComparison:
    """Results of one test point, as `ComparisonResult` holds them by point.

    Attributes
    ----------
    axes, spectra : mapping of str to AxisResult, AxisSpectra
        ``x y z``, or ``x yz`` of a sensor that turns with the head.
    band : PointBand
    levels : mapping of int to (mapping of str to LevelAxis)
        By level and axis; a level at which this point has no spectrum is not there.
    excerpts : (Series, Series)
        A second of field and model along x; of the model at the level that was held longest.
    spectrograms : (Spectrogram, Spectrogram) or None
        Likewise, of the whole recording and run; None unless asked for, and where the sensor has no such axis.
    """

    axes: Mapping[str, AxisResult]
    spectra: Mapping[str, AxisSpectra]
    band: PointBand
    levels: Mapping[int, Mapping[str, LevelAxis]]
    excerpts: tuple[Series, Series]
    spectrograms: tuple[Spectrogram, Spectrogram] | None


def compared_band(field_rate_hz: float, model_rate_hz: float, settings: Settings) -> Band:
    """Band that both signals carry, or up to what the settings say.

    Raises
    ------
    InputError
        One of the signals does not carry that.
    """
    band = common_band(field_rate_hz, model_rate_hz)
    if settings.high_hz is None:
        return band
    most = LOW_PASS_SHARE * min(field_rate_hz, model_rate_hz)
    if settings.high_hz > most * (1.0 + _DRIFT):
        raise InputError(f"band up to {settings.high_hz:g} Hz, allowed: up to {most:.5g}, 0.4 of the sampling rate")
    return Band(band.low, settings.high_hz)


def highest_hz(settings: Settings) -> float:
    """Upper limit of the band of signals whose rates do not limit it, Hz."""
    return LOW_PASS_LIMIT_HZ if settings.high_hz is None else settings.high_hz


def compare_signals(
    field: ReducedSignal,
    model: ReducedSignal,
    settings: Settings,
    measured: tuple[bool, bool, bool] = (True, True, True),
) -> PointComparison:
    """Comparison of what is left of both signals of a test point.

    Parameters
    ----------
    field, model : ReducedSignal
        Windows of the recording at a level that the model was not run at are left out.
    settings : Settings
    measured : tuple of bool
        Whether the sensor measures along x, y and z; what it does not measure is nothing, and not zero.

    Raises
    ------
    InputError
        No window of the recording belongs to a level, or the sensor measures along no axis of the machine.
    """
    if not any(measured):
        raise InputError("the sensor measures none of the machine's axes by itself, by the mapping's axes and rotation")
    shares = level_shares(field, np.unique(model.level).tolist())
    if not shares:
        raise InputError("no window at a steady level of operation")
    both = _statistics(field, model, shares, settings, measured)
    by_level = {
        level: _statistics(field, model, {level: 1.0}, settings, measured) if len(shares) > 1 else both
        for level in shares
        if level in field.spectra
    }
    levels = {level: {axis: _level_axis(*sides) for axis, sides in at.items()} for level, at in by_level.items()}
    share = coverage(float(field.windows.count.sum()), field.rate_hz, field.duration)
    axes = {}
    for number, (axis, (first, *_)) in enumerate(field.axes.items()):
        model_rms = {level: found[axis].model_rms for level, found in levels.items()}
        windows = _windows(field, number, model_rms, settings, recorded=measured[first])
        axes[axis] = _axis(*both[axis], share if measured[first] else None, windows)
    return PointComparison(
        axes,
        {axis: AxisSpectra(field=_spectrum(one), model=_spectrum(other)) for axis, (one, other) in both.items()},
        PointBand(
            low_hz=field.band.low, high_hz=field.band.high, field_rate_hz=field.rate_hz, model_rate_hz=model.rate_hz
        ),
        levels,
        (
            field.excerpt if measured[0] else replace(field.excerpt, values=math.nan * field.excerpt.values),
            model.excerpt,
        ),
        (field.spectrogram, model.spectrogram) if measured[0] and field.spectrogram and model.spectrogram else None,
    )


def _statistics(
    field: ReducedSignal,
    model: ReducedSignal,
    shares: Mapping[int, float],
    settings: Settings,
    measured: tuple[bool, bool, bool],
) -> dict[str, tuple[SignalStatistics, SignalStatistics]]:
    """Statistics of field and model over some levels, by axis."""
    found, computed = (estimate(signal, shares, settings) for signal in (field, model))
    return {
        axis: (found[axis] if measured[first] else found[axis].undefined(), computed[axis])
        for axis, (first, *_) in field.axes.items()
    }


def _level_axis(field: SignalStatistics, model: SignalStatistics) -> LevelAxis:
    error_limits = error_interval(field.rms, model.rms, (field.rms_width, model.rms_width))
    return LevelAxis(
        field_rms=finite(field.rms),
        model_rms=finite(model.rms),
        relative_error=finite(float(relative_error(field.rms, model.rms))),
        intervals=LevelIntervals(
            field_rms=finite_interval(field.intervals["rms"]),
            model_rms=finite_interval(model.intervals["rms"]),
            relative_error=finite_interval(error_limits),
        ),
    )


def _axis(
    field: SignalStatistics, model: SignalStatistics, recorded_share: float | None, windows: WindowColumns
) -> AxisResult:
    whole = _level_axis(field, model)
    values: dict[str, object] = {"relative_error": whole.relative_error, "coverage": recorded_share}
    intervals: dict[str, object] = {"relative_error": whole.intervals.relative_error}
    bands = windows.field_band_rms.keys()
    for side, found in (("field", field), ("model", model)):
        values |= {f"{side}_{name}": finite(found.values[name]) for name in STATISTICS}
        intervals |= {f"{side}_{name}": finite_interval(found.intervals[name]) for name in STATISTICS}
        values[f"{side}_band_rms"] = {name: finite(found.values[name]) for name in bands}
        intervals[f"{side}_band_rms"] = {name: finite_interval(found.intervals[name]) for name in bands}
        values[f"{side}_rms_g"] = finite(found.rms / STANDARD_GRAVITY)
        values[f"{side}_lines"] = _peaks(found)
    return AxisResult.model_validate({**values, "intervals": intervals, "windows": windows})


def _peaks(statistics: SignalStatistics) -> tuple[SpectralPeak, ...]:
    low, high = (math.sqrt(factor) for factor in statistics.density_factors)
    return tuple(
        SpectralPeak(
            frequency_hz=line.frequency,
            rms=finite(line.rms),
            match=line.match,
            interval=finite_interval((low * line.rms, high * line.rms)),
        )
        for line in statistics.lines
    )


def _spectrum(statistics: SignalStatistics) -> SpectrumResult:
    spectrum = statistics.spectrum
    return SpectrumResult(
        resolution_hz=float(spectrum.frequency[1]),
        density=rounded(spectrum.density.tolist()),
        segments=float(spectrum.segments),
        interval_factors=statistics.density_factors,
    )


def _windows(
    field: ReducedSignal, axis: int, model_rms: Mapping[int, float | None], settings: Settings, *, recorded: bool
) -> WindowColumns:
    """Every whole window that holds a sample: what was not recorded costs nothing, however long it took.

    None along an axis that was not `recorded`.

    The error is against the whole model run at the level, which has no window that would be simultaneous.
    """
    length = settings.window_s
    # A sensor clock that drifts makes the last window short by a sample or two: it counts.
    whole = (field.windows.index < math.floor(field.duration / length + 1e-3)) & recorded
    table, level = field.windows.where(whole), field.level[whole].tolist()
    computed = np.array([model_rms.get(one) for one in level], dtype=np.float64)
    root = rms(table.count, table.moments)[:, axis]
    bands = np.sqrt(ratio(table.bands[:, :, axis], table.count[:, None]))
    bands[:, [low >= field.band.high for low, _ in settings.bands]] = math.nan
    columns = {
        "coverage": np.minimum(1.0, table.count / (field.rate_hz * length)),
        "relative_error": relative_error(root, computed),
        "field_rms": root,
        "field_peak": table.peak[:, axis],
        "field_crest_factor": ratio(table.peak[:, axis], root),
        "field_kurtosis": kurtosis(table.count, table.moments)[:, axis],
        "field_velocity_rms": np.sqrt(ratio(table.velocity[:, axis], table.count)),
        "field_line_hz": table.line[:, axis],
    }
    return WindowColumns(
        start=tuple(round(one, 9) for one in (length * table.index).tolist()),  # of months, too, to the nanosecond
        **{name: rounded(values.tolist()) for name, values in columns.items()},
        level=tuple(None if one < 0 else one for one in level),
        field_band_rms={band_name(*limits): rounded(bands[:, i].tolist()) for i, limits in enumerate(settings.bands)},
    )
