"""Geometry of spur gear pairs with standard addenda, external and internal, and what keeps them from meshing.

Addendum one module on both gears, no profile shift, standard centre distance. The pinion drives: contact starts low on
its flank and ends at its tip.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import count
from typing import ClassVar

import numpy as np

from tbm_msgs_py.base.errors import MachineError

# Keeps a limit that is a whole number of teeth, 8 at 30°, from being missed by rounding.
_ROUNDING = 1e-9


class GearError(MachineError):
    """Gears that cannot mesh: one line with what, the value and what is allowed."""


@contextmanager
def named(gears: str) -> Iterator[None]:
    """Put a name in front of what is wrong with gears."""
    try:
        yield
    except GearError as error:
        raise GearError(f"{gears}: {error}") from None


class _Pair(ABC):
    """What both kinds of pair have in common: the driving pinion."""

    turning: ClassVar[float]
    """Sign of the turn of the driven gear when the pinion turns forwards."""

    pinion_teeth: int
    module: float
    pressure_angle: float

    @property
    def pinion_pitch_radius(self) -> float:
        """Pinion pitch radius (m)."""
        return self.module * self.pinion_teeth / 2.0

    @property
    def pinion_base_radius(self) -> float:
        """Pinion base radius (m)."""
        return self.pinion_pitch_radius * math.cos(self.pressure_angle)

    @property
    def base_pitch(self) -> float:
        """Distance of the flanks along the line of action (m)."""
        return math.pi * self.module * math.cos(self.pressure_angle)

    @property
    @abstractmethod
    def path_start(self) -> float:
        """Radius of curvature of the pinion flank where contact starts (m)."""

    @property
    @abstractmethod
    def contact_ratio(self) -> float:
        """Transverse contact ratio ε."""

    @property
    def pitch_phase(self) -> float:
        """Mesh cycles from where a tooth pair enters to where it touches at the pitch point."""
        return (self.pinion_pitch_radius * math.sin(self.pressure_angle) - self.path_start) / self.base_pitch

    def line_of_action(self, angle: float) -> np.ndarray:
        """Direction of the force on the driven gear from the pinion at `angle` (rad) around its axis, shape (3,).

        Tangential in the turning direction about x, and radial: an internal mesh pushes the ring away, an external one
        pushes the wheel towards its axis.
        """
        radial = np.array([0.0, math.cos(angle), math.sin(angle)])
        tangential = np.array([0.0, -math.sin(angle), math.cos(angle)])
        return math.cos(self.pressure_angle) * tangential + self.turning * math.sin(self.pressure_angle) * radial


@dataclass(frozen=True)
class ExternalPair(_Pair):
    """A pinion driving an external wheel.

    Parameters
    ----------
    pinion_teeth, wheel_teeth : int
    module : float
        m.
    pressure_angle : float
        rad.
    """

    turning: ClassVar[float] = -1.0

    pinion_teeth: int
    wheel_teeth: int
    module: float
    pressure_angle: float

    @property
    def wheel_pitch_radius(self) -> float:
        """Wheel pitch radius (m)."""
        return self.module * self.wheel_teeth / 2.0

    @property
    def wheel_base_radius(self) -> float:
        """Wheel base radius (m)."""
        return self.wheel_pitch_radius * math.cos(self.pressure_angle)

    @property
    def centre_distance(self) -> float:
        """Centre distance (m)."""
        return self.pinion_pitch_radius + self.wheel_pitch_radius

    @property
    def path_start(self) -> float:
        """Radius of curvature of the pinion flank where contact starts, at the wheel's tip (m)."""
        reach = math.sqrt((self.wheel_pitch_radius + self.module) ** 2 - self.wheel_base_radius**2)
        return self.centre_distance * math.sin(self.pressure_angle) - reach

    @property
    def contact_ratio(self) -> float:
        """Transverse contact ratio ε."""
        end = math.sqrt((self.pinion_pitch_radius + self.module) ** 2 - self.pinion_base_radius**2)
        return (end - self.path_start) / self.base_pitch

    def check(self) -> None:
        """Raise what keeps the pair from meshing.

        Contact below a base circle needs no check of its own: no wheel reaches deeper than the rack of the undercut.

        Raises
        ------
        GearError
            Undercut, a contact ratio out of (1, 2), or a pointed tooth.
        """
        for name, teeth in (("pinion", self.pinion_teeth), ("wheel", self.wheel_teeth)):
            _check_undercut(name, teeth, self.pressure_angle)
        _check_contact_ratio(self.contact_ratio)
        for name, teeth in (("pinion", self.pinion_teeth), ("wheel", self.wheel_teeth)):
            _check_tip(name, teeth, self.pressure_angle)


@dataclass(frozen=True)
class InternalPair(_Pair):
    """A pinion inside a ring gear that it drives.

    Parameters
    ----------
    pinion_teeth, ring_teeth : int
    module : float
        m.
    pressure_angle : float
        rad.
    """

    turning: ClassVar[float] = 1.0

    pinion_teeth: int
    ring_teeth: int
    module: float
    pressure_angle: float

    @property
    def ring_pitch_radius(self) -> float:
        """Ring pitch radius (m)."""
        return self.module * self.ring_teeth / 2.0

    @property
    def ring_base_radius(self) -> float:
        """Ring base radius (m)."""
        return self.ring_pitch_radius * math.cos(self.pressure_angle)

    @property
    def centre_distance(self) -> float:
        """Centre distance (m)."""
        return self.ring_pitch_radius - self.pinion_pitch_radius

    @property
    def path_start(self) -> float:
        """Radius of curvature of the pinion flank where contact starts, at the ring's tip (m); below 0: none there."""
        return self._ring_tip_curvature() - self.centre_distance * math.sin(self.pressure_angle)

    @property
    def contact_ratio(self) -> float:
        """Transverse contact ratio ε of the internal mesh; GearError where the ring has no flank at its tip."""
        pinion_tip = self.pinion_pitch_radius + self.module
        path = (
            math.sqrt(pinion_tip**2 - self.pinion_base_radius**2)
            - self._ring_tip_curvature()
            + self.centre_distance * math.sin(self.pressure_angle)
        )
        return path / self.base_pitch

    def check(self) -> None:
        """Raise what keeps the pair from meshing.

        The ring's tip circle, undercut, contact below the pinion's base circle, contact ratio, pointed teeth and tips
        in each other's way, in this order: each takes for granted what the earlier ones found.

        Raises
        ------
        GearError
            The first of them.
        """
        if self.ring_teeth <= self.pinion_teeth:
            raise GearError(f"ring of {self.ring_teeth} teeth: must have more than the pinion's {self.pinion_teeth}")
        _check_undercut("pinion", self.pinion_teeth, self.pressure_angle)
        if self.path_start < -_ROUNDING * self.module:
            # ρ_start = 0 solved for the pinion's teeth.
            reach = 2.0 * self._ring_tip_curvature() / (self.module * math.sin(self.pressure_angle))
            least = math.ceil(self.ring_teeth - reach - _ROUNDING)
            raise GearError(
                f"contact in a ring of {self.ring_teeth} teeth would start below the base circle of the pinion of "
                f"{self.pinion_teeth} teeth, {-self.path_start * 1e3:.3g} mm along the line of action: "
                f"at least {least} pinion teeth"
            )
        _check_contact_ratio(self.contact_ratio)
        _check_tip("pinion", self.pinion_teeth, self.pressure_angle)
        self._check_tips_pass()

    def _ring_tip_curvature(self) -> float:
        """Radius of curvature of the ring's flank at its tip (m)."""
        square = (self.ring_pitch_radius - self.module) ** 2 - self.ring_base_radius**2
        if square < 0.0:
            least = math.ceil(2.0 / (1.0 - math.cos(self.pressure_angle)) - _ROUNDING)
            raise GearError(
                f"ring of {self.ring_teeth} teeth has its tip circle inside its base circle at "
                f"{_degrees(self.pressure_angle)}: at least {least} teeth"
            )
        return math.sqrt(square)

    def _check_tips_pass(self) -> None:
        if self._tip_gap() >= 0.0:
            return
        least = next(teeth for teeth in count(self.ring_teeth + 1) if replace(self, ring_teeth=teeth)._tip_gap() >= 0.0)
        raise GearError(
            f"tips of pinion and ring run into each other with a tooth difference of "
            f"{self.ring_teeth - self.pinion_teeth}: at least {least - self.pinion_teeth} with {self.pinion_teeth} "
            f"pinion teeth"
        )

    def _tip_gap(self) -> float:
        """Angle at the ring (rad) between the two tips where the tip circles cross; negative: they overlap.

        z1/z2 θ1 + inv α − inv α_a2 − θ2, Stock Drive Products, Elements of Metric Gear Technology, equations (5-6) and
        (5-7) (there "trochoid interference"; Maag and Colbourne: tip interference), working pressure angle α.
        """
        if self.ring_teeth - self.pinion_teeth <= 2:
            return -math.inf  # the tip circles never part
        distance, angle = self.centre_distance, involute(self.pressure_angle)
        pinion, ring = self.pinion_pitch_radius + self.module, self.ring_pitch_radius - self.module
        tip = involute(math.acos(self.pinion_base_radius / pinion))
        theta1 = math.acos((ring**2 - pinion**2 - distance**2) / (2.0 * distance * pinion)) + tip - angle
        theta2 = math.acos((distance**2 + ring**2 - pinion**2) / (2.0 * distance * ring))
        ring_tip = involute(math.acos(self.ring_base_radius / ring))
        return self.pinion_teeth / self.ring_teeth * theta1 + angle - ring_tip - theta2


def involute(angle: float) -> float:
    """Involute function of a pressure angle (rad), inv α = tan α − α."""
    return math.tan(angle) - angle


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.4g} deg"


def _check_undercut(name: str, teeth: int, pressure_angle: float) -> None:
    """Refuse a gear whose flank a rack with an addendum of one module cuts away, z < 2/sin²α (ISO 21771)."""
    least = 2.0 / math.sin(pressure_angle) ** 2 - _ROUNDING
    if teeth < least:
        raise GearError(
            f"{name} of {teeth} teeth is undercut at {_degrees(pressure_angle)}: at least {math.ceil(least)} teeth"
        )


def _check_contact_ratio(ratio: float) -> None:
    if not 1.0 < ratio < 2.0:
        raise GearError(f"contact ratio {ratio:.3f}: must lie between 1 and 2")


def _check_tip(name: str, teeth: int, pressure_angle: float) -> None:
    tip = math.acos(teeth / (teeth + 2.0) * math.cos(pressure_angle))
    half = math.pi / (2.0 * teeth) + involute(pressure_angle) - involute(tip)
    if half <= 0.0:
        raise GearError(
            f"{name} of {teeth} teeth is pointed at {_degrees(pressure_angle)}: its tip would be "
            f"{half * (teeth + 2.0):.3g} modules thick, must be more than 0"
        )
