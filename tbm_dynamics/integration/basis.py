"""The production basis: reduced symmetric and individual parts of the motion of a machine with cyclic symmetry.

Ring and mount lie on the axis and, where the drives are alike, feel of them only the sums of their motions weighted
with 1, cos and sin of their angles (`Drives.shared`); one with a seat of its own is a pattern by itself. Drives differ
in their couplings and torques: the basis is that of the couplings that most drives have (`Couplings.alike`), what a
coupling has beyond them is a force on its drive alone. So the motion splits exactly, whatever the number of drives,
into

- symmetric parts: all other nodes, and the drives moving in those patterns; where axial, torsional and lateral
  motion are uncoupled, as in a machine round its axis, that is one part for each;
- an individual part of each drive: what is left, in which every drive moves as if ring and mount stood still.

Either is reduced to the motions that forces can bring about: of the loads and motors, and of the couplings,

- the static ones K⁻¹f, so that every static answer is exact, and so is the start, at which the rotors are held;
- for the meshes those at (K + ω²M)⁻¹: a pinion moves by itself under a blow, the faster it is, the less of the machine
  follows;
- lightly damped modes in the loads' range, whose resonances are narrow;
- what is left of the harmonic responses (K + iωC − ω²M)⁻¹f, damping included, over the range of the loads and of the
  gears: their directions by size (proper orthogonal decomposition in the frequency domain: Kim, AIAA J. 36, 1998), down
  to a tolerance.

Unlike undamped modes up to a frequency these hold for any damping, with fewer states.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.csgraph

from tbm_dynamics.integration.linear import INPUTS, MOTORS, LinearSystem, first_order, input_columns
from tbm_dynamics.integration.pairs import Eigenbasis, eigenbasis
from tbm_dynamics.structure.system import System

DEFAULT_TOLERANCE = 1e-4
"""Of the accelerations under a force, over the largest under it at any frequency."""

# Where responses are sampled: the loads end near 210 Hz, the teeth of the gearboxes mesh up to 1.1 kHz.
_LOADED_HZ = (5.0, 15.0, 30.0, 50.0, 70.0, 90.0, 110.0, 130.0, 150.0, 170.0, 190.0, 215.0, 250.0, 320.0)
_GEARED_HZ = (*_LOADED_HZ, 450.0, 600.0, 850.0, 1150.0)

# A mode up to here and less damped than this is always kept.
_RESONANT_HZ, _RESONANT_RATIO = 250.0, 0.1

# How fast a pinion is struck.
_STRIKE_HZ = 3000.0

# Of a vector of unit mass, the least rest beyond others that is no rounding.
_LEAST = 1e-6

# Coupling, over the geometric mean of the diagonal, below which two unknowns are uncoupled.
_UNCOUPLED = 1e-12


@dataclass(frozen=True)
class ModalPart:
    """One part of the motion in its basis, with the first-order system there.

    Attributes
    ----------
    shapes : (d, m) ndarray
        Motion of the part's unknowns per coordinate: all n of a symmetric part, those of a drive in its own axes
        of the individual part.
    project : (m, d) ndarray
        Coordinates from a motion.
    linear : LinearSystem
        With the inputs and couplings listed.
    inputs : (i,) ndarray of int
        Which of the 7 inputs act on it.
    couplings : (k,) ndarray of int
        Which couplings it holds. Symmetric part: of 2c, meshes then gearboxes, each in the c shared patterns;
        individual part: mesh and gearbox.
    """

    shapes: np.ndarray
    project: np.ndarray
    linear: LinearSystem
    inputs: np.ndarray
    couplings: np.ndarray

    def balanced(self, velocity: np.ndarray, force: np.ndarray) -> np.ndarray:
        """State (2m, …) at coordinates that hold the dampers, moving at a velocity (m, …), and forces of couplings.

        `force` is that of all couplings that `couplings` counts among. A displacement found outside the basis would be
        a blow on its stiffest coordinates.
        """
        m, i = len(velocity), len(self.inputs)
        stiffness, damping, forced = -self.linear.H[m:, :m], -self.linear.H[m:, m:], self.linear.E[m:, i:]
        push = forced @ force[self.couplings] - damping @ velocity
        return np.concatenate([np.linalg.solve(stiffness, push), velocity])

    @cached_property
    def eigenbasis(self) -> Eigenbasis:
        """Eigenvectors of its motion.

        Raises
        ------
        SimulationError
            They are nearly dependent.
        """
        return eigenbasis(self.linear.H)


@dataclass(frozen=True, eq=False)
class SplitBasis:
    """Symmetric parts, uncoupled from each other, the individual part of a drive, and the patterns (p, c).

    `own_torque` (p,) is what of the motors' torque the patterns do not hold: the torque on each drive's individual part
    per unit of that on the cutterhead, all 0 where the motors share alike.
    """

    symmetric: tuple[ModalPart, ...]
    individual: ModalPart
    shared: np.ndarray
    own_torque: np.ndarray


def split_basis(system: System, tolerance: float = DEFAULT_TOLERANCE) -> SplitBasis:
    """Split the motion of a system and reduce its parts; those of the last systems, wherever they work, are kept."""
    return _split_basis(system.assembled or system, tolerance)


@lru_cache(maxsize=2)
def _split_basis(system: System, tolerance: float) -> SplitBasis:
    shared = system.drives.shared
    rows = system.couplings.rows.reshape(2, len(shared), -1)
    expand = _symmetric_unknowns(system, shared)
    patterns = (shared.T @ rows).reshape(-1, system.size) @ expand
    alike = _alike_matrices(system)
    M, C, K = (expand.T @ (matrix @ expand) for matrix in alike)
    meshes = np.arange(2 * shared.shape[1]) < shared.shape[1]
    rotors = _rotors(system)
    whole = _Problem(M, C, K, expand.T @ input_columns(system), patterns, meshes, expand.T @ rotors @ shared)
    symmetric = [
        _reduced(whole.restricted(unknowns), expand[:, unknowns], tolerance) for unknowns in whole.components()
    ]
    usual = min(set(range(len(shared))) - set(system.drives.odd))
    own, turn = system.drives.dofs[usual], system.drives.turns[usual]
    M, C, K = (turn @ matrix[np.ix_(own, own)] @ turn.T for matrix in alike)
    inputs = np.zeros((len(own), INPUTS))
    inputs[:, MOTORS], own_torque = _own_torque(system, shared)
    coupled = rows[:, usual, own] @ turn.T
    individual = _Problem(M, C, K, inputs, coupled, np.array([True, False]), turn @ rotors[own][:, [usual]])
    return SplitBasis(
        tuple(symmetric), _reduced(individual, scipy.sparse.csr_array(np.eye(len(own))), tolerance), shared, own_torque
    )


def _alike_matrices(system: System) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """M, C, K, each (n, n), with the couplings that most drives have."""
    couplings = system.couplings
    beyond = couplings.alike - [couplings.stiffness, couplings.damping]
    if not beyond.any():
        return system.M, system.C, system.K
    stiffness, damping = (couplings.rows.T @ (part[:, None] * couplings.rows) for part in beyond)
    return system.M, system.C + damping, system.K + stiffness


def _rotors(system: System) -> np.ndarray:
    """Torque on the rotor of each drive, (n, p); none on one that its drive does not turn."""
    drives = system.drives
    torque = np.zeros((system.size, len(drives.dofs)))
    for i, dofs in enumerate(drives.dofs):
        torque[np.intersect1d(dofs, drives.rotors), i] = 1.0
    return torque


def _own_torque(system: System, shared: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Direction of a motor's torque in the axes of its drive (d,), and what of it is beyond the patterns (p,)."""
    drives = system.drives
    forces = np.einsum("pij,pj->pi", drives.turns, system.motor_pattern[drives.dofs])
    beyond = forces - shared @ (shared.T @ forces)
    strongest = forces[np.abs(forces).max(axis=1).argmax()]
    direction = strongest / np.linalg.norm(strongest)
    torque = beyond @ direction
    if np.abs(torque).max() <= _UNCOUPLED * np.abs(forces).max():
        return np.zeros_like(direction), np.zeros_like(torque)
    return direction, torque


@dataclass(frozen=True)
class _Problem:
    """Matrices (d, d), inputs (d, 7) and coupling rows (k, d) of some unknowns; which couplings are meshes.

    `rotors` (d, c) are torques on the rotors: a run starts with these held.
    """

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    inputs: np.ndarray
    rows: np.ndarray
    meshes: np.ndarray
    rotors: np.ndarray

    def components(self) -> list[np.ndarray]:
        """Return sets of unknowns that nothing couples: axial, torsional and lateral motion as a rule.

        Those that neither loads nor couplings act on, and so never move, are left out.
        """
        linked = np.zeros((len(self.M), len(self.M)), dtype=bool)
        for matrix in (self.M, self.C, self.K):
            scale = np.sqrt(np.abs(matrix.diagonal()))
            linked |= np.abs(matrix) > _UNCOUPLED * np.outer(scale, scale)
        joined = self.rows.T != 0.0
        joined &= np.abs(self.rows.T) > _UNCOUPLED * np.abs(self.rows).max(axis=1)
        linked |= (joined.astype(float) @ joined.T.astype(float)) > 0.0
        count, labels = scipy.sparse.csgraph.connected_components(linked, directed=False)
        moved = joined.any(axis=1) | np.any(self.inputs != 0.0, axis=1)
        return [np.flatnonzero(labels == label) for label in range(count) if moved[labels == label].any()]

    def restricted(self, unknowns: np.ndarray) -> _Problem:
        """Return the same for some of the unknowns."""
        square = np.ix_(unknowns, unknowns)
        M, C, K = (matrix[square] for matrix in (self.M, self.C, self.K))
        return _Problem(M, C, K, self.inputs[unknowns], self.rows[:, unknowns], self.meshes, self.rotors[unknowns])


def _symmetric_unknowns(system: System, shared: np.ndarray) -> scipy.sparse.csr_array:
    """Columns of the symmetric unknowns, orthonormal, (n, n_c): the other nodes, then the drives' patterns."""
    drives = system.drives
    others = np.setdiff1d(np.arange(system.size), drives.dofs)
    expand = np.zeros((system.size, len(others) + drives.dofs.shape[1] * shared.shape[1]))
    expand[others, np.arange(len(others))] = 1.0
    weighted = shared[:, None, :, None] * drives.turns.transpose(0, 2, 1)[:, :, None, :]
    expand[drives.dofs, len(others) :] = weighted.reshape(*drives.dofs.shape, -1)
    return scipy.sparse.csr_array(expand)


def _reduced(problem: _Problem, expand: scipy.sparse.csr_array, tolerance: float) -> ModalPart:
    """Modal part of some unknowns; `expand` (d, u) gives the motion of the part from them."""
    inputs = np.flatnonzero(np.any(problem.inputs != 0.0, axis=0))
    size = np.abs(problem.rows).max(axis=1)
    couplings = np.flatnonzero(size > _UNCOUPLED * size.max()) if size.max() > 0.0 else np.arange(0)
    rows, pushed = problem.rows[couplings], problem.inputs[:, inputs]
    held = problem.rotors[:, np.any(problem.rotors != 0.0, axis=0)]
    shapes = _shapes(problem, rows.T, pushed, rows[problem.meshes[couplings]].T, held, tolerance)
    M, C, K = (shapes.T @ matrix @ shapes for matrix in (problem.M, problem.C, problem.K))
    linear = first_order(M, C, K, shapes.T @ pushed, rows @ shapes)
    # Mass-orthonormal shapes: the coordinates are the projections in the sense of the mass.
    return ModalPart(expand @ shapes, (expand @ (problem.M @ shapes)).T, linear, inputs, couplings)


def _shapes(
    problem: _Problem,
    coupled: np.ndarray,
    pushed: np.ndarray,
    meshes: np.ndarray,
    held: np.ndarray,
    tolerance: float,
) -> np.ndarray:
    """Motions that are kept, (d, m), mass-orthonormal and diagonal in the stiffness."""
    # In unknowns of unit mass, x = L⁻ᵀ y of M = L Lᵀ: there mass-orthonormal is orthonormal.
    factor = np.linalg.cholesky(problem.M)
    inverse = scipy.linalg.solve_triangular(factor, np.eye(len(factor)), lower=True)
    C, K = (inverse @ matrix @ inverse.T for matrix in (problem.C, problem.K))
    coupled, pushed, meshes, held = (inverse @ forces for forces in (coupled, pushed, meshes, held))
    struck = K + (2.0 * np.pi * _STRIKE_HZ) ** 2 * np.eye(len(K))
    attachments = np.hstack(
        [
            scipy.linalg.solve(K, np.hstack([coupled, pushed, held]), assume_a="pos"),
            scipy.linalg.solve(struck, meshes, assume_a="pos"),
        ]
    )
    modes = _resonant_modes(C, K)
    kept = np.hstack([modes, _beyond(modes, attachments / np.linalg.norm(attachments, axis=0), _LEAST)])
    basis = np.hstack([kept, _beyond(kept, _responses(C, K, coupled, pushed), tolerance)])
    _, rotation = scipy.linalg.eigh(basis.T @ K @ basis)
    return np.asarray(inverse.T @ (basis @ rotation))


def _resonant_modes(C: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Modes that a load could bring to resonance, (d, k)."""
    highest = (2.0 * np.pi * _RESONANT_HZ) ** 2
    squares, modes = scipy.linalg.eigh(K, subset_by_value=(-np.inf, highest))
    omega = np.sqrt(np.maximum(squares, 0.0))
    ratio = np.einsum("ir,ir->r", modes, C @ modes) / (2.0 * np.maximum(omega, 1e-9))
    return np.asarray(modes[:, ratio < _RESONANT_RATIO])


def _responses(C: np.ndarray, K: np.ndarray, coupled: np.ndarray, pushed: np.ndarray) -> np.ndarray:
    """Accelerations (d, r) under harmonic forces of couplings and inputs, of each force the largest of length 1."""
    forces, unit = np.hstack([coupled, pushed]), np.eye(len(K))
    # One by one: matrices of one frequency stay in the cache.
    answer = np.array(
        [w**2 * np.linalg.solve(K - w**2 * unit + 1j * w * C, forces) for w in 2.0 * np.pi * np.array(_GEARED_HZ)]
    )
    found = []
    for answers in (answer[:, :, : coupled.shape[1]], answer[: len(_LOADED_HZ), :, coupled.shape[1] :]):
        parts = np.concatenate([answers.real, answers.imag])
        largest = np.linalg.norm(parts, axis=1).max(axis=0)
        found.append((parts / largest).transpose(1, 0, 2).reshape(len(K), -1))
    return np.hstack(found)


def _beyond(kept: np.ndarray, vectors: np.ndarray, tolerance: float) -> np.ndarray:
    """Orthonormal directions of vectors (d, c) beyond the kept ones, larger than a tolerance, (d, m)."""
    vectors = vectors - kept @ (kept.T @ vectors)
    sizes, directions = scipy.linalg.eigh(vectors @ vectors.T)
    found = directions[:, sizes > tolerance**2]
    # Again: of nearly dependent vectors, rounding leaves some of the kept ones.
    return np.asarray(np.linalg.qr(found - kept @ (kept.T @ found))[0])
