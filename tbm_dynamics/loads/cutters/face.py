"""A face that is not the same everywhere: layers, boulders, worn and lost cutters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from tbm_dynamics.loads.cutters.errors import CutterError
from tbm_dynamics.loads.cutters.layout import CutterLayout, FloatArray

_EDGE = 0.1
"""Width over which one rock gives way to another, m: about the length of contact of a disc."""

_TURN = 720
"""Places on a turn at which a mean is taken."""


@dataclass(frozen=True)
class Layer:
    """Rock above a level: z of the level (m, 0 at the axis), strength over that of the rock."""

    level: float
    strength: float


@dataclass(frozen=True)
class Boulder:
    """Rock within a circle: y and z of its centre and its radius (m), strength over that of the rock."""

    y: float
    z: float
    radius: float
    strength: float


@dataclass(frozen=True)
class Face:
    """What differs from even rock and new cutters.

    Attributes
    ----------
    zones : tuple of Layer or Boulder
        A later one lies over an earlier one.
    wear : mapping of int to float
        Force of a cutter, by its number, over that of a new one: above 1 worn, 0 lost.

    Raises
    ------
    CutterError
        A strength or a wear that is negative, a boulder without size.
    """

    zones: tuple[Layer | Boulder, ...] = ()
    wear: Mapping[int, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for zone in self.zones:
            values = np.array(list(vars(zone).values()))
            if not (np.all(np.isfinite(values)) and zone.strength >= 0.0):
                raise CutterError(f"face: {zone}: needs finite numbers and a strength of 0 or more")
            if isinstance(zone, Boulder) and zone.radius <= 0.0:
                raise CutterError(f"face: {zone}: the radius must be above 0")
        for number, factor in self.wear.items():
            if not (np.isfinite(factor) and factor >= 0.0):
                raise CutterError(f"face: wear of cutter {number} is {factor:g}, must be 0 (lost) or more")

    def factors(self, layout: CutterLayout) -> FloatArray:
        """Look up the wear of every disc, (n,).

        Raises
        ------
        CutterError
            Wear of a cutter that is not there.
        """
        unknown = sorted(set(self.wear) - set(layout.cutter.tolist()))
        if unknown:
            raise CutterError(f"face: no cutter {unknown[0]}, there are {layout.cutter.min()} to {layout.cutter.max()}")
        return np.array([self.wear.get(int(number), 1.0) for number in layout.cutter])

    @property
    def table(self) -> FloatArray:
        """Zones as rows (y, z, radius, strength), the radius of a layer infinite, (k, 4)."""
        rows = [
            (zone.y, zone.z, zone.radius, zone.strength)
            if isinstance(zone, Boulder)
            else (0.0, zone.level, np.inf, zone.strength)
            for zone in self.zones
        ]
        return np.array(rows).reshape(-1, 4)

    def over_a_turn(self, layout: CutterLayout) -> tuple[FloatArray, FloatArray]:
        """Give head angles (m,) and the strength under every disc there, (m, n)."""
        angles = 2.0 * np.pi * (np.arange(_TURN) + 0.5) / _TURN
        if not self.zones:
            return angles, np.ones((_TURN, len(layout.radius)))
        table = self.table
        found = [
            [
                strength(table, r * np.cos(a), r * np.sin(a))
                for r, a in zip(layout.radius, layout.angle + turn, strict=True)
            ]
            for turn in angles
        ]
        return angles, np.array(found)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def strength(table: FloatArray, y: float, z: float) -> float:
    """Strength of the rock at a place over that of the even rock."""
    value = 1.0
    for k in range(len(table)):
        inside = z - table[k, 1]
        if np.isfinite(table[k, 2]):
            inside = table[k, 2] - np.hypot(y - table[k, 0], inside)
        share = min(max(inside / _EDGE + 0.5, 0.0), 1.0)
        value += share * (table[k, 3] - value)
    return value
