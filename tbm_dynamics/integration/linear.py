"""The linear part in a basis, as first-order matrices that every method starts from.

State v = (p, ṗ) of the perturbation about the static equilibrium, q = q_s + V p:

    v̇ = H v + E_u u(t) + E_g g(t, v)

u: fluctuation of the six cutterhead loads and of the torque. g: what the meshes' forces are above their mean linear
part, F − F_s = k̄ B V p + c_m B V ṗ + g.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from tbm_dynamics.structure.system import System

INPUTS = 7
"""Six cutterhead loads and the motor torque."""


@dataclass(frozen=True)
class LinearSystem:
    """First-order matrices; s = 2m states, p meshes.

    Attributes
    ----------
    H : (s, s) ndarray
    E : (s, 7 + p) ndarray
        Inputs u, then g.
    observe : (2p, s) ndarray
        Mesh deflections and rates from the state.
    output : (s + 7 + p, o) ndarray
        From (v, u, g): the rows asked for of q − q_s, then of q̈.
    """

    H: np.ndarray
    E: np.ndarray
    observe: np.ndarray
    output: np.ndarray


def linear_system(system: System, basis: np.ndarray, output_dofs: np.ndarray) -> LinearSystem:
    """First-order matrices of a system in a basis (n, m), with outputs at some unknowns (o/2,)."""
    solve = scipy.linalg.cho_factor(basis.T @ system.M @ basis)
    rows = system.meshes.rows @ basis
    inputs = np.hstack([basis[system.load_dofs].T, (basis.T @ system.motor_pattern)[:, None]])
    pushes = scipy.linalg.cho_solve(solve, np.hstack([inputs, -rows.T]))
    stiffness = scipy.linalg.cho_solve(solve, basis.T @ system.K @ basis)
    damping = scipy.linalg.cho_solve(solve, basis.T @ system.C @ basis)
    p, m = rows.shape
    zero = np.zeros((m, m))
    selected = basis[output_dofs]
    silent = np.zeros((len(selected), m + INPUTS + p))
    return LinearSystem(
        H=np.block([[zero, np.eye(m)], [-stiffness, -damping]]),
        E=np.vstack([np.zeros((m, INPUTS + p)), pushes]),
        observe=np.block([[rows, np.zeros((p, m))], [np.zeros((p, m)), rows]]),
        output=np.block([[selected, silent], [selected @ np.hstack([-stiffness, -damping, pushes])]]).T,
    )
