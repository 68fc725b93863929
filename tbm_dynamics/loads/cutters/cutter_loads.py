"""Cutterhead loads from the discs: a pure function of (seed, time), and of the head's angle while the speed changes."""

from __future__ import annotations

import copy
import math
from functools import lru_cache
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from tbm_dynamics.loads.cutters.description import CutterError
from tbm_dynamics.loads.cutters.face import strength, zone_table
from tbm_dynamics.loads.cutters.fracture import Teeth, fluctuation, teeth
from tbm_dynamics.loads.cutters.head import Cutterhead
from tbm_dynamics.loads.noise import hashed_generator
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

_SEGMENT = 4.0
"""Of time (s) or angle (rad) whose chips are found at once."""

_KEPT = 4  # segments


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
        fracture, layout = head.description.fracture, head.layout
        along = layout.radius if fracture.along == "angle" else np.ones_like(layout.radius)
        self._rates = along / fracture.chip
        self._phases = hashed_generator(seed, "chips/phase").random(len(self._rates))
        self._zones = zone_table(head.face)
        self._rest = head.rest
        self._chips = lru_cache(maxsize=_KEPT)(self._teeth)
        self._drive(thrust, speed)

    def _drive(self, thrust: float, speed: float) -> None:
        if not (math.isfinite(speed) and speed > 0.0):
            raise CutterError(f"speed {speed:g} rad/s, must be a number above 0")
        self.speed = speed
        self.penetration = self.head.penetration(thrust)
        self.forces = self.head.forces(self.penetration)

    def at(self, thrust: float, speed: float) -> Self:
        """Return the same realisation at another thrust (N) and speed (rad/s); the chips found are shared."""
        other = copy.copy(self)
        other._drive(thrust, speed)
        return other

    @property
    def mean(self) -> Array:
        """Mean of each component over whole turns, (6,), N and N·m."""
        return self.head.mean(self.penetration)

    def evaluate(self, time: ArrayLike, angle: ArrayLike | None = None, forces: ArrayLike | None = None) -> Array:
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
        base = angles if self.head.description.fracture.along == "angle" else times
        if not np.all(np.isfinite(angles) & (np.abs(base) <= 1e9)):
            raise InputError("time and angle must be finite, within ±1e9")
        loads = np.empty((times.size, 6))
        segments = np.floor(base / _SEGMENT).astype(np.int64)
        order = np.argsort(segments, kind="stable")
        layout, release = self.head.layout, self.head.description.fracture.release
        places = np.array([layout.radius * np.cos(layout.angle), layout.radius * np.sin(layout.angle)])
        units = self.head.unit_wrenches
        for run in np.split(order, np.flatnonzero(np.diff(segments[order])) + 1):
            if run.size:
                chips = self._chips(int(segments[run[0]]))
                cycles = self._rates, self._phases
                loads[run] = _summed(
                    base[run], angles[run], pressed[run], cycles, chips, release, self._zones, places, units, self._rest
                )
        return loads

    def _teeth(self, segment: int) -> Teeth:
        ends = (self._rates * (segment + i) * _SEGMENT + self._phases for i in (0, 1))
        return teeth(self.head.description.fracture, self.seed, *ends)


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
