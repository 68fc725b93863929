"""What a comparison says of a recording, as statistics that a campaign can compute."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from scipy.stats import norm

from tbm_gsa.sensitivity.study.errors import StudyError

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


def observed(document: Mapping[str, Any]) -> Observed:
    """Read RMS and band RMS of every point and axis from the document of a comparison.

    The RMS of a point whose band ends elsewhere than that of the narrowest point is left out, and so are bands that
    reach beyond its end, and what is zero or unknown on either side.

    Raises
    ------
    StudyError
        No such document, or too few statistics in it.
    """
    try:
        confidence = float(document["confidence"])
        high_hz = min(float(band["high_hz"]) for band in document["bands"].values())
        found = tuple(
            statistic
            for point, axes in document["points"].items()
            for axis, compared in axes.items()
            for statistic in _statistics(
                point, axis, compared, float(document["bands"][point]["high_hz"]), high_hz, confidence
            )
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise StudyError(f"not the JSON document of `tbm-monitor compare` ({type(error).__name__}: {error})") from None
    if len(found) < FEWEST:
        raise StudyError(f"the comparison has {len(found)} statistics with an interval on both sides, needs {FEWEST}")
    return Observed(found, high_hz)


def _statistics(
    point: str, axis: str, compared: Mapping[str, Any], own_high_hz: float, high_hz: float, confidence: float
) -> Iterator[Statistic]:
    intervals = compared["intervals"]
    sides = [(compared[f"{side}_rms"], intervals[f"{side}_rms"]) for side in ("field", "model")]
    if math.isclose(own_high_hz, high_hz, rel_tol=0.02):
        yield from _one(f"rms_{point}_{axis}", sides, confidence)
    for band in compared["field_band_rms"]:
        sides = [(compared[f"{s}_band_rms"][band], intervals[f"{s}_band_rms"][band]) for s in ("field", "model")]
        if float(band.removesuffix("_hz").split("-")[1]) <= high_hz:
            yield from _one(f"rms_{band}_{point}_{axis}", sides, confidence)


def _one(name: str, sides: list[tuple[float | None, list[float] | None]], confidence: float) -> Iterator[Statistic]:
    reach = 2.0 * float(norm.ppf(0.5 + 0.5 * confidence))
    values, variance = [], 0.0
    for value, interval in sides:
        if not value or interval is None or interval[0] <= 0.0:
            return
        values.append(value)
        variance += ((math.log(interval[1]) - math.log(interval[0])) / reach) ** 2
    yield Statistic(name, values[0], values[1], math.sqrt(variance))
