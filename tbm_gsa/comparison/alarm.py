"""When the level of a test point counts as an alarm.

What counts is the logarithm of measured over computed RMS, which grows and falls alike and without bound; the relative
error does not: whatever grows, it stays below 1. Without a baseline a window counts when the larger of both is over the
smaller by more than the threshold, as a share. With one the change counts, for the model of a sound drive errs too: a
window counts when measured over computed has changed by more than that against the baseline's mean, and by more than
three times the baseline's scatter. An alarm is a number of such windows in a row; windows without a known error, and
sensors that measure next to nothing, neither raise nor clear it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tbm_gsa.comparison.live import WindowResult
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

SCATTERS = 3.0
DEAD_SHARE = 0.01  # of what is usual; a sensor that measures less is dead, and its error as large as you like


BLIND: Final = 2.0
"""Factor of a change that an alarm should see: a baseline that scatters more makes a point blind."""
_AXES: Final = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class UsualRatio:
    """Logarithm of measured over computed RMS at a test point of a sound machine.

    Attributes
    ----------
    mean, scatter : array_like, shape (3,)
        Of the windows of a baseline, along x, y and z; NaN of an axis without one: its threshold is absolute.
    """

    mean: ArrayLike
    scatter: ArrayLike = field(default_factory=lambda: np.zeros(3))

    @property
    def blind(self) -> dict[str, float]:
        """Axes along which no change by `BLIND` counts, with the factor that would."""
        reach = np.exp(SCATTERS * np.asarray(self.scatter, dtype=np.float64))
        return {axis: float(factor) for axis, factor in zip(_AXES, reach, strict=True) if factor > BLIND}


def dead_axes(result: WindowResult) -> NDArray[np.bool_]:
    """Axes (3,) along which the sensor measures less than a hundredth of what the model computes."""
    return np.asarray(result.field_rms < DEAD_SHARE * result.model_rms)


def log_reach(scatter: ArrayLike, threshold: float) -> Array:
    """How far the logarithm of measured over computed RMS may be off before a window counts; NaN is no scatter."""
    return np.asarray(np.fmax(np.log1p(threshold), SCATTERS * np.asarray(scatter, dtype=np.float64)))


_NONE: Final = UsualRatio(np.full(3, np.nan), np.full(3, np.nan))


class AlarmRule:
    """Rule by which a level that stays off for a number of windows raises an alarm.

    Parameters
    ----------
    threshold : float
        Share by which measured and computed RMS of any axis differ, or by which their ratio changes if there is a
        baseline.
    windows : int
        Consecutive windows with a known error that have to be over it.
    baseline : mapping of str to UsualRatio
        By test point; the others have an absolute threshold.
    axes : sequence of int
        Which of x, y, z to watch.
    """

    def __init__(
        self,
        threshold: float = 0.30,
        windows: int = 3,
        baseline: Mapping[str, UsualRatio] | None = None,
        axes: Sequence[int] = (0, 1, 2),
    ) -> None:
        if not threshold > 0.0 or windows < 1:
            raise InputError(f"an alarm needs threshold > 0 and windows >= 1, not {threshold} and {windows}")
        self._threshold = threshold
        self._windows = windows
        self._baseline = dict(baseline or {})
        self._axes = list(axes)
        self._over: dict[str, int] = {}

    @property
    def raised(self) -> frozenset[str]:
        """Test points whose alarm stands."""
        return frozenset(point for point, count in self._over.items() if count >= self._windows)

    def update(self, result: WindowResult) -> bool:
        """Whether the next window of a point raises the alarm, which it does once until the alarm has fallen again."""
        known = (np.isfinite(result.relative_error) & ~dead_axes(result))[self._axes]
        if result.operation != "steady" or not known.any():
            return False
        over = bool((self._exceeds(result)[self._axes] & known).any())
        self._over[result.point] = self._over.get(result.point, 0) + 1 if over else 0
        return self._over[result.point] == self._windows

    def _exceeds(self, result: WindowResult) -> NDArray[np.bool_]:
        """Which axes are over their threshold, (3,)."""
        ratio, usual = result.log_ratio, self._baseline.get(result.point, _NONE)
        mean = np.asarray(usual.mean, dtype=np.float64)
        change = np.where(np.isnan(mean), ratio, ratio - mean)
        return np.asarray(np.abs(change) > log_reach(usual.scatter, self._threshold), dtype=np.bool_)
