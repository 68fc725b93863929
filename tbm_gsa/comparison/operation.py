"""How a machine is driven while its signals arrive: which windows may be compared, and which may not.

The live form of the rule in `levels`: a window counts while speed, torque and thrust each stay within `TOLERANCE` of
what they are at its begin. What changes within it, or stands still, is compared with a model that cannot follow.
"""

from bisect import bisect_right

import numpy as np
from numpy.typing import ArrayLike

from tbm_gsa.comparison.levels import Kind, alike
from tbm_msgs_py.base.arrays import Array

KEPT_NS = 7_200_000_000_000  # two windows of the greatest length


class Operation:
    """Operating points of one origin, in the order of their stamps."""

    def __init__(self) -> None:
        self._stamps: list[int] = []
        self._points: list[Array] = []

    def take(self, stamp_ns: int, point: ArrayLike) -> None:
        """Take note of speed, torque and thrust (3,) from a stamp on; a stamp that jumps back begins anew."""
        if self._stamps and stamp_ns <= self._stamps[-1]:
            keep = bisect_right(self._stamps, stamp_ns - 1)
            del self._stamps[keep:], self._points[keep:]
        self._stamps.append(stamp_ns)
        self._points.append(np.asarray(point, dtype=np.float64))
        old = max(0, bisect_right(self._stamps, stamp_ns - KEPT_NS) - 1)
        del self._stamps[:old], self._points[:old]

    def kind(self, begin_ns: int, end_ns: int) -> Kind:
        """Say how the machine was driven from begin to end; before the first operating point as it is then."""
        first = max(0, bisect_right(self._stamps, begin_ns) - 1)
        held = self._points[first : max(first + 1, bisect_right(self._stamps, end_ns - 1))]
        if not all((point > 0.0).all() for point in held):
            return "standstill"
        return "steady" if all(alike(held[0], point) for point in held[1:]) else "transient"
