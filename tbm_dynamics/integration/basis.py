"""The basis in which the motion is integrated: all unknowns, or selected modes with static correction."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from tbm_dynamics.structure.system import System

DEFAULT_CUTOFF_HZ = 250.0


def full_basis(system: System) -> np.ndarray:
    """Every unknown, shape (n, n)."""
    return np.eye(system.size)


def reduced_basis(system: System, cutoff_hz: float = DEFAULT_CUTOFF_HZ) -> np.ndarray:
    """Modes below a cut-off and the attachment modes of meshes, loads and motors, shape (n, m).

    The attachment modes K⁻¹·(mesh rows, load node, motors) keep every static answer exact, and with M, K and C
    reduced by the same basis a dropped mode still answers as K⁻¹/(1 + iωζ): its first-order lag is kept. The basis
    is mass-orthonormal and diagonalises the reduced stiffness.
    """
    frequencies, shapes = system.modes
    kept = shapes[:, frequencies < cutoff_hz]
    forces = np.zeros((system.size, system.meshes.count + 7))
    forces[:, : system.meshes.count] = system.meshes.rows.T
    forces[system.load_dofs, system.meshes.count + np.arange(6)] = 1.0
    forces[:, -1] = system.motor_pattern
    attachments = scipy.linalg.solve(system.K, forces, assume_a="pos")
    # Twice: one pass of Gram-Schmidt leaves rounding of the large kept part behind.
    for _ in range(2):
        attachments = attachments - kept @ (kept.T @ (system.M @ attachments))
    norms = np.sqrt(np.einsum("ij,ij->j", attachments, system.M @ attachments))
    attachments = attachments[:, norms > 0.0] / norms[norms > 0.0]
    values, vectors = np.linalg.eigh(attachments.T @ system.M @ attachments)
    independent = values > 1e-9 * values[-1]
    residual = attachments @ (vectors[:, independent] / np.sqrt(values[independent]))
    basis = np.hstack([kept, residual])
    _, rotation = scipy.linalg.eigh(basis.T @ system.K @ basis, basis.T @ system.M @ basis)
    return np.asarray(basis @ rotation)
