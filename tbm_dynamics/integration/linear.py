"""The linear part in a basis, as first-order matrices.

State v = (p, ṗ) of the perturbation about the static equilibrium, q = q_s + V p:

    v̇ = H v + E_u u(t) + E_r r(t, v)

u: fluctuation of the six cutterhead loads and of the torque. r: the residual force, what the couplings' forces are
above their mean linear part, F − F_s = k̄ B V p + c B V ṗ + r.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from tbm_dynamics.structure.system import System

INPUTS = 7
"""Six cutterhead loads and the motor torque."""
ABOUT_X, MOTORS = 3, 6
"""Which of them is the moment about x, and which the motor torque."""


@dataclass(frozen=True)
class LinearSystem:
    """First-order matrices; s = 2m states, k couplings.

    Attributes
    ----------
    H : (s, s) ndarray
    E : (s, i + k) ndarray
        Inputs u, then r.
    observe : (2k, s) ndarray
        Deflections and rates of the couplings from the state.
    """

    H: np.ndarray
    E: np.ndarray
    observe: np.ndarray

    @property
    def acceleration(self) -> np.ndarray:
        """p̈ from (v, u, r), shape (m, s + i + k)."""
        m = len(self.H) // 2
        return np.hstack([self.H[m:], self.E[m:]])


def input_columns(system: System) -> np.ndarray:
    """Generalised forces of unit inputs u, shape (n, 7)."""
    columns = np.zeros((system.size, INPUTS))
    columns[system.load_dofs, np.arange(6)] = 1.0
    columns[:, MOTORS] = system.motor_pattern
    return columns


def first_order(M: np.ndarray, C: np.ndarray, K: np.ndarray, inputs: np.ndarray, rows: np.ndarray) -> LinearSystem:
    """First-order matrices of M, C, K (m, m) with inputs (m, i) and coupling rows (k, m)."""
    solve = scipy.linalg.cho_factor(M)
    pushes = scipy.linalg.cho_solve(solve, np.hstack([inputs, -rows.T]))
    stiffness, damping = scipy.linalg.cho_solve(solve, K), scipy.linalg.cho_solve(solve, C)
    k, m = rows.shape
    zero = np.zeros((m, m))
    return LinearSystem(
        H=np.block([[zero, np.eye(m)], [-stiffness, -damping]]),
        E=np.vstack([np.zeros_like(pushes), pushes]),
        observe=np.block([[rows, np.zeros((k, m))], [np.zeros((k, m)), rows]]),
    )
