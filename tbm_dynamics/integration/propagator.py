"""Everything the kernel needs for one step, as constant matrices.

State v = (p, ṗ) of the perturbation about the static equilibrium, q = q_s + V p:

    v̇ = H v + E_u u(t) + E_g g(t, v)

u: fluctuation of the six cutterhead loads and of the torque, linear over a step. g: what the meshes' forces are above
their mean linear part, F − F_s = k̄ B V p + c_m B V ṗ + g, quadratic through the start, middle and end of a step. Both
are integrated exactly over the step; the values of g in the middle and at the end (a Lobatto Runge–Kutta quadrature
of r(t, v)) depend only on the mesh deflections and rates there, 2 × count scalars.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from tbm_dynamics.integration.precise import polynomial_response
from tbm_dynamics.structure.system import System

INPUTS = 7
"""Six cutterhead loads and the motor torque."""


@dataclass(frozen=True)
class Propagator:
    """Constant matrices of a step; s states, p meshes, all C-contiguous.

    Attributes
    ----------
    free : (s + 2·7 + p, s + 4p) ndarray
        Rows are the known quantities (v, u now, u next, g now); columns the state at the end and the mesh
        deflections and rates in the middle (2p) and at the end (2p), all before the unknown g is added.
    from_middle, from_end : (p, s + 4p) ndarray
        What g in the middle and at the end adds to the same columns.
    output : (s + 7 + p, o) ndarray
        Outputs from (v, u, g): the rows asked for of q − q_s, then of q̈.
    """

    free: np.ndarray
    from_middle: np.ndarray
    from_end: np.ndarray
    output: np.ndarray
    states: int
    meshes: int


def build_propagator(system: System, basis: np.ndarray, step: float, output_dofs: np.ndarray) -> Propagator:
    """Matrices of one step in a basis (n, m), with outputs at some unknowns (o/2,)."""
    mass = basis.T @ system.M @ basis
    solve = scipy.linalg.cho_factor(mass)
    rows = system.meshes.rows @ basis
    inputs = np.hstack([basis[system.load_dofs].T, (basis.T @ system.motor_pattern)[:, None]])
    pushes = scipy.linalg.cho_solve(solve, np.hstack([inputs, -rows.T]))
    stiffness = scipy.linalg.cho_solve(solve, basis.T @ system.K @ basis)
    damping = scipy.linalg.cho_solve(solve, basis.T @ system.C @ basis)
    m, p = len(mass), len(rows)
    zero = np.zeros((m, m))
    H = np.block([[zero, np.eye(m)], [-stiffness, -damping]])
    E = np.vstack([np.zeros((m, INPUTS + p)), pushes])
    half, whole = polynomial_response(H, E, step)
    observe = np.block([[rows, np.zeros((p, m))], [np.zeros((p, m)), rows]])
    blocks = [_by_inputs(response, 2 * m, p, step) for response in (half, whole)]
    columns = np.vstack([blocks[1], observe @ blocks[0], observe @ blocks[1]])
    known = 2 * m + 2 * INPUTS + p
    selected = basis[output_dofs]
    output = np.block(
        [
            [selected, np.zeros((len(selected), m + INPUTS + p))],
            [selected @ np.hstack([-stiffness, -damping, pushes])],
        ]
    )
    return Propagator(
        free=np.ascontiguousarray(columns[:, :known].T),
        from_middle=np.ascontiguousarray(columns[:, known : known + p].T),
        from_end=np.ascontiguousarray(columns[:, known + p :].T),
        output=np.ascontiguousarray(output.T),
        states=2 * m,
        meshes=p,
    )


def _by_inputs(response: np.ndarray, s: int, p: int, step: float) -> np.ndarray:
    """From polynomial coefficients to values: columns (v, u now, u next, g now, g middle, g end)."""
    T, P0, P1, P2 = np.split(response, [s, s + INPUTS + p, s + 2 * (INPUTS + p)], axis=1)
    u0, u1 = P0[:, :INPUTS], P1[:, :INPUTS] / step
    g0, g1, g2 = P0[:, INPUTS:], P1[:, INPUTS:] / step, P2[:, INPUTS:] / step**2
    now = g0 - 3.0 * g1 + 4.0 * g2
    return np.hstack([T, u0 - u1, u1, now, 4.0 * g1 - 8.0 * g2, -g1 + 4.0 * g2])
