"""The values a calibration may move, their limits, and how they get into a machine file."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from tbm_msgs_py.base.errors import InputError


@dataclass(frozen=True)
class FreeValue:
    """One free value.

    Attributes
    ----------
    anchor : str
        Text that only the value's line (or the lines from it on) of the machine file holds.
    key : str
        The key on that line, or on the first line after it that has the key.
    lower, upper : float
        Limits.
    wall_of : float
        For an inner diameter: the outer one (m); the value searched is the logarithm of the wall's thickness.
    logarithmic : bool
        Search the logarithm.
    """

    anchor: str
    key: str
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


# Design ranges: head 120–220 t, carrier with its drives 80–150 t (the drives weigh 34.5 t), shield 30–100, girder
# 50–120, gripper 30–90 t. Walls: sections that stand for plates and boxes may be thin.
FREE_VALUES: tuple[FreeValue, ...] = (
    FreeValue("nodes: [1, 2, 3, 4]", "mass", 120e3, 220e3),
    FreeValue("nodes: [5, 6]", "mass", 8e3, 20e3),
    FreeValue("nodes: [7, 8, 9]", "mass", 10e3, 25e3),
    FreeValue("node: 10,", "mass", 8e3, 20e3),
    FreeValue("nodes: [11, 12]", "mass", 45.5e3, 115.5e3),
    FreeValue("node: 43,", "mass", 30e3, 100e3),
    FreeValue("nodes: [44, 45, 46, 47, 48, 49]", "mass", 50e3, 120e3),
    FreeValue("node: 50,", "mass", 30e3, 90e3),
    FreeValue("nodes: [1, 2, 3, 4]", "inner_diameter", 0.004, 0.3, wall_of=5.8),
    FreeValue("nodes: [5, 6]", "inner_diameter", 0.004, 0.4, wall_of=4.2),
    FreeValue("nodes: [7, 8, 9]", "inner_diameter", 0.004, 0.25, wall_of=3.9),
    FreeValue("nodes: [11, 12]", "inner_diameter", 0.004, 0.4, wall_of=4.4),
    FreeValue("nodes: [44, 45, 46, 47, 48, 49]", "inner_diameter", 0.01, 0.2, wall_of=1.8),
    FreeValue("  fx:", "band: [0, 10], rms", 1e5, 2.2e6, logarithmic=True),
    FreeValue("  fx:", "band: [125, 135], rms", 2e5, 2e6, logarithmic=True),
    FreeValue("  fx:", "frequency: 130.3, amplitude", 2e5, 2e6, logarithmic=True),
    FreeValue("  mx:", "frequency: 0.9, amplitude", 5e4, 1.2e6, logarithmic=True),
    FreeValue("  mx:", "frequency: 130.3, amplitude", 5e4, 8e5, logarithmic=True),
)


def with_values(text: str, searched: Sequence[float]) -> str:
    """Text of a machine file with the free values set and their source marked `calibrated`."""
    for free, number in zip(FREE_VALUES, searched, strict=True):
        text = _set(text, free, free.value(number))
    return text


def _set(text: str, free: FreeValue, value: float) -> str:
    start = text.index(free.anchor)
    start = text.rindex("\n", 0, start) + 1
    place = re.compile(re.escape(free.key) + r": *[-+0-9.eE]+").search(text, start)
    if place is None:
        raise InputError(f"machine file: no {free.key} after {free.anchor!r}")
    end = text.index("\n", place.end())
    rest = text[place.end() : end].replace("source: assumed", "source: calibrated", 1)
    return text[: place.start()] + f"{free.key}: {value:.10g}" + rest + text[end:]
