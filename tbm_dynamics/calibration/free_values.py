"""The values that a calibration may move: where they stand in the machine file, and their limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tbm_dynamics.machine.inputs import Place


@dataclass(frozen=True)
class FreeValue:
    """One free value.

    Attributes
    ----------
    place : tuple of str and int
        Keys and indices that lead to it.
    lower, upper : float
        Limits.
    wall_of : float
        For an inner diameter: the outer one (m); the value searched is the logarithm of the wall's thickness.
    logarithmic : bool
        Search the logarithm.
    """

    place: Place
    lower: float
    upper: float
    wall_of: float = 0.0
    logarithmic: bool = False

    @property
    def bounds(self) -> tuple[float, float]:
        """Limits of the searched number."""
        if self.wall_of or self.logarithmic:
            return math.log(self.lower), math.log(self.upper)
        return self.lower, self.upper

    def value(self, searched: float) -> float:
        """Value of the file from the searched number, rounded to four digits of what was searched."""
        if self.wall_of:
            return round(self.wall_of - 2.0 * float(f"{math.exp(searched):.3g}"), 6)
        return float(f"{math.exp(searched) if self.logarithmic else searched:.4g}")


_HEAD, _CARRIER = ("cutterhead_bearing_gear",), ("carrier_girder",)
_FX = ("loads", "fx")

# Design ranges: head 120–220 t, carrier with its drives 80–150 t (the drives weigh 34.5 t), shield 30–100, girder
# 50–120, gripper 30–90 t. Sections stand for plates and boxes: their walls may be thin, but carry the allowed loads.
FREE_VALUES: tuple[FreeValue, ...] = (
    FreeValue((*_HEAD, "shafts", 0, "mass"), 120e3, 220e3),
    FreeValue((*_HEAD, "shafts", 1, "mass"), 8e3, 20e3),
    FreeValue((*_HEAD, "shafts", 2, "mass"), 10e3, 25e3),
    FreeValue((*_CARRIER, "bodies", 0, "mass"), 8e3, 20e3),
    FreeValue((*_CARRIER, "shafts", 0, "mass"), 45.5e3, 115.5e3),
    FreeValue((*_CARRIER, "bodies", 1, "mass"), 30e3, 100e3),
    FreeValue((*_CARRIER, "shafts", 1, "mass"), 50e3, 120e3),
    FreeValue((*_CARRIER, "bodies", 2, "mass"), 30e3, 90e3),
    FreeValue((*_HEAD, "shafts", 0, "inner_diameter"), 0.004, 0.3, wall_of=5.8),
    FreeValue((*_HEAD, "shafts", 1, "inner_diameter"), 0.004, 0.4, wall_of=4.2),
    FreeValue((*_HEAD, "shafts", 2, "inner_diameter"), 0.004, 0.25, wall_of=3.9),
    FreeValue((*_CARRIER, "shafts", 0, "inner_diameter"), 0.004, 0.4, wall_of=4.4),
    FreeValue((*_CARRIER, "shafts", 1, "inner_diameter"), 0.01, 0.2, wall_of=1.8),
    FreeValue((*_FX, "regions", 0, "rms"), 1e5, 1.3e6, logarithmic=True),
    FreeValue((*_FX, "regions", 1, "rms"), 2e5, 2e6, logarithmic=True),
    FreeValue((*_FX, "lines", 1, "amplitude"), 2e5, 2e6, logarithmic=True),
)


def values_of(searched: Sequence[float]) -> dict[Place, float | str]:
    """Values of a machine file from the searched numbers."""
    return {free.place: free.value(number) for free, number in zip(FREE_VALUES, searched, strict=True)}
