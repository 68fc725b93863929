"""The reference method: precise time integration with a Lobatto Runge–Kutta quadrature of the residual force.

Every unknown of the system. Order 4 where the residual force r of the couplings is smooth; stages at the start, the
middle and the end of a step. The linear part is exact by one exponential (Zhong and Williams, J. Mech. Eng. Sci. 208,
1994); r is the quadratic through its three stages, whose response is exact too. The values of r in the middle and at
the end depend only on the deflections and rates of the couplings there, and are found by iteration among them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tbm_dynamics.integration.lanes import widened
from tbm_dynamics.integration.laws import CouplingLaws, coupling_forces
from tbm_dynamics.integration.linear import INPUTS, LinearSystem, first_order, input_columns
from tbm_dynamics.integration.method import Method, Steps, refuse_coarse
from tbm_dynamics.integration.precise import polynomial_response
from tbm_dynamics.integration.start import Start
from tbm_dynamics.structure.system import System

# Rounds over the middle and end values of r. A round shrinks the error by about (ω_mesh τ)²/2 of the change.
_ROUNDS = 3


class Lobatto(Method[np.ndarray]):
    """Integration method on dense transfer matrices, see `method.Method`; s = 2n states, k = 2L couplings.

    The state of a run is v (s) and r now (k). Columns of the arrays: the state at the end, then deflections (k) and
    rates (k) in the middle and at the end.
    """

    stages = (0.5, 1.0)
    tail = INPUTS

    def __init__(self, system: System, output_dofs: np.ndarray, step: float) -> None:
        rows = widened(system.couplings.rows.T, system.couplings.drives).T
        linear = first_order(system.M, system.C, system.K, input_columns(system), rows)
        s, k = len(linear.H), len(rows)
        from_state, forced, now, middle, end = _columns(linear, step)
        self.states = s
        self.linear = np.array([system.couplings.stiffness, system.couplings.damping])
        self.forced = np.vstack([forced[INPUTS:], forced[:INPUTS]])
        self._predict = np.vstack([from_state, now])
        self._middle, self._end = middle, end
        self._couple = (np.ascontiguousarray(middle[:, s:]), np.ascontiguousarray(end[:, s:]))
        columns = {step: (middle, end)}
        refuse_coarse(lambda tried: _mesh_gain(system, *(columns.get(tried) or _columns(linear, tried)[3:])), step)
        acceleration = linear.acceleration[output_dofs].T
        displacement = np.zeros((s + INPUTS + k, len(output_dofs)))
        displacement[output_dofs, np.arange(len(output_dofs))] = 1.0
        order = np.r_[0:s, s + INPUTS : s + INPUTS + k, s : s + INPUTS]
        self.output = np.ascontiguousarray(np.hstack([displacement, acceleration])[order])

    def start(self, start: Start) -> tuple[np.ndarray, np.ndarray]:
        """State and row of the record at the start of a run; see `method.Method`."""
        state = np.concatenate([start.displacement, start.velocity, start.residual[1]])
        return state, state

    def advance(self, laws: CouplingLaws, steps: Steps, state: np.ndarray) -> int:
        """Advance by n steps; see `method.Method`."""
        return int(_advance(self._predict, self._middle, self._end, *self._couple, laws, steps, state))


def _columns(linear: LinearSystem, step: float) -> list[np.ndarray]:
    """Return what the state, u, and r now, in the middle and at the end add to the columns, by row."""
    s, k = len(linear.H), len(linear.observe) // 2
    half, whole = polynomial_response(linear.H, linear.E, step)
    blocks = [_by_inputs(response, s, k, step) for response in (half, whole)]
    columns = np.vstack([blocks[1], linear.observe @ blocks[0], linear.observe @ blocks[1]])
    pieces = np.split(columns, np.cumsum([s, 2 * INPUTS, k, k]), axis=1)
    return [np.ascontiguousarray(piece.T) for piece in pieces]


def _mesh_gain(system: System, middle: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return what the residual of open meshes in the middle and at the end of a step adds to itself, (2p, 2p)."""
    p, s = system.couplings.drives, 2 * system.size
    k = len(middle)
    stiffness, damping = system.couplings.stiffness[:p], system.couplings.damping[:p]
    blocks = [
        [stiffness * pushed[:p, at : at + p] + damping * pushed[:p, at + k : at + k + p] for at in (s, s + 2 * k)]
        for pushed in (middle, end)
    ]
    return np.block(blocks)


def _by_inputs(response: np.ndarray, s: int, k: int, step: float) -> np.ndarray:
    """From polynomial coefficients to values: columns (v, u now, u next, r now, r middle, r end)."""
    T, P0, P1, P2 = np.split(response, [s, s + INPUTS + k, s + 2 * (INPUTS + k)], axis=1)
    u0, u1 = P0[:, :INPUTS], P1[:, :INPUTS] / step
    r0, r1, r2 = P0[:, INPUTS:], P1[:, INPUTS:] / step, P2[:, INPUTS:] / step**2
    now = r0 - 3.0 * r1 + 4.0 * r2
    return np.hstack([T, u0 - u1, u1, now, 4.0 * r1 - 8.0 * r2, -r1 + 4.0 * r2])


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _add_product(matrix: np.ndarray, known: np.ndarray, result: np.ndarray) -> None:
    """Add known @ matrix to result."""
    for j in range(matrix.shape[0]):
        weight = known[j]
        for i in range(matrix.shape[1]):
            result[i] += matrix[j, i] * weight


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _advance(
    predict: np.ndarray,
    from_middle: np.ndarray,
    from_end: np.ndarray,
    couple_middle: np.ndarray,
    couple_end: np.ndarray,
    laws: CouplingLaws,
    steps: Steps,
    state: np.ndarray,
) -> int:
    """Compiled `Lobatto.advance`; the `couple` arrays are the coupling columns of the `from` ones."""
    k = steps.force.shape[1]
    s = len(state) - k
    result, motion = np.empty(s + 4 * k), np.empty(4 * k)
    stages = motion.reshape(2, 2, k)
    r_middle, r_end, scratch = np.empty(k), np.empty(k), np.empty(k)
    for n in range(len(steps.record)):
        result[:] = steps.forced[n]
        _add_product(predict, state, result)
        r_middle[:] = state[s:]
        r_end[:] = state[s:]
        for _ in range(_ROUNDS):
            motion[:] = result[s:]
            _add_product(couple_middle, r_middle, motion)
            _add_product(couple_end, r_end, motion)
            coupling_forces(stages[0], steps.mesh_inputs, 2 * n, laws, scratch, r_middle)
            coupling_forces(stages[1], steps.mesh_inputs, 2 * n + 1, laws, steps.force[n], r_end)
        _add_product(from_middle, r_middle, result)
        _add_product(from_end, r_end, result)
        state[:s] = result[:s]
        state[s:] = r_end
        steps.record[n, : s + k] = state
        if not math.isfinite(steps.force[n, 0]) or not math.isfinite(result[0]):
            return n
    return len(steps.record)
