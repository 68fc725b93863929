"""What a comparison says of a recording, as statistics that a campaign can compute."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from scipy.stats import norm

from tbm_gsa.comparison.results import AxisResult, ComparisonResult
from tbm_gsa.reading import Interval
from tbm_gsa.sensitivity.study.errors import StudyError

Side = tuple[float | None, Interval | None]
"""Value of a statistic and its interval."""
FEWEST: Final = 2


@dataclass(frozen=True)
class Statistic:
    """One statistic of a recording beside the model's.

    Attributes
    ----------
    name : str
        As an output of a study, e.g. ``rms_cutterhead_x``.
    field, model : float
        m/s².
    deviation : float
        Standard deviation of the logarithm of field over model, from the confidence intervals of both.
    """

    name: str
    field: float
    model: float
    deviation: float

    @property
    def log_ratio(self) -> float:
        """Logarithm of field over model."""
        return math.log(self.field) - math.log(self.model)


@dataclass(frozen=True)
class Observed:
    """The statistics of a recording, and up to which frequency its signals were compared.

    Attributes
    ----------
    statistics : tuple of Statistic
    high_hz : float
    """

    statistics: tuple[Statistic, ...]
    high_hz: float


def observed(comparison: ComparisonResult) -> Observed:
    """RMS and band RMS of every point and axis of a comparison.

    The RMS of a point whose band ends elsewhere than that of the narrowest point is left out, and so are bands that
    reach beyond its end, and what is zero or unknown on either side.

    Raises
    ------
    StudyError
        Too few statistics.
    """
    high_hz = min(band.high_hz for band in comparison.bands.values())
    found = tuple(
        statistic
        for point, axes in comparison.points.items()
        for axis, compared in axes.items()
        for name, sides in _sides(compared, comparison.bands[point].high_hz, high_hz)
        for statistic in _one(f"{name}_{point}_{axis}", sides, comparison.confidence)
    )
    if len(found) < FEWEST:
        raise StudyError(f"the comparison has {len(found)} statistics with an interval on both sides, needs {FEWEST}")
    return Observed(found, high_hz)


def _sides(compared: AxisResult, own_high_hz: float, high_hz: float) -> Iterator[tuple[str, tuple[Side, Side]]]:
    """Names of statistics with their value and interval in the field and in the model."""
    intervals = compared.intervals
    if math.isclose(own_high_hz, high_hz, rel_tol=0.02):
        yield "rms", ((compared.field_rms, intervals.field_rms), (compared.model_rms, intervals.model_rms))
    for band, field in compared.field_band_rms.items():
        if float(band.removesuffix("_hz").split("-")[1]) <= high_hz:
            model = compared.model_band_rms[band], intervals.model_band_rms[band]
            yield f"rms_{band}", ((field, intervals.field_band_rms[band]), model)


def _one(name: str, sides: tuple[Side, Side], confidence: float) -> Iterator[Statistic]:
    reach = 2.0 * float(norm.ppf(0.5 + 0.5 * confidence))
    values, variance = [], 0.0
    for value, interval in sides:
        if not value or interval is None or interval[0] <= 0.0:
            return
        values.append(value)
        variance += ((math.log(interval[1]) - math.log(interval[0])) / reach) ** 2
    yield Statistic(name, values[0], values[1], math.sqrt(variance))
