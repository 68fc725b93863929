"""The assembled system and its static equilibrium."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from tbm_dynamics.machine.loading import MachineError
from tbm_dynamics.machine.machine import OperatingPoint

DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")


@dataclass(frozen=True)
class Meshes:
    """All pinion–ring meshes of a machine.

    Attributes
    ----------
    rows : (p, n) ndarray
        Deflection along each line of action, compression on the drive flank positive: δ = rows q + e.
    mean_stiffness, damping : float
        k̄ (N/m) and c_m (N·s/m).
    half_gap : float
        Half the total backlash (m).
    stiffness_table : (s,) ndarray
        k over one mesh cycle (N/m), the same for every mesh.
    phases, shaft_phases : (p,) ndarray
        Mesh phase γ_i and phase of the shaft-frequency error (cycles).
    tooth_error, shaft_error : float
        Amplitudes of the error at mesh and at pinion shaft frequency (m).
    ring_teeth, pinion_teeth : int
    ring_base_radius : float
        m.
    """

    rows: np.ndarray
    mean_stiffness: float
    damping: float
    half_gap: float
    stiffness_table: np.ndarray
    phases: np.ndarray
    shaft_phases: np.ndarray
    tooth_error: float
    shaft_error: float
    ring_teeth: int
    pinion_teeth: int
    ring_base_radius: float

    @property
    def count(self) -> int:
        """Number of meshes p."""
        return len(self.rows)


@dataclass(frozen=True)
class Equilibrium:
    """Static state under the mean load: displacement (n,) m and rad, mesh forces (p,) N."""

    displacement: np.ndarray
    mesh_force: np.ndarray


@dataclass(frozen=True)
class System:
    """M q̈ + C q̇ + K q = loads, with the meshes at their mean stiffness and closed on the drive flank.

    Attributes
    ----------
    M, C, K : (n, n) ndarray
        Mass, damping and stiffness; C and K hold the meshes' mean part.
    nodes : tuple of int
        Node numbers in the order of the unknowns, six each.
    meshes : Meshes
    load_dofs : (6,) ndarray of int
        Unknowns of the node that takes the cutterhead loads.
    motor_pattern : (n,) ndarray
        Generalised force of the motors per unit cutterhead torque (reflected to the pinion side).
    mean_load : (6,) ndarray
        Mean of the cutterhead loads (N, N·m).
    operating_point : OperatingPoint
    """

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    nodes: tuple[int, ...]
    meshes: Meshes
    load_dofs: np.ndarray
    motor_pattern: np.ndarray
    mean_load: np.ndarray
    operating_point: OperatingPoint

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

    def mean_force(self) -> np.ndarray:
        """Mean generalised force of rock and motors, shape (n,)."""
        force = self.operating_point.torque * self.motor_pattern
        force[self.load_dofs] += self.mean_load
        return force

    def equilibrium(self, stiffness: np.ndarray | None = None, error: np.ndarray | None = None) -> Equilibrium:
        """Find the static equilibrium under the mean load, the rotors having taken up the gap.

        Contact is found by iteration over the state of the meshes (drive flank, open, back flank).

        Parameters
        ----------
        stiffness, error : (p,) ndarray, optional
            Mesh stiffness (N/m) and error (m) to hold; the mean and none by default.

        Raises
        ------
        MachineError
            The meshes in contact do not settle.
        """
        rows, gap = self.meshes.rows, self.meshes.half_gap
        k = np.full(len(rows), self.meshes.mean_stiffness) if stiffness is None else stiffness
        e = np.zeros(len(rows)) if error is None else error
        force = self.mean_force()
        flank = np.ones(len(rows))
        for _ in range(4 * len(rows)):
            correction = k * np.abs(flank) - self.meshes.mean_stiffness
            K = self.K + rows.T @ (correction[:, None] * rows)
            q = scipy.linalg.solve(K, force + rows.T @ (k * (gap * flank - e) * np.abs(flank)), assume_a="sym")
            deflection = rows @ q + e
            new = np.sign(deflection) * (np.abs(deflection) > gap)
            if np.array_equal(new, flank):
                return Equilibrium(q, k * (deflection - gap * flank) * np.abs(flank))
            flank = new
        raise MachineError("static equilibrium: the meshes in contact do not settle; check torque and backlash")
