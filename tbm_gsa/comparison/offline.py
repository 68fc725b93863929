"""A recording against the model, after the event: per test point, axis and window."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from tbm_gsa.arrays import Array
from tbm_gsa.comparison.conditioning import (
    Band,
    Conditioned,
    Frame,
    common_band,
    compared_axes,
    condition,
    sampling_rate,
)
from tbm_gsa.comparison.statistics import (
    Line,
    Spectrum,
    band_rms,
    coverage,
    crest_factor,
    kurtosis,
    match_lines,
    peak,
    relative_error,
    rms,
    strongest_lines,
    welch_spectrum,
)

G = 9.80665  # m/s²


class Record(Protocol):
    """What a comparison needs of a recording: time (n,) s, values (n, 3) m/s², nominal rate Hz."""

    @property
    def time(self) -> Array: ...  # noqa: D102
    @property
    def values(self) -> Array: ...  # noqa: D102
    @property
    def rate_hz(self) -> float: ...  # noqa: D102


@dataclass(frozen=True)
class Settings:
    """How to compare.

    Attributes
    ----------
    window_s : float
        Length of a window.
    high_hz : float or None
        Upper limit of the band; by default what `common_band` gives.
    bands : tuple of (float, float)
        Bands whose RMS is given, Hz.
    expected_lines : mapping of str to float
        Frequencies in Hz by name, e.g. the loads' lines and the mesh frequency.
    line_count : int
        Strongest lines per axis.
    resolution_hz : float
        Of the spectra.
    """

    window_s: float = 2.0
    high_hz: float | None = None
    bands: tuple[tuple[float, float], ...] = ((0.5, 20.0), (100.0, 110.0), (125.0, 135.0), (200.0, 210.0))
    expected_lines: Mapping[str, float] = field(default_factory=dict)
    line_count: int = 5
    resolution_hz: float = 0.25


@dataclass(frozen=True, eq=False)
class SignalStatistics:
    """Statistics of one signal along one compared axis, m/s²."""

    rms: float
    peak: float
    crest_factor: float
    kurtosis: float
    band_rms: Mapping[str, float]
    lines: tuple[Line, ...]
    spectrum: Spectrum


@dataclass(frozen=True, eq=False)
class Windows:
    """Window by window; all arrays have shape (w,).

    Attributes
    ----------
    start : ndarray
        s after the first recorded sample.
    field_rms : ndarray
        m/s²; NaN where a window holds no sample.
    relative_error, coverage : ndarray
        Equation (4) against the whole model run, which has no window that would be simultaneous; recorded share of the
        window.
    """

    start: Array
    field_rms: Array
    relative_error: Array
    coverage: Array


@dataclass(frozen=True, eq=False)
class AxisComparison:
    """One axis of one test point."""

    field: SignalStatistics
    model: SignalStatistics
    relative_error: float
    windows: Windows


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
    field_rate_hz, model_rate_hz : float
        Sampling rates.
    """

    axes: Mapping[str, AxisComparison]
    band: Band
    coverage: float
    field_rate_hz: float
    model_rate_hz: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """All test points of a recording."""

    points: Mapping[str, PointComparison]
    window_s: float

    def to_dict(self) -> dict[str, Any]:
        """Give what JSON can hold, in m/s² and Hz unless a key ends in ``_g``; null where a number is not defined."""
        points = {name: {axis: _axis_dict(point, axis) for axis in point.axes} for name, point in self.points.items()}
        return {"window_s": self.window_s, "points": points}


def compare_records(
    field: Mapping[str, Record],
    model: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    frames: Mapping[str, Frame] | None = None,
    settings: Settings | None = None,
) -> Comparison:
    """Compare a recording with the model at every recorded test point.

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
        raise ValueError(f"the model has no test point {', '.join(missing)}; it has {', '.join(sorted(model))}")
    chosen, turning = settings or Settings(), frames or {}
    points = {
        name: _compare_point(name, record, model[name], turning.get(name, "fixed"), chosen)
        for name, record in field.items()
    }
    return Comparison(points, chosen.window_s)


def _compare_point(
    name: str, record: Record, computed: tuple[ArrayLike, ArrayLike], frame: Frame, settings: Settings
) -> PointComparison:
    try:
        model_rate = sampling_rate(computed[0])
        band = common_band(record.rate_hz, model_rate)
        if settings.high_hz is not None:
            band = Band(band.low, settings.high_hz)
        measured = condition(record.time, record.values, record.rate_hz, band)
        predicted = condition(*computed, model_rate, band)
    except ValueError as error:
        raise ValueError(f"test point {name}: {error}") from error
    axes = {
        axis: _compare_axis(_columns(measured, columns), _columns(predicted, columns), band, settings)
        for axis, columns in compared_axes(frame).items()
    }
    share = coverage(len(measured.values), record.rate_hz, measured.duration)
    return PointComparison(axes, band, share, record.rate_hz, model_rate)


def _compare_axis(measured: "_Columns", predicted: "_Columns", band: Band, settings: Settings) -> AxisComparison:
    field_statistics = _statistics(measured, band, settings)
    model_statistics = _statistics(predicted, band, settings)
    error = float(relative_error(field_statistics.rms, model_statistics.rms))
    return AxisComparison(field_statistics, model_statistics, error, _windows(measured, model_statistics.rms, settings))


@dataclass(frozen=True, eq=False)
class _Columns:
    """The one or two columns of a conditioned signal that make up a compared axis."""

    rate_hz: float
    time: Array  # (n,) s after the first recorded sample
    duration: float  # s
    segments: tuple[Array, ...]  # (n_i, c) m/s²

    @property
    def amplitude(self) -> Array:
        """The signal itself, or the length of the vector of two columns, (n,), m/s²."""
        values = np.concatenate(self.segments)
        return values[:, 0] if values.shape[1] == 1 else np.hypot(values[:, 0], values[:, 1])


def _columns(signal: Conditioned, columns: tuple[int, ...]) -> _Columns:
    segments = tuple(segment.values[:, columns] for segment in signal.segments)
    return _Columns(signal.rate_hz, signal.time - signal.origin, signal.duration, segments)


def _statistics(signal: _Columns, band: Band, settings: Settings) -> SignalStatistics:
    amplitude = signal.amplitude
    spectrum = welch_spectrum(signal.segments, signal.rate_hz, settings.resolution_hz)
    inside = spectrum.frequency <= band.high
    spectrum = Spectrum(spectrum.frequency[inside], spectrum.density[inside])
    lines = match_lines(strongest_lines(spectrum, settings.line_count), settings.expected_lines)
    bands = {
        f"{low:g}-{high:g}_hz": float(np.linalg.norm(band_rms(signal.segments, signal.rate_hz, low, high)))
        for low, high in settings.bands
    }
    return SignalStatistics(
        rms=float(rms(amplitude)),
        peak=float(peak(amplitude)),
        crest_factor=float(crest_factor(amplitude)),
        kurtosis=float(kurtosis(amplitude)),
        band_rms=bands,
        lines=lines,
        spectrum=spectrum,
    )


def _windows(measured: _Columns, model_rms: float, settings: Settings) -> Windows:
    length = settings.window_s
    # A sensor clock that drifts makes the last window short by a sample or two: it counts.
    count = math.floor(measured.duration / length + 1e-3)
    field_rms, recorded = _window_rms(measured, length, count)
    share = np.minimum(1.0, recorded / (measured.rate_hz * length))
    start = length * np.arange(count, dtype=np.float64)
    return Windows(start, field_rms, relative_error(field_rms, model_rms), share)


def _window_rms(signal: _Columns, length: float, count: int) -> tuple[Array, Array]:
    """RMS and number of samples of `count` windows from the first sample on, each (count,)."""
    window = np.floor(signal.time / length + 1e-6).astype(np.int64)
    inside = window < count
    samples = np.bincount(window[inside], minlength=count)
    squares = np.bincount(window[inside], np.square(signal.amplitude[inside]), minlength=count)
    with np.errstate(invalid="ignore"):
        return np.sqrt(squares / samples), samples.astype(np.float64)


def _axis_dict(point: PointComparison, axis: str) -> dict[str, Any]:
    compared = point.axes[axis]
    sides = {"field": compared.field, "model": compared.model}
    result: dict[str, Any] = {"relative_error": _number(compared.relative_error), "coverage": point.coverage}
    for side, statistics in sides.items():
        for name in ("rms", "peak", "crest_factor", "kurtosis"):
            result[f"{side}_{name}"] = _number(getattr(statistics, name))
        result[f"{side}_rms_g"] = statistics.rms / G
        result[f"{side}_band_rms"] = dict(statistics.band_rms)
        result[f"{side}_lines"] = [
            {"frequency_hz": line.frequency, "rms": line.rms, "match": line.match} for line in statistics.lines
        ]
    windows = compared.windows
    result["windows"] = {
        name: [_number(value) for value in getattr(windows, name).tolist()]
        for name in ("start", "field_rms", "relative_error", "coverage")
    }
    return result


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
