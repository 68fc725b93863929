"""An external involute gear, spur or helical, with or without profile shift, and what keeps it from being cut.

Lengths across the axis are those of the transverse section: of a helix β at the reference circle
m_t = m_n/cos β and tan α_t = tan α_n/cos β (ISO 21771).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from tbm_msgs_py.base.errors import MachineError

# Keeps a limit that is a whole number of teeth, 8 at 30°, from being missed by rounding.
ROUNDING = 1e-9

DEDENDUM = 1.25  # modules


class GearError(MachineError):
    """Gears that cannot mesh: one line with what, the value and what is allowed."""


@contextmanager
def named(gears: str) -> Iterator[None]:
    """Put a name in front of what is wrong with gears."""
    try:
        yield
    except GearError as error:
        raise GearError(f"{gears}: {error}") from None


@dataclass(frozen=True)
class Tooth:
    """Teeth of an external gear, cut by a rack with an addendum of one module and a dedendum of 1.25.

    Attributes
    ----------
    teeth : int
    module, pressure_angle : float
        Normal ones, m and rad.
    helix : float
        At the reference circle, rad, either hand.
    shift : float
        Profile shift in modules, positive outwards.
    shortening : float
        Of the tip, modules.
    """

    teeth: int
    module: float
    pressure_angle: float
    helix: float = 0.0
    shift: float = 0.0
    shortening: float = 0.0

    @property
    def transverse_angle(self) -> float:
        """Transverse pressure angle α_t (rad)."""
        return transverse(self.pressure_angle, self.helix)

    @property
    def reference_radius(self) -> float:
        """Reference circle (m)."""
        return self.module / math.cos(self.helix) * self.teeth / 2.0

    @property
    def base_radius(self) -> float:
        """Base circle (m)."""
        return self.reference_radius * math.cos(self.transverse_angle)

    @property
    def tip_radius(self) -> float:
        """Addendum of one module, shifted and shortened (m)."""
        return self.reference_radius + self.module * (1.0 + self.shift - self.shortening)

    @property
    def root_radius(self) -> float:
        """Dedendum of 1.25 modules, shifted (m)."""
        return self.reference_radius - self.module * (DEDENDUM - self.shift)

    @property
    def form_radius(self) -> float:
        """Where the involute starts (m)."""
        angle = self.transverse_angle
        curvature = self.reference_radius * math.sin(angle) - self.module * (1.0 - self.shift) / math.sin(angle)
        return math.hypot(self.base_radius, max(curvature, 0.0))

    @property
    def tip_curvature(self) -> float:
        """Radius of curvature of the flank at its tip (m)."""
        return math.sqrt(self.tip_radius**2 - self.base_radius**2)

    def half_angle(self, radius: float | np.ndarray) -> np.ndarray:
        """Half the angle of the tooth at a radius (rad)."""
        flank = np.arccos(np.clip(self.base_radius / np.asarray(radius), None, 1.0))
        thickness = math.pi / 2.0 + 2.0 * self.shift * math.tan(self.pressure_angle)
        return thickness / self.teeth + involute(self.transverse_angle) - (np.tan(flank) - flank)

    def check_undercut(self, name: str) -> None:
        """Refuse a gear whose flank the rack cuts away, z < 2 (1 − x) cos β/sin²α_t (ISO 21771)."""
        angle = self.transverse_angle
        least = 2.0 * (1.0 - self.shift) * math.cos(self.helix) / math.sin(angle) ** 2 - ROUNDING
        if self.teeth < least:
            raise GearError(
                f"{name} of {self.teeth} teeth is undercut at {degrees(self.pressure_angle)}: "
                f"at least {math.ceil(least)} teeth"
            )

    def check_tip(self, name: str) -> None:
        """Refuse a pointed tooth."""
        half = float(self.half_angle(self.tip_radius)) if self.tip_radius > self.base_radius else -math.inf
        if half <= 0.0:
            raise GearError(
                f"{name} of {self.teeth} teeth is pointed at {degrees(self.pressure_angle)}: its tip would be "
                f"{2.0 * half * self.tip_radius / self.module:.3g} modules thick, must be more than 0"
            )


def transverse(pressure_angle: float, helix: float) -> float:
    """Transverse pressure angle (rad) of a normal one."""
    return math.atan(math.tan(pressure_angle) / math.cos(helix)) if helix else pressure_angle


def involute(angle: float) -> float:
    """Involute function of a pressure angle (rad), inv α = tan α − α."""
    return math.tan(angle) - angle


def inverse_involute(value: float) -> float:
    """Pressure angle (rad) of a value of the involute function above 0 and below 1, by Newton's method from above."""
    angle = math.pow(3.0 * value, 1.0 / 3.0)  # of tan α − α ≥ α³/3, so above the angle, from where steps fall
    for _ in range(60):
        step = (involute(angle) - value) / math.tan(angle) ** 2
        angle -= step
        if abs(step) < 1e-15:
            break
    return angle


def degrees(angle: float) -> str:
    """Angle (rad) as it is told."""
    return f"{math.degrees(angle):.4g} deg"
