"""Cutterhead loads from the discs: a pure function of (seed, time), and of the head's angle while the speed changes."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np
import scipy  # its parts load on first use
from numba import njit
from numpy.typing import ArrayLike

from tbm_dynamics.loads.cutters.csm import Disc, Rock, cutting_forces
from tbm_dynamics.loads.cutters.errors import CutterError
from tbm_dynamics.loads.cutters.face import Face, strength
from tbm_dynamics.loads.cutters.fracture import Fracture, Teeth, fluctuation, teeth
from tbm_dynamics.loads.cutters.head import turned, wrench_rows
from tbm_dynamics.loads.cutters.layout import CutterLayout, FloatArray
from tbm_dynamics.loads.noise import hashed_generator
from tbm_msgs_py.base.errors import InputError

_DEEPEST = 0.05
"""Penetration in a turn up to which a thrust is met, m."""

_STRETCH = 4.0
"""Of time (s) or angle (rad) whose chips are found at once."""

_KEPT = 4


@dataclass(frozen=True)
class Cutterhead:
    """A head with its discs in a rock.

    Attributes
    ----------
    layout : CutterLayout
    disc : Disc
    rock : Rock
    fracture : Fracture
    side_share : float
        Side force of a gauge disc over its normal force.
    friction : float
        Thrust that reaches no disc, N.
    idle_torque : float
        Torque that reaches no disc, N·m.
    face : Face
        Where rock and cutters differ.
    """

    layout: CutterLayout
    disc: Disc
    rock: Rock
    fracture: Fracture
    side_share: float
    friction: float
    idle_torque: float
    face: Face = field(default_factory=Face)

    @property
    def rest(self) -> FloatArray:
        """What reaches the head past the discs, (6,), N and N·m."""
        return np.array([-self.friction, 0.0, 0.0, -self.idle_torque, 0.0, 0.0])

    @cached_property
    def unit_wrenches(self) -> FloatArray:
        """Wrench of each disc for 1 N of normal and of rolling force on a track of 1 m, (2, n, 6).

        Forces grow with the cube root of the spacing (equation of P₀), alike on all discs.
        """
        layout = self.layout
        normal, rolling, side = wrench_rows(layout)
        gauge = np.array([[kind == "gauge"] for kind in layout.kind])
        share = (self.face.factors(layout) * np.cbrt(layout.spacing))[:, None]
        return np.array([share * (normal + self.side_share * gauge * side), share * rolling])

    @cached_property
    def _unit_means(self) -> FloatArray:
        """Mean over a turn of the sum of `unit_wrenches`, in fixed axes, (2, 6)."""
        angles, strengths = self.face.over_a_turn(self.layout)
        return np.array([turned(strengths @ unit, angles).mean(axis=0) for unit in self.unit_wrenches])

    def forces(self, penetration: float) -> FloatArray:
        """Give normal and rolling force of a new disc on a track of 1 m, (2,), N."""
        return np.array(cutting_forces(self.rock, self.disc, 1.0, penetration))

    def wrenches(self, penetration: float) -> FloatArray:
        """Compute the mean wrench of each disc in even rock on the head at angle 0, (n, 6), N and N·m."""
        found: FloatArray = np.tensordot(self.forces(penetration), self.unit_wrenches, 1)
        return found

    def mean(self, penetration: float) -> FloatArray:
        """Mean of each component over whole turns, (6,), N and N·m: in even rock thrust and torque alone."""
        found: FloatArray = self.rest + self.forces(penetration) @ self._unit_means
        return found

    def penetration(self, thrust: float) -> float:
        """Find the penetration in a turn at which the discs take up the thrust, m.

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


class CutterLoads:
    """The six load components of node 1, N and N·m, in fixed axes.

    Parameters
    ----------
    head : Cutterhead
    thrust : float
        N.
    speed : float
        Of the head, rad/s.
    seed : int
        Of the chips.
    """

    def __init__(self, head: Cutterhead, thrust: float, speed: float, seed: int = 0) -> None:
        self.head, self.seed = head, seed
        fracture, layout = head.fracture, head.layout
        along = layout.radius if fracture.along == "angle" else np.ones_like(layout.radius)
        self._rates = along / fracture.chip
        self._phases = hashed_generator(seed, "chips/phase").random(len(self._rates))
        self._zones = head.face.table
        self._rest = head.rest
        self._kept: dict[int, Teeth] = {}
        self._drive(thrust, speed)

    def _drive(self, thrust: float, speed: float) -> None:
        if not (math.isfinite(speed) and speed > 0.0):
            raise CutterError(f"speed {speed:g} rad/s, must be a number above 0")
        self.speed = speed
        self.penetration = self.head.penetration(thrust)
        self.forces = self.head.forces(self.penetration)

    def at(self, thrust: float, speed: float) -> Self:
        """Give the same realisation at another thrust (N) and speed (rad/s); the chips found are shared."""
        other = copy.copy(self)
        other._drive(thrust, speed)
        return other

    @property
    def mean(self) -> FloatArray:
        """Mean of each component over whole turns, (6,), N and N·m."""
        return self.head.mean(self.penetration)

    def evaluate(self, time: ArrayLike, angle: ArrayLike | None = None, forces: ArrayLike | None = None) -> FloatArray:
        """Evaluate the loads at any times.

        Parameters
        ----------
        time : array_like, shape (n,)
            Stream time in s, in any order.
        angle : array_like, shape (n,), optional
            Of the head at those times, rad; at constant speed by default.
        forces : array_like, shape (n, 2), optional
            Normal and rolling force of a disc on a track of 1 m at those times, N; those of the thrust by default.

        Returns
        -------
        ndarray, shape (n, 6)
            N and N·m; the same bits for the same time and angle, however they are asked for.
        """
        times = np.asarray(time, dtype=float)
        angles = self.speed * times if angle is None else np.asarray(angle, dtype=float)
        if times.ndim != 1 or angles.shape != times.shape:
            raise InputError(f"time and angle must have the same shape (n,), not {times.shape} and {angles.shape}")
        pressed = np.array(np.broadcast_to(self.forces if forces is None else forces, (times.size, 2)), dtype=float)
        base = angles if self.head.fracture.along == "angle" else times
        if not np.all(np.isfinite(angles) & (np.abs(base) <= 1e9)):
            raise InputError("time and angle must be finite, within ±1e9")
        loads = np.empty((times.size, 6))
        stretches = np.floor(base / _STRETCH).astype(np.int64)
        order = np.argsort(stretches, kind="stable")
        layout, release = self.head.layout, self.head.fracture.release
        places = np.array([layout.radius * np.cos(layout.angle), layout.radius * np.sin(layout.angle)])
        units = self.head.unit_wrenches
        for run in np.split(order, np.flatnonzero(np.diff(stretches[order])) + 1):
            if run.size:
                chips = self._chips(int(stretches[run[0]]))
                cycles = self._rates, self._phases
                loads[run] = _summed(
                    base[run], angles[run], pressed[run], cycles, chips, release, self._zones, places, units, self._rest
                )
        return loads

    def _chips(self, stretch: int) -> Teeth:
        found = self._kept.pop(stretch, None)
        if found is None:
            ends = (self._rates * (stretch + i) * _STRETCH + self._phases for i in (0, 1))
            found = teeth(self.head.fracture, self.seed, *ends)
        self._kept[stretch] = found  # the most recently used one is last
        if len(self._kept) > _KEPT:
            del self._kept[next(iter(self._kept))]
        return found


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _summed(
    base: np.ndarray,
    angle: np.ndarray,
    forces: np.ndarray,
    cycles: tuple[np.ndarray, np.ndarray],
    chips: Teeth,
    release: float,
    zones: np.ndarray,
    places: np.ndarray,
    units: np.ndarray,
    rest: np.ndarray,
) -> np.ndarray:
    """Sum the discs, rates and phases in `cycles`, at places `base` (n,), and turn them with the head: (n, 6)."""
    out = np.empty((len(base), 6))
    normal, rolling, total = np.empty(6), np.empty(6), np.empty(6)
    rates, phases = cycles
    for i in range(len(base)):
        normal[:] = 0.0
        rolling[:] = 0.0
        cosine, sine = math.cos(angle[i]), math.sin(angle[i])
        for disc in range(len(rates)):
            force = 1.0 + fluctuation(rates[disc] * base[i] + phases[disc], disc, chips, release)
            if len(zones):
                y, z = places[0, disc], places[1, disc]
                force *= strength(zones, cosine * y - sine * z, sine * y + cosine * z)
            for c in range(6):
                normal[c] += force * units[0, disc, c]
                rolling[c] += force * units[1, disc, c]
        for c in range(6):
            total[c] = forces[i, 0] * normal[c] + forces[i, 1] * rolling[c]
        for c in (0, 3):
            out[i, c] = rest[c] + total[c]
            out[i, c + 1] = rest[c + 1] + cosine * total[c + 1] - sine * total[c + 2]
            out[i, c + 2] = rest[c + 2] + sine * total[c + 1] + cosine * total[c + 2]
    return out
