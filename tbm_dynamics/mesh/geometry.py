"""Geometry of an internal spur gear pair with standard addenda."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class InternalPair:
    """A pinion inside a ring gear, no profile shift.

    Parameters
    ----------
    pinion_teeth, ring_teeth : int
    module : float
        m.
    pressure_angle : float
        rad.
    """

    pinion_teeth: int
    ring_teeth: int
    module: float
    pressure_angle: float

    @property
    def pinion_pitch_radius(self) -> float:
        """Pinion pitch radius (m)."""
        return self.module * self.pinion_teeth / 2.0

    @property
    def ring_pitch_radius(self) -> float:
        """Ring pitch radius (m)."""
        return self.module * self.ring_teeth / 2.0

    @property
    def pinion_base_radius(self) -> float:
        """Pinion base radius (m)."""
        return self.pinion_pitch_radius * math.cos(self.pressure_angle)

    @property
    def ring_base_radius(self) -> float:
        """Ring base radius (m)."""
        return self.ring_pitch_radius * math.cos(self.pressure_angle)

    @property
    def centre_distance(self) -> float:
        """Centre distance (m)."""
        return self.ring_pitch_radius - self.pinion_pitch_radius

    @property
    def contact_ratio(self) -> float:
        """Transverse contact ratio ε of the internal mesh; addendum one module on both gears."""
        pinion_tip = self.pinion_pitch_radius + self.module
        ring_tip = self.ring_pitch_radius - self.module
        path = (
            math.sqrt(pinion_tip**2 - self.pinion_base_radius**2)
            - math.sqrt(max(ring_tip**2 - self.ring_base_radius**2, 0.0))
            + self.centre_distance * math.sin(self.pressure_angle)
        )
        return path / (math.pi * self.module * math.cos(self.pressure_angle))

    def line_of_action(self, angle: float) -> np.ndarray:
        """Direction of the driving force on the ring from the pinion at `angle` (rad) around x, shape (3,).

        Tangential in the turning direction, and outward: an internal mesh pushes the ring away.
        """
        radial = np.array([0.0, math.cos(angle), math.sin(angle)])
        tangential = np.array([0.0, -math.sin(angle), math.cos(angle)])
        return math.cos(self.pressure_angle) * tangential + math.sin(self.pressure_angle) * radial
