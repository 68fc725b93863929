"""The basis in which the motion is integrated: all unknowns, or selected modes with static correction."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from tbm_dynamics.structure.system import System

DEFAULT_CUTOFF_HZ = 230.0

# With these the pinions strike as on every unknown: without, their peak acceleration is off by 10 % when teeth part.
_STRIKE_HZ = (300.0, 1000.0, 3000.0)

# Share of the largest mass below which a vector is rounding.
_NOTHING = 1e-20


def full_basis(system: System) -> np.ndarray:
    """Every unknown, shape (n, n)."""
    return np.eye(system.size)


def reduced_basis(system: System, cutoff_hz: float = DEFAULT_CUTOFF_HZ) -> np.ndarray:
    """Modes below a cut-off and attachment modes, shape (n, m).

    The attachment modes K⁻¹·(mesh rows, load node, motors) keep every static answer exact, and with M, K and C
    reduced by the same basis a dropped mode still answers as K⁻¹/(1 + iωζ): its first-order lag is kept. Those of the
    meshes at (K + ω²M)⁻¹ let a pinion move by itself when its teeth strike: the faster the blow, the less of the drive
    follows. The basis is mass-orthonormal and diagonalises the reduced stiffness.
    """
    frequencies, shapes = system.modes
    kept = shapes[:, frequencies < cutoff_hz]
    attachments = _attachments(system)
    # Twice: one pass of Gram-Schmidt leaves rounding of the large kept part behind.
    for _ in range(2):
        attachments = _normalised(system, attachments)
        attachments = attachments - kept @ (kept.T @ (system.M @ attachments))
    attachments = _normalised(system, attachments)
    values, vectors = scipy.linalg.eigh(attachments.T @ system.M @ attachments)
    independent = values > 1e-9 * values[-1]
    residual = attachments @ (vectors[:, independent] / np.sqrt(values[independent]))
    basis = np.hstack([kept, residual])
    _, rotation = scipy.linalg.eigh(basis.T @ system.K @ basis, basis.T @ system.M @ basis)
    return np.asarray(basis @ rotation)


def _normalised(system: System, vectors: np.ndarray) -> np.ndarray:
    """Give the columns unit mass; those that the kept modes hold already, but for rounding, are left out."""
    masses = np.einsum("ij,ij->j", vectors, system.M @ vectors)
    lasting = masses > _NOTHING * masses.max()
    return np.asarray(vectors[:, lasting] / np.sqrt(masses[lasting]))


def _attachments(system: System) -> np.ndarray:
    """Deflections under unit forces at meshes, load node and motors, static and, of the meshes, fast, (n, 4p + 7)."""
    meshes = system.meshes.rows.T
    forces = np.zeros((system.size, 7))
    forces[system.load_dofs, np.arange(6)] = 1.0
    forces[:, 6] = system.motor_pattern
    found = [scipy.linalg.solve(system.K, np.hstack([meshes, forces]), assume_a="pos")]
    for frequency in _STRIKE_HZ:
        fast = system.K + (2.0 * np.pi * frequency) ** 2 * system.M
        found.append(scipy.linalg.solve(fast, meshes, assume_a="pos"))
    return np.hstack(found)
