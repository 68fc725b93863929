"""What level is expected: by the limits of the simple alarm, else by what the last week's windows were."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter
from typing import Final

import numpy as np

from tbm_gsa.app.web.state import Band, Limits, PointCondition
from tbm_gsa.comparison import UsualRatio
from tbm_gsa.comparison.alarm import SCATTERS
from tbm_gsa.history.trends import TrendRow

LEAST_WINDOWS: Final = 30
"""Of the last week, without which nothing is usual: a minute of them."""


@dataclass(frozen=True)
class Expectation:
    """Limits of measured over computed RMS along x, by test point.

    Attributes
    ----------
    limits : mapping of str to Limits
    words : str
        What they are.
    """

    limits: Mapping[str, Limits]
    words: str

    def band(self, point: str, computed: float) -> Band:
        """Return the expected level, m/s², of a point at which the model computes one."""
        limits = self.limits.get(point)
        low, high = (math.nan, math.nan) if limits is None else (limits.low * computed, limits.high * computed)
        return Band(low=low, high=high)

    def condition(self, point: str, measured: float, computed: float) -> PointCondition:
        """Whether a level lies within its band."""
        band = self.band(point, computed)
        if not (math.isfinite(measured) and math.isfinite(band.high)):
            return "unknown"
        return "below" if measured < band.low else "above" if measured > band.high else "within"


def alarm_limits(
    points: Iterable[str], threshold: float, baseline: str, usual: Mapping[str, UsualRatio]
) -> Expectation:
    """Limits of the simple alarm (`AlarmRule`): absolute, or about what is usual by a baseline."""
    reach, limits = math.log1p(threshold), {}
    for point in points:
        mean, scatter = (float(np.asarray(value)[0]) for value in _axial(usual.get(point)))
        middle = 0.0 if math.isnan(mean) else mean
        width = max(reach, SCATTERS * scatter) if math.isfinite(scatter) else reach
        limits[point] = Limits(low=math.exp(middle - width), high=math.exp(middle + width))
    of = f"about the baseline {baseline}" if baseline else "about the model"
    return Expectation(limits, f"limits of the alarm, a factor of {1.0 + threshold:g} {of}")


def usual_limits(bins: Iterable[TrendRow]) -> Expectation:
    """Limits between which the windows of most bins lie, of points with enough of them: medians of the 5 and 95 %."""
    limits = {}
    ordered = sorted(bins, key=attrgetter("point"))
    for point, rows in groupby(ordered, key=attrgetter("point")):
        enough = [row for row in rows if row.windows >= LEAST_WINDOWS]
        if enough:
            low, high = np.median([[row.low, row.high] for row in enough], axis=0)
            limits[point] = Limits(low=float(low), high=float(high))
    return Expectation(limits, "usual of the last week, 5 to 95 % of the windows")


def _axial(usual: UsualRatio | None) -> tuple[object, object]:
    nothing = np.full(3, np.nan)
    return (nothing, nothing) if usual is None else (usual.mean, usual.scatter)
