"""Rigid arms and spring-dampers."""

from __future__ import annotations

import numpy as np


def rigid_arm(offset: np.ndarray) -> np.ndarray:
    """Motion of a point at `offset` (3,) m from its node: u + θ × r, shape (6, 6)."""
    x, y, z = offset
    arm = np.eye(6)
    arm[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return arm


def spring_rows(place: np.ndarray, first: np.ndarray, second: np.ndarray | None) -> np.ndarray:
    """Relative motion at `place` of the first node against the second (or the ground), shape (6, 6) or (6, 12).

    Arms on both sides keep every rigid-body motion free of strain wherever the nodes are.
    """
    rows = rigid_arm(place - first)
    return rows if second is None else np.hstack([rows, -rigid_arm(place - second)])


def spring_stiffness(rows: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Element stiffness rowsᵀ k rows of six stiffnesses (6,) or a matrix of them (6, 6), N/m and N·m/rad."""
    return np.asarray(rows.T @ ((stiffness[:, None] * rows) if stiffness.ndim == 1 else stiffness @ rows))
