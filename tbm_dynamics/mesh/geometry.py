"""Geometry of gear pairs, external and internal, spur or helical, and what keeps them from meshing.

Addendum one module on both gears. The pinion drives: contact starts low on its flank and ends at its tip. With profile
shift the pair works at the centre distance without backlash (ISO 21771), inv α_wt = inv α_t + 2 tan α_n Σx/Σz: shifts
are positive away from the axis of a gear, of ring teeth too, so that Σx is x1 + x2 of an external pair and x2 − x1 of
an internal one, over z1 + z2 or z2 − z1. Tips of external pairs are shortened so that their clearance stays.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from tbm_dynamics.mesh.tooth import ROUNDING, GearError, Tooth, degrees, inverse_involute, involute, transverse

HelixAngle = Annotated[float, Field(gt=-45.0, lt=45.0)]
"""Of a file, degrees."""
Shift = Annotated[float, Field(ge=-1.0, le=2.0)]
"""Profile shift in a file, modules."""

LARGEST_ANGLE = math.radians(45.0)
"""Working pressure angle, beyond which no gears run: profile shifts that are far too large."""


class GearPair(ABC):
    """What both kinds of pair have in common; the gear that the pinion drives is a wheel or a ring."""

    turning: ClassVar[float]
    """Sign of the turn of the driven gear when the pinion turns forwards."""

    pinion_teeth: int
    module: float
    pressure_angle: float
    helix: float
    pinion_shift: float
    driven_shift: float

    @property
    @abstractmethod
    def driven_teeth(self) -> int:
        """Teeth of the driven gear."""

    @property
    @abstractmethod
    def pinion(self) -> Tooth:
        """Teeth of the pinion."""

    @property
    @abstractmethod
    def path_start(self) -> float:
        """Radius of curvature of the pinion flank where contact starts (m)."""

    @abstractmethod
    def check(self) -> None:
        """Raise what keeps the pair from meshing, a GearError."""

    @property
    def transverse_angle(self) -> float:
        """Transverse pressure angle α_t (rad)."""
        return transverse(self.pressure_angle, self.helix)

    @cached_property
    def working_angle(self) -> float:
        """Transverse working pressure angle α_wt (rad)."""
        shifts = self.driven_shift - self.turning * self.pinion_shift
        if shifts == 0.0:
            return self.transverse_angle
        value = involute(self.transverse_angle) + 2.0 * math.tan(self.pressure_angle) * shifts / self._teeth
        if not 0.0 < value < involute(LARGEST_ANGLE):
            raise GearError(
                f"profile shifts {self.pinion_shift:g} and {self.driven_shift:g} of {self.pinion_teeth} and "
                f"{self.driven_teeth} teeth: their working pressure angle must be above 0 and below "
                f"{degrees(LARGEST_ANGLE)}"
            )
        return inverse_involute(value)

    @property
    def _teeth(self) -> float:
        """Σz: z1 + z2 of an external pair, z2 − z1 of an internal one."""
        return self.driven_teeth - self.turning * self.pinion_teeth

    @property
    def centre_distance(self) -> float:
        """Working centre distance (m)."""
        plain = self.module / math.cos(self.helix) * self._teeth / 2.0
        return plain * (math.cos(self.transverse_angle) / math.cos(self.working_angle))

    @property
    def pinion_base_radius(self) -> float:
        """Pinion base radius (m)."""
        return self.base_pitch * self.pinion_teeth / (2.0 * math.pi)

    @property
    def pinion_pitch_radius(self) -> float:
        """Pinion pitch radius, at which the pair works (m)."""
        return self.centre_distance * self.pinion_teeth / self._teeth

    @property
    def driven_base_radius(self) -> float:
        """Base radius of the driven gear (m)."""
        return self.base_pitch * self.driven_teeth / (2.0 * math.pi)

    @property
    def driven_pitch_radius(self) -> float:
        """Pitch radius of the driven gear (m)."""
        return self.centre_distance * self.driven_teeth / self._teeth

    @property
    def base_pitch(self) -> float:
        """Transverse distance of the flanks along the line of action (m)."""
        return math.pi * self.module / math.cos(self.helix) * math.cos(self.transverse_angle)

    @property
    def between_base_circles(self) -> float:
        """Length of the line of action between the points where it touches the base circles (m)."""
        return self.centre_distance * math.sin(self.working_angle)

    @property
    def contact_ratio(self) -> float:
        """Transverse contact ratio ε_α; GearError where a ring has no flank at its tip."""
        return (self.pinion.tip_curvature - self.path_start) / self.base_pitch

    def overlap_ratio(self, width: float) -> float:
        """Overlap ratio ε_β of helical teeth of a common face width (m), b sin β/(π m_n)."""
        return width * math.sin(abs(self.helix)) / (math.pi * self.module)

    @property
    def pitch_phase(self) -> float:
        """Mesh cycles from where a tooth pair enters to where it touches at the pitch point."""
        return (self.pinion_pitch_radius * math.sin(self.working_angle) - self.path_start) / self.base_pitch

    def line_of_action(self, angle: float, flank: int = 1) -> np.ndarray:
        """Force on the driven gear per force in the transverse section, pinion at `angle` (rad) around x, shape (3,).

        Tangential in the turning direction, and radial: an internal mesh pushes the ring away, an external one towards
        its axis. Along x it is tan β_b, forwards where the helix is positive. Of the coast flank, −1, the force is
        negative, and pushes the gears apart all the same.
        """
        radial = np.array([0.0, math.cos(angle), math.sin(angle)])
        tangential = np.array([0.0, -math.sin(angle), math.cos(angle)])
        across = (
            math.cos(self.working_angle) * tangential + flank * self.turning * math.sin(self.working_angle) * radial
        )
        forwards = np.array([math.tan(self.helix) * math.cos(self.transverse_angle), 0.0, 0.0])
        return np.asarray(across + forwards)


@dataclass(frozen=True)
class ExternalPair(GearPair):
    """A pinion driving an external wheel.

    Parameters
    ----------
    pinion_teeth, wheel_teeth : int
    module, pressure_angle : float
        In the normal section, m and rad.
    helix : float
        Helix angle at the reference circles, rad.
    pinion_shift, driven_shift : float
        Profile shifts, modules.
    """

    turning: ClassVar[float] = -1.0

    pinion_teeth: int
    wheel_teeth: int
    module: float
    pressure_angle: float
    helix: float = 0.0
    pinion_shift: float = 0.0
    driven_shift: float = 0.0

    @property
    def driven_teeth(self) -> int:
        """Teeth of the wheel."""
        return self.wheel_teeth

    @property
    def wheel_pitch_radius(self) -> float:
        """Wheel pitch radius (m)."""
        return self.driven_pitch_radius

    @property
    def wheel_base_radius(self) -> float:
        """Wheel base radius (m)."""
        return self.driven_base_radius

    @property
    def pinion(self) -> Tooth:
        """Teeth of the pinion."""
        return self._tooth(self.pinion_teeth, self.pinion_shift)

    @property
    def wheel(self) -> Tooth:
        """Teeth of the wheel."""
        return self._tooth(self.wheel_teeth, self.driven_shift)

    def _tooth(self, teeth: int, shift: float) -> Tooth:
        return Tooth(teeth, self.module, self.pressure_angle, self.helix, shift, self._shortening)

    @property
    def _shortening(self) -> float:
        """Modules by which tips are shortened: gears with profile shifts are closer than the shifts set them apart."""
        plain = self.module / math.cos(self.helix) * self._teeth / 2.0
        return self.pinion_shift + self.driven_shift - (self.centre_distance - plain) / self.module

    @property
    def path_start(self) -> float:
        """Radius of curvature of the pinion flank where contact starts, at the wheel's tip (m)."""
        return self.between_base_circles - self.wheel.tip_curvature

    def check(self) -> None:
        """Raise what keeps the pair from meshing.

        Without profile shift no wheel reaches below a base circle, which is deeper than the rack of the undercut.

        Raises
        ------
        GearError
            Undercut, contact below a base circle, a contact ratio out of (1, 2), or a pointed tooth.
        """
        gears = (("pinion", self.pinion), ("wheel", self.wheel))
        for name, gear in gears:
            gear.check_undercut(name)
        for (name, gear), (_, other) in zip(gears, gears[::-1], strict=True):
            if other.tip_curvature > self.between_base_circles + ROUNDING * self.module:
                raise GearError(
                    f"{name} of {gear.teeth} teeth would touch below its base circle, allowed: other profile shifts"
                )
        _check_contact_ratio(self.contact_ratio)
        for name, gear in gears:
            gear.check_tip(name)


@dataclass(frozen=True)
class InternalPair(GearPair):
    """A pinion inside a ring gear that it drives; parameters as of an external pair."""

    turning: ClassVar[float] = 1.0

    pinion_teeth: int
    ring_teeth: int
    module: float
    pressure_angle: float
    helix: float = 0.0
    pinion_shift: float = 0.0
    driven_shift: float = 0.0

    @property
    def driven_teeth(self) -> int:
        """Teeth of the ring."""
        return self.ring_teeth

    @property
    def ring_pitch_radius(self) -> float:
        """Ring pitch radius (m)."""
        return self.driven_pitch_radius

    @property
    def ring_base_radius(self) -> float:
        """Ring base radius (m)."""
        return self.driven_base_radius

    @property
    def ring_tip_radius(self) -> float:
        """Ring tip radius (m)."""
        reference = self.module / math.cos(self.helix) * self.ring_teeth / 2.0
        return reference - self.module * (1.0 - self.driven_shift)

    @property
    def pinion(self) -> Tooth:
        """Teeth of the pinion."""
        return Tooth(self.pinion_teeth, self.module, self.pressure_angle, self.helix, self.pinion_shift)

    @property
    def path_start(self) -> float:
        """Radius of curvature of the pinion flank where contact starts, at the ring's tip (m); below 0: none there."""
        return self._ring_tip_curvature() - self.between_base_circles

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
        self.pinion.check_undercut("pinion")
        if self.path_start < -ROUNDING * self.module:
            raise GearError(
                f"contact in a ring of {self.ring_teeth} teeth would start below the base circle of the pinion of "
                f"{self.pinion_teeth} teeth, {-self.path_start * 1e3:.3g} mm along the line of action: "
                f"{self._touching()}"
            )
        _check_contact_ratio(self.contact_ratio)
        self.pinion.check_tip("pinion")
        self._check_tips_pass()

    def _touching(self) -> str:
        """Return what would let contact start on the pinion's flank."""
        more = (replace(self, pinion_teeth=teeth) for teeth in range(self.pinion_teeth + 1, self.ring_teeth))
        try:
            least = next((pair for pair in more if pair.path_start >= -ROUNDING * self.module), None)
        except GearError:
            least = None
        return "other profile shifts" if least is None else f"at least {least.pinion_teeth} pinion teeth"

    def _ring_tip_curvature(self) -> float:
        """Radius of curvature of the ring's flank at its tip (m)."""
        square = self.ring_tip_radius**2 - self.ring_base_radius**2
        if square < 0.0:
            allowed = "a larger profile shift"
            if self.driven_shift == 0.0:
                least = 2.0 * math.cos(self.helix) / (1.0 - math.cos(self.transverse_angle))
                allowed = f"at least {math.ceil(least - ROUNDING)} teeth"
            raise GearError(
                f"ring of {self.ring_teeth} teeth has its tip circle inside its base circle at "
                f"{degrees(self.pressure_angle)}: {allowed}"
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

        z1/z2 θ1 + inv α_w − inv α_a2 − θ2, Stock Drive Products, Elements of Metric Gear Technology, equations (5-6)
        and (5-7) (there "trochoid interference"; Maag and Colbourne: tip interference), working pressure angle α_w.
        """
        if self.ring_teeth - self.pinion_teeth <= 2:
            return -math.inf  # the tip circles never part
        distance, angle = self.centre_distance, involute(self.working_angle)
        pinion, ring = self.pinion.tip_radius, self.ring_tip_radius
        if pinion + distance <= ring:
            return math.inf  # the tip circles do not cross
        tip = involute(math.acos(self.pinion_base_radius / pinion))
        theta1 = math.acos((ring**2 - pinion**2 - distance**2) / (2.0 * distance * pinion)) + tip - angle
        theta2 = math.acos((distance**2 + ring**2 - pinion**2) / (2.0 * distance * ring))
        ring_tip = involute(math.acos(self.ring_base_radius / ring))
        return self.pinion_teeth / self.ring_teeth * theta1 + angle - ring_tip - theta2


def _check_contact_ratio(ratio: float) -> None:
    if not 1.0 < ratio < 2.0:
        raise GearError(f"contact ratio {ratio:.3f}: must lie between 1 and 2")
