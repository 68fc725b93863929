"""The assembled system and its static equilibrium."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.linalg

from tbm_dynamics.structure.couplings import Couplings
from tbm_msgs_py.base.errors import MachineError
from tbm_msgs_py.base.operating_point import OperatingPoint

# Of the largest share in the torque, what is no more than the rounding of the solution.
_IDLE = 1e-6

DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")


@dataclass(frozen=True)
class Drives:
    """Where the drives are, and how their unknowns relate to those of the drive at angle 0.

    Attributes
    ----------
    angles : (p,) ndarray
        Places around the x axis (rad).
    dofs : (p, d) ndarray of int
        Unknowns of each drive's own nodes.
    turns : (p, d, d) ndarray
        From those to the axes of the drive.
    odd : tuple of int
        Drives whose mesh row, M, C or K, couplings left out, are not those of the others.
    rotors : (r,) ndarray of int
        Unknowns of the angles of the rotors that their drives turn.
    """

    angles: np.ndarray
    dofs: np.ndarray
    turns: np.ndarray
    odd: tuple[int, ...] = ()
    rotors: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))

    @cached_property
    def shared(self) -> np.ndarray:
        """Orthonormal columns (p, c) spanning 1, cos and sin of the angles, and each odd drive.

        Ring and mount, on the axis, are coupled to the first three only: any other motion stays within each drive, and
        is alike in all that are not odd.
        """
        angles, odd = self.angles, np.array(self.odd, dtype=np.intp)
        patterns = np.column_stack([np.ones_like(angles), np.cos(angles), np.sin(angles), np.eye(len(angles))[:, odd]])
        columns, sizes, _ = np.linalg.svd(patterns, full_matrices=False)
        return np.asarray(columns[:, sizes > 1e-9 * sizes[0]])


@dataclass(frozen=True)
class Equilibrium:
    """Static state under the mean load: displacement (n,) m and rad, forces of the couplings (2p,) N and N·m."""

    displacement: np.ndarray
    force: np.ndarray


@dataclass(frozen=True, eq=False)
class System:
    """M q̈ + C q̇ + K q = loads, with the couplings at their mean stiffness and closed on the drive flank.

    Compared by identity, so that what is computed from one can be kept.

    Attributes
    ----------
    M, C, K : (n, n) ndarray
        Mass, damping and stiffness; C and K hold the couplings' mean part.
    nodes : tuple of int
        Node numbers in the order of the unknowns, six each.
    couplings : Couplings
    drives : Drives
    load_dofs : (6,) ndarray of int
        Unknowns of the node that the cutterhead loads act on.
    motor_pattern : (n,) ndarray
        Generalised force of the motors per unit cutterhead torque (reflected to the pinion side).
    mean_load : (6,) ndarray
        Mean of the cutterhead loads (N, N·m).
    operating_point : OperatingPoint
    cylinders : (n,) ndarray or None
        Extension (m) per unit motion of the cylinders by which the mean thrust enters, the rock's spring holding
        against it; without them it is a load on the head.
    controlled : (n, n) ndarray or None
        Stiffness of what holds a mean force wherever it is, cylinders and motors, against what moves fast.
    rock_damping : float
        Moment of the rock's damper about x per speed of the head (N·m·s/rad), on top of the mean torque.
    assembled : System or None
        What it was `under` another operating point: all that does not depend on that is of both.
    """

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    nodes: tuple[int, ...]
    couplings: Couplings
    drives: Drives
    load_dofs: np.ndarray
    motor_pattern: np.ndarray
    mean_load: np.ndarray
    operating_point: OperatingPoint
    cylinders: np.ndarray | None = None
    controlled: np.ndarray | None = None
    rock_damping: float = 0.0
    assembled: System | None = None

    def under(self, point: OperatingPoint, mean_load: np.ndarray) -> System:
        """Return the same system at another operating point, under its mean loads (6,)."""
        return replace(self, operating_point=point, mean_load=mean_load, assembled=self.assembled or self)

    @property
    def size(self) -> int:
        """Number of unknowns n."""
        return len(self.M)

    def dof(self, node: int, direction: str) -> int:
        """Index of an unknown: direction is one of ux, uy, uz, rx, ry, rz.

        Raises
        ------
        MachineError
            Unknown node or direction.
        """
        if node not in self.nodes:
            raise MachineError(
                f"node {node}: unknown; the system has {len(self.nodes)} nodes, {min(self.nodes)} to {max(self.nodes)}"
            )
        if direction not in DIRECTIONS:
            raise MachineError(f"direction {direction!r}: allowed are {', '.join(DIRECTIONS)}")
        return 6 * self.nodes.index(node) + DIRECTIONS.index(direction)

    @cached_property
    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Undamped natural frequencies (n,) Hz, ascending, and mass-normalised modes (n, n)."""
        squares, shapes = scipy.linalg.eigh(self.K, self.M)
        return np.sqrt(np.maximum(squares, 0.0)) / (2.0 * math.pi), shapes

    def natural_frequencies(self, count: int | None = None) -> np.ndarray:
        """Lowest undamped natural frequencies (count,) in Hz, meshes at their mean stiffness."""
        return self.modes[0][:count]

    @cached_property
    def _factor(self) -> tuple[np.ndarray, bool]:
        factor, lower = scipy.linalg.cho_factor(self.K, lower=True)
        return np.asarray(factor), bool(lower)

    def solve(self, force: np.ndarray) -> np.ndarray:
        """Solve for the static displacement (n,) or (n, k) under forces, couplings at their mean stiffness."""
        return np.asarray(scipy.linalg.cho_solve(self._factor, force))

    @cached_property
    def _static_factor(self) -> tuple[np.ndarray, bool]:
        if self.controlled is None:
            return self._factor
        factor, lower = scipy.linalg.cho_factor(self.K - self.controlled, lower=True)
        return np.asarray(factor), bool(lower)

    def driving(self, point: OperatingPoint) -> np.ndarray:
        """Torque of the motors on the side of the head, and moment of the gross rotation against it, (2,) N·m."""
        moment = self.rock_damping * point.speed
        return np.array([point.torque + moment, moment])

    def mean_force(self) -> np.ndarray:
        """Mean generalised force of rock, motors and thrust cylinders, shape (n,)."""
        torque, moment = self.driving(self.operating_point)
        force: np.ndarray = torque * self.motor_pattern
        force[self.load_dofs] += self.mean_load
        force[self.load_dofs[3]] -= moment
        if self.cylinders is not None:
            force[self.load_dofs[0]] -= self.mean_load[0]
            force -= self.mean_load[0] * self.cylinders
        return force

    def equilibrium(self, stiffness: np.ndarray | None = None, error: np.ndarray | None = None) -> Equilibrium:
        """Find the static equilibrium under the mean load, the rotors having taken up the gap on their `flank`.

        Parameters
        ----------
        stiffness, error : (2p,) ndarray, optional
            Stiffness and error of the couplings to hold; the mean and none by default.
        """
        rows, gap, mean = self.couplings.rows, self.couplings.half_gap, self.couplings.stiffness
        k = mean if stiffness is None else stiffness
        e = np.zeros(len(rows)) if error is None else error
        # K + rowsᵀ (k − k̄) rows, solved among the deflections: what the couplings do beyond their mean is a force.
        free, bent = self._static_shapes
        flexibility, given = rows @ bent, rows @ free
        taken_up = gap * self.flank
        correction, push = k - mean, k * (taken_up - e)
        deflection = np.linalg.solve(np.eye(len(rows)) + flexibility * correction, given + flexibility @ push)
        displacement = free + bent @ (push - correction * deflection)
        return Equilibrium(displacement, k * (deflection + e - taken_up))

    @cached_property
    def flank(self) -> np.ndarray:
        """Flank on which each coupling rests, (2p,): 1 the drive flank, −1 the coast flank.

        That of its static force: the motor's torque, whatever torque, loads, stiffness and error are. A drive without a
        share in the torque is dragged by the ring, on the coast flank.
        """
        force = self.couplings.stiffness * (self.couplings.rows @ self.solve(self.motor_pattern))
        largest = np.repeat(np.abs(force.reshape(2, -1)).max(axis=1), self.couplings.drives)
        return np.where(force > _IDLE * largest, 1.0, -1.0)

    @cached_property
    def _static_shapes(self) -> tuple[np.ndarray, np.ndarray]:
        """Displacement under the mean force (n,), and under unit forces of the couplings (n, 2p)."""
        forces = np.column_stack([self.mean_force(), self.couplings.rows.T])
        found = np.asarray(scipy.linalg.cho_solve(self._static_factor, forces))
        return found[:, 0], found[:, 1:]
