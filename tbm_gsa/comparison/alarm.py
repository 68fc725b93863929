"""When the error of a test point counts as an alarm.

Without a baseline the threshold is absolute: a window counts when the relative error of a watched axis is over it. With
one the change counts, for the model of a sound drive errs too: a window counts when the error lies farther from the
baseline's mean than the threshold, and farther than three times the baseline's scatter. An alarm is a number of such
windows in a row; windows without a known error, and sensors that measure next to nothing, neither raise nor clear it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tbm_gsa.comparison.live import WindowResult
from tbm_msgs_py.base.errors import InputError

SCATTERS = 3.0
DEAD_SHARE = 0.01  # of what is usual; a sensor that measures less is dead, and its error as large as you like


@dataclass(frozen=True, eq=False)
class UsualError:
    """Relative error of a test point of a sound machine.

    Attributes
    ----------
    mean, scatter : array_like, shape (3,)
        Of the windows of a baseline, along x, y and z; NaN of an axis without one: its threshold is absolute.
    """

    mean: ArrayLike
    scatter: ArrayLike = field(default_factory=lambda: np.zeros(3))


def dead_axes(result: WindowResult) -> NDArray[np.bool_]:
    """Axes (3,) along which the sensor measures less than a hundredth of what the model computes."""
    return np.asarray(result.field_rms < DEAD_SHARE * result.model_rms)


class AlarmRule:
    """Rule by which an error that stays over a threshold for a number of windows raises an alarm.

    Parameters
    ----------
    threshold : float
        Of the relative error of any axis, or of its change if there is a baseline.
    windows : int
        Consecutive windows with a known error that have to be over it.
    baseline : mapping of str to UsualError
        By test point; the others have an absolute threshold.
    axes : sequence of int
        Which of x, y, z to watch.
    """

    def __init__(
        self,
        threshold: float = 0.30,
        windows: int = 3,
        baseline: Mapping[str, UsualError] | None = None,
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
        error, usual = result.relative_error, self._baseline.get(result.point)
        if usual is None:
            return np.asarray(error > self._threshold, dtype=np.bool_)
        mean, scatter = np.asarray(usual.mean, dtype=np.float64), np.asarray(usual.scatter, dtype=np.float64)
        limit = np.maximum(self._threshold, SCATTERS * scatter)
        return np.where(np.isnan(mean), error > self._threshold, np.abs(error - mean) > limit)
