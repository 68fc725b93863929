"""The head with its discs in a rock: from the forces on the discs to the six components."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its parts load on first use
from numpy.typing import ArrayLike

from tbm_dynamics.loads.cutters.csm import cutting_forces
from tbm_dynamics.loads.cutters.description import CutterDescription, CutterError, Face
from tbm_dynamics.loads.cutters.face import strengths_over_a_turn, wear_factors
from tbm_dynamics.loads.cutters.layout import CutterLayout
from tbm_msgs_py.base.arrays import Array

_DEEPEST = 0.05
"""Penetration in a turn up to which a thrust is met, m."""

_EVEN = Face(source="even rock, new cutters")


def wrench_rows(layout: CutterLayout) -> Array:
    """Six components about the head's centre per unit normal, rolling and side force of each disc, (3, n, 6).

    The head stands at angle 0 and turns from y towards z. The rock pushes a disc back along its plane (`normal`), holds
    it back against its way (`rolling`) and pushes it inwards, across its plane (`side`).
    """
    cosine, sine = np.cos(layout.angle), np.sin(layout.angle)
    zero = np.zeros_like(cosine)
    outward, along = np.array([zero, cosine, sine]), np.array([zero, -sine, cosine])
    axis = np.array([[1.0], [0.0], [0.0]])
    normal = -np.cos(layout.tilt) * axis - np.sin(layout.tilt) * outward
    side = np.sin(layout.tilt) * axis - np.cos(layout.tilt) * outward
    places = (layout.radius * outward).T
    rows = [np.hstack([force, np.cross(places, force)]) for force in (normal.T, -along.T, side.T)]
    return np.array(rows)


def in_fixed_axes(wrench: Array, angle: ArrayLike) -> Array:
    """Components in fixed axes of a wrench (…, 6) that is fixed to the head, at head angles (…), rad."""
    cosine, sine = np.cos(angle), np.sin(angle)
    found = np.array(np.broadcast_to(wrench, (*np.shape(angle), 6)))
    for y, z in ((1, 2), (4, 5)):
        found[..., y], found[..., z] = (
            cosine * wrench[..., y] - sine * wrench[..., z],
            sine * wrench[..., y] + cosine * wrench[..., z],
        )
    return found


@dataclass(frozen=True)
class Cutterhead:
    """A head with its discs in a rock: what the machine file says of them, and where they sit."""

    description: CutterDescription
    layout: CutterLayout

    @property
    def face(self) -> Face:
        """Where rock and cutters differ."""
        return self.description.face or _EVEN

    @property
    def friction(self) -> float:
        """Thrust that reaches no disc, N."""
        return 1e3 * self.description.friction_kn

    @property
    def rest(self) -> Array:
        """What reaches the head past the discs, (6,), N and N·m."""
        return np.array([-self.friction, 0.0, 0.0, -1e3 * self.description.idle_torque_kn_m, 0.0, 0.0])

    @cached_property
    def unit_wrenches(self) -> Array:
        """Wrench of each disc for 1 N of normal and of rolling force on a track of 1 m, (2, n, 6).

        Forces grow with the cube root of the spacing (equation of P₀), alike on all discs.
        """
        layout = self.layout
        normal, rolling, side = wrench_rows(layout)
        gauge = np.array([[kind == "gauge"] for kind in layout.kind])
        share = (wear_factors(self.face, layout) * np.cbrt(layout.spacing))[:, None]
        return np.array([share * (normal + self.description.side_share * gauge * side), share * rolling])

    @cached_property
    def _unit_means(self) -> Array:
        """Mean over a turn of the sum of `unit_wrenches`, in fixed axes, (2, 6)."""
        angles, strengths = strengths_over_a_turn(self.face, self.layout)
        return np.array([in_fixed_axes(strengths @ unit, angles).mean(axis=0) for unit in self.unit_wrenches])

    def forces(self, penetration: float) -> Array:
        """Return normal and rolling force of a new disc on a track of 1 m, (2,), N."""
        return np.array(cutting_forces(self.description.rock, self.description.disc, 1.0, penetration))

    def wrenches(self, penetration: float) -> Array:
        """Mean wrench of each disc in even rock on the head at angle 0, (n, 6), N and N·m."""
        found: Array = np.tensordot(self.forces(penetration), self.unit_wrenches, 1)
        return found

    def mean(self, penetration: float) -> Array:
        """Mean of each component over whole turns, (6,), N and N·m: in even rock thrust and torque alone."""
        found: Array = self.rest + self.forces(penetration) @ self._unit_means
        return found

    def penetration(self, thrust: float) -> float:
        """Penetration in a turn at which the discs take up the thrust, m.

        Raises
        ------
        CutterError
            A thrust that friction takes up, or that the rock cannot.
        """
        along = self._unit_means[:, 0]

        def surplus(depth: float) -> float:
            return float(self.friction - self.forces(depth) @ along - thrust)

        most = surplus(_DEEPEST) + thrust
        if not self.friction <= thrust <= most:
            raise CutterError(
                f"thrust {thrust / 1e3:g} kN, allowed are {self.friction / 1e3:g} kN, which friction takes up, to "
                f"{most / 1e3:.0f} kN, which presses the discs {_DEEPEST * 1e3:g} mm into the rock"
            )
        return float(scipy.optimize.brentq(surplus, 0.0, _DEEPEST, xtol=1e-9))
