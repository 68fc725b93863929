"""The production basis: modes of what the drives share with ring and mount, and modes of a drive for itself.

The drives are alike, and ring and mount lie on the axis: they feel of the drives only the sums of their motions
weighted with 1, cos and sin of their angles (`Drives.shared`). So the motion splits exactly, whatever the number of
drives, into

- the common part: all other nodes, and the drives moving in those three patterns; where axial, torsional and lateral
  motion have nothing to do with each other, as in a machine round its axis, that is one part for each;
- each drive's own part: what is left, in which every drive moves as if ring and mount stood still.

Either is reduced to its modes below a cut-off, those above it that a load could bring to resonance, and attachment
modes. The attachment modes K⁻¹·(couplings, load node, motors) keep every static answer exact, and with M, K and C
reduced by the same basis a dropped mode still answers as K⁻¹/(1 + iωζ): its first-order lag is kept. Those of meshes
and load node at (K + ω²M)⁻¹ let a pinion, or the head, move by itself under a blow: the faster it is, the less of the
machine follows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse.csgraph

from tbm_dynamics.integration.linear import INPUTS, LinearSystem, first_order, input_columns
from tbm_dynamics.structure.system import System

DEFAULT_CUTOFF_HZ = 180.0

# The loads end near 210 Hz: a mode up to here and less damped than this is kept above the cut-off too.
_RESONANT_HZ, _RESONANT_RATIO = 250.0, 0.1

# With these the pinions strike as on every unknown: without, their peak acceleration is off by 10 % when teeth part.
_STRIKE_HZ = (300.0, 1000.0, 3000.0)

# Share of a mass below which a vector is rounding.
_NOTHING = 1e-20

# Coupling, over the geometric mean of the diagonal, below which two unknowns have nothing to do with each other.
_UNCOUPLED = 1e-12


@dataclass(frozen=True)
class Part:
    """One part of the motion in its basis, with the first-order system there.

    Attributes
    ----------
    shapes : (d, m) ndarray
        Motion of the part's unknowns per coordinate: all n of a common part, those of a drive in its own axes of the
        own part.
    project : (m, d) ndarray
        Coordinates from a motion.
    linear : LinearSystem
        With the inputs and couplings listed.
    inputs : (i,) ndarray of int
        Which of the 7 inputs act on it.
    couplings : (k,) ndarray of int
        Which couplings it holds. Common part: of 2c, meshes then gearboxes, each in the c shared patterns; own part:
        mesh and gearbox.
    """

    shapes: np.ndarray
    project: np.ndarray
    linear: LinearSystem
    inputs: np.ndarray
    couplings: np.ndarray


@dataclass(frozen=True)
class SplitBasis:
    """Common parts, which nothing couples, a drive's own part, and the patterns (p, c) that the drives share."""

    common: tuple[Part, ...]
    own: Part
    shared: np.ndarray


def split_basis(system: System, cutoff_hz: float = DEFAULT_CUTOFF_HZ) -> SplitBasis:
    """Split the motion of a system and reduce its parts."""
    shared = system.drives.shared
    rows = system.couplings.rows.reshape(2, len(shared), -1)
    expand = _common_unknowns(system, shared)
    patterns = np.einsum("ic,kin->kcn", shared, rows).reshape(-1, system.size) @ expand
    M, C, K = (expand.T @ matrix @ expand for matrix in (system.M, system.C, system.K))
    meshes = np.arange(2 * shared.shape[1]) < shared.shape[1]
    whole = _Problem(M, C, K, expand.T @ input_columns(system), patterns, meshes)
    common = [_reduced(whole.picked(unknowns), expand[:, unknowns], cutoff_hz) for unknowns in whole.components()]
    # What neither loads nor couplings act on never moves.
    common = [part for part in common if len(part.inputs) + len(part.couplings)]
    first, turn = system.drives.dofs[0], system.drives.turns[0]
    M, C, K = (turn @ matrix[np.ix_(first, first)] @ turn.T for matrix in (system.M, system.C, system.K))
    own = _Problem(M, C, K, np.zeros((len(first), INPUTS)), rows[:, 0, first] @ turn.T, np.array([True, False]))
    return SplitBasis(tuple(common), _reduced(own, np.eye(len(first)), cutoff_hz), shared)


@dataclass(frozen=True)
class _Problem:
    """Matrices (d, d), inputs (d, 7) and coupling rows (k, d) of some unknowns; which couplings are meshes."""

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    inputs: np.ndarray
    rows: np.ndarray
    meshes: np.ndarray

    def components(self) -> list[np.ndarray]:
        """Find sets of unknowns that nothing couples: axial, torsional and lateral motion as a rule."""
        linked = np.zeros((len(self.M), len(self.M)), dtype=bool)
        for matrix in (self.M, self.C, self.K):
            scale = np.sqrt(np.abs(matrix.diagonal()))
            linked |= np.abs(matrix) > _UNCOUPLED * np.outer(scale, scale)
        joined = self.rows.T != 0.0
        joined &= np.abs(self.rows.T) > _UNCOUPLED * np.abs(self.rows).max(axis=1)
        linked |= (joined.astype(float) @ joined.T.astype(float)) > 0.0
        count, labels = scipy.sparse.csgraph.connected_components(linked, directed=False)
        return [np.flatnonzero(labels == label) for label in range(count)]

    def picked(self, unknowns: np.ndarray) -> _Problem:
        """Pick the same for some of the unknowns."""
        square = np.ix_(unknowns, unknowns)
        M, C, K = (matrix[square] for matrix in (self.M, self.C, self.K))
        return _Problem(M, C, K, self.inputs[unknowns], self.rows[:, unknowns], self.meshes)


def _common_unknowns(system: System, shared: np.ndarray) -> np.ndarray:
    """Columns of the common part's unknowns, orthonormal, (n, n_c): the other nodes, then the drives' patterns."""
    drives = system.drives
    others = np.setdiff1d(np.arange(system.size), drives.dofs)
    expand = np.zeros((system.size, len(others) + drives.dofs.shape[1] * shared.shape[1]))
    expand[others, np.arange(len(others))] = 1.0
    for dofs, turn, weights in zip(drives.dofs, drives.turns, shared, strict=True):
        expand[dofs, len(others) :] = np.kron(weights, turn.T)
    return expand


def _reduced(problem: _Problem, expand: np.ndarray, cutoff_hz: float) -> Part:
    """Reduce some unknowns; `expand` (d, u) gives the motion of the part from them."""
    inputs = np.flatnonzero(np.any(problem.inputs != 0.0, axis=0))
    size = np.abs(problem.rows).max(axis=1)
    couplings = np.flatnonzero(size > _UNCOUPLED * size.max()) if size.max() > 0.0 else np.arange(0)
    rows, pushed = problem.rows[couplings], problem.inputs[:, inputs]
    meshes = rows[problem.meshes[couplings]].T
    forces = dict.fromkeys(_STRIKE_HZ, meshes)
    forces[0.0] = np.hstack([rows.T, pushed])
    forces[_STRIKE_HZ[0]] = np.hstack([meshes, pushed])
    modes = _modes(problem.M, problem.C, problem.K, cutoff_hz)
    shapes = _with_attachments(problem.M, problem.K, modes, forces)
    M, C, K = (shapes.T @ matrix @ shapes for matrix in (problem.M, problem.C, problem.K))
    linear = first_order(M, C, K, shapes.T @ pushed, rows @ shapes)
    # Mass-orthonormal shapes: the coordinates are the projections in the sense of the mass.
    return Part(expand @ shapes, shapes.T @ problem.M @ expand.T, linear, inputs, couplings)


def _modes(M: np.ndarray, C: np.ndarray, K: np.ndarray, cutoff_hz: float) -> np.ndarray:
    """Mass-normalised modes that are kept, (d, k)."""
    highest = (2.0 * np.pi * max(cutoff_hz, _RESONANT_HZ)) ** 2
    squares, modes = scipy.linalg.eigh(K, M, subset_by_value=(-np.inf, highest))
    omega = np.sqrt(np.maximum(squares, 0.0))
    ratio = np.einsum("ir,ij,jr->r", modes, C, modes) / (2.0 * np.maximum(omega, 1e-9))
    return np.asarray(modes[:, (omega < 2.0 * np.pi * cutoff_hz) | (ratio < _RESONANT_RATIO)])


def _with_attachments(
    M: np.ndarray, K: np.ndarray, modes: np.ndarray, forces: Mapping[float, np.ndarray]
) -> np.ndarray:
    """Modes and attachment modes (K + ω²M)⁻¹ of forces, by frequency (Hz), (d, m).

    Mass-orthonormal, and diagonal in the stiffness.
    """
    attachments = np.hstack(
        [
            scipy.linalg.solve(K + (2.0 * np.pi * frequency) ** 2 * M, columns, assume_a="pos")
            for frequency, columns in forces.items()
        ]
    )
    attachments = _normalised(M, attachments)
    # Twice: one pass of Gram-Schmidt leaves rounding of the large kept part behind.
    for _ in range(2):
        attachments = _normalised(M, attachments - modes @ (modes.T @ (M @ attachments)), least=_NOTHING)
    values, vectors = scipy.linalg.eigh(attachments.T @ M @ attachments)
    independent = values > 1e-9 * values.max(initial=0.0)
    residual = attachments @ (vectors[:, independent] / np.sqrt(values[independent]))
    basis = np.hstack([modes, residual])
    _, rotation = scipy.linalg.eigh(basis.T @ K @ basis, basis.T @ M @ basis)
    return np.asarray(basis @ rotation)


def _normalised(M: np.ndarray, vectors: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Give the columns unit mass; those that are rounding beside the largest, or of no more than `least`, are left out.

    What is left of a vector of unit mass without the kept modes may be all rounding: they hold it already.
    """
    masses = np.einsum("ij,ij->j", vectors, M @ vectors)
    lasting = masses > max(least, _NOTHING * masses.max(initial=0.0))
    return np.asarray(vectors[:, lasting] / np.sqrt(masses[lasting]))
