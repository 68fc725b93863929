"""The reference method: precise time integration with a Lobatto Runge–Kutta quadrature of the mesh excess.

Order 4 where the excess g is smooth; stages at the start, the middle and the end of a step. The linear part is exact by
one exponential (Zhong and Williams, J. Mech. Eng. Sci. 208, 1994); g is the quadratic through its three stages, whose
response is exact too. The values of g in the middle and at the end depend only on the mesh deflections and rates there,
2 × count scalars, and are found by iteration among them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tbm_dynamics.integration.kernel import MeshLaws, mesh_condition, mesh_forces
from tbm_dynamics.integration.linear import INPUTS, LinearSystem
from tbm_dynamics.integration.precise import polynomial_response

# Rounds over the middle and end values of g. A round shrinks the error by about (ω_mesh τ)²/2 of the change.
_ROUNDS = 3


class Lobatto:
    """Integration method on dense transfer matrices, see `method.Method`; s states, p meshes.

    Attributes
    ----------
    free : (s + 2·7 + p, s + 4p) ndarray
        Rows are the known quantities (v, u now, u next, g now); columns the state at the end and the mesh
        deflections and rates in the middle (2p) and at the end (2p), all before the unknown g is added.
    from_middle, from_end : (p, s + 4p) ndarray
        What g in the middle and at the end adds to the same columns.
    """

    def __init__(self, linear: LinearSystem, step: float) -> None:
        s, p = len(linear.H), linear.E.shape[1] - INPUTS
        half, whole = polynomial_response(linear.H, linear.E, step)
        blocks = [_by_inputs(response, s, p, step) for response in (half, whole)]
        columns = np.vstack([blocks[1], linear.observe @ blocks[0], linear.observe @ blocks[1]])
        known = s + 2 * INPUTS + p
        self.states = s
        self.output = np.ascontiguousarray(linear.output)
        self.free = np.ascontiguousarray(columns[:, :known].T)
        self.from_middle = np.ascontiguousarray(columns[:, known : known + p].T)
        self.from_end = np.ascontiguousarray(columns[:, known + p :].T)
        self._couple = [np.ascontiguousarray(matrix[:, s:]) for matrix in (self.from_middle, self.from_end)]
        self._state = np.zeros(s + p)

    def begin(self, state: np.ndarray, excess: np.ndarray) -> None:
        """Stand at v with the meshes' excess g."""
        self._state = np.concatenate([state, excess])

    def start_row(self, inputs: np.ndarray) -> np.ndarray:
        """Row of the record where the state stands."""
        return np.concatenate([self._state[: self.states], inputs, self._state[self.states :]])

    def advance(
        self,
        laws: MeshLaws,
        inputs: np.ndarray,
        phase: np.ndarray,
        first: int,
        record: np.ndarray,
        force: np.ndarray,
    ) -> int:
        """Advance by n steps; see `method.Method`."""
        return int(
            _advance(
                self.free,
                self.from_middle,
                self.from_end,
                self._couple[0],
                self._couple[1],
                laws,
                inputs,
                phase,
                first,
                self._state,
                record,
                force,
            )
        )


def _by_inputs(response: np.ndarray, s: int, p: int, step: float) -> np.ndarray:
    """From polynomial coefficients to values: columns (v, u now, u next, g now, g middle, g end)."""
    T, P0, P1, P2 = np.split(response, [s, s + INPUTS + p, s + 2 * (INPUTS + p)], axis=1)
    u0, u1 = P0[:, :INPUTS], P1[:, :INPUTS] / step
    g0, g1, g2 = P0[:, INPUTS:], P1[:, INPUTS:] / step, P2[:, INPUTS:] / step**2
    now = g0 - 3.0 * g1 + 4.0 * g2
    return np.hstack([T, u0 - u1, u1, now, 4.0 * g1 - 8.0 * g2, -g1 + 4.0 * g2])


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _add_product(matrix: np.ndarray, known: np.ndarray, result: np.ndarray) -> None:
    """Add known @ matrix to result."""
    for j in range(matrix.shape[0]):
        weight = known[j]
        for i in range(matrix.shape[1]):
            result[i] += matrix[j, i] * weight


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _advance(
    free: np.ndarray,
    from_middle: np.ndarray,
    from_end: np.ndarray,
    couple_middle: np.ndarray,
    couple_end: np.ndarray,
    laws: MeshLaws,
    inputs: np.ndarray,
    phase: np.ndarray,
    first: int,
    state: np.ndarray,
    record: np.ndarray,
    force: np.ndarray,
) -> int:
    """Compiled `Lobatto.advance`; couple_… are the mesh columns of from_…, state (s + p,) is v and g, updated."""
    p = laws.shifts.shape[1]
    s = len(state) - p
    u = inputs.shape[1]
    known, result, motion = np.empty(s + 2 * u + p), np.empty(s + 4 * p), np.empty(4 * p)
    middle, end = np.empty((4, p)), np.empty((4, p))
    g_middle, g_end, scratch = np.empty(p), np.empty(p), np.empty(p)
    known[:s] = state[:s]
    known[s + 2 * u :] = state[s:]
    for k in range(len(record)):
        known[s : s + u] = inputs[k]
        known[s + u : s + 2 * u] = inputs[k + 1]
        mesh_condition(phase[0] + (first + k + 0.5) * phase[1], phase[2], laws, middle)
        mesh_condition(phase[0] + (first + k + 1.0) * phase[1], phase[2], laws, end)
        result[:] = 0.0
        _add_product(free, known, result)
        g_middle[:] = known[s + 2 * u :]
        g_end[:] = g_middle
        for _ in range(_ROUNDS):
            motion[:] = result[s:]
            _add_product(couple_middle, g_middle, motion)
            _add_product(couple_end, g_end, motion)
            mesh_forces(motion[: 2 * p], middle, laws.constants, scratch, g_middle)
            mesh_forces(motion[2 * p :], end, laws.constants, force[k], g_end)
        _add_product(from_middle, g_middle, result)
        _add_product(from_end, g_end, result)
        mesh_forces(result[s + 2 * p :], end, laws.constants, force[k], g_end)
        known[:s] = result[:s]
        known[s + 2 * u :] = g_end
        record[k, :s] = result[:s]
        record[k, s : s + u] = inputs[k + 1]
        record[k, s + u :] = g_end
        if not math.isfinite(force[k, 0]) or not math.isfinite(result[0]):
            return k
    state[:s] = known[:s]
    state[s:] = known[s + 2 * u :]
    return len(record)
