"""The reference method: precise time integration with a Lobatto Runge–Kutta quadrature of the couplings' excess.

Every unknown of the system. Order 4 where the excess g is smooth; stages at the start, the middle and the end of a
step. The linear part is exact by one exponential (Zhong and Williams, J. Mech. Eng. Sci. 208, 1994); g is the quadratic
through its three stages, whose response is exact too. The values of g in the middle and at the end depend only on the
deflections and rates of the couplings there, and are found by iteration among them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tbm_dynamics.integration.iteration import refuse_coarse
from tbm_dynamics.integration.laws import Laws, forces, widened
from tbm_dynamics.integration.linear import INPUTS, LinearSystem, first_order, input_columns
from tbm_dynamics.integration.precise import polynomial_response
from tbm_dynamics.structure.system import System

# Rounds over the middle and end values of g. A round shrinks the error by about (ω_mesh τ)²/2 of the change.
_ROUNDS = 3


class Lobatto:
    """Integration method on dense transfer matrices, see `method.Method`; s = 2n states, k = 2L couplings.

    Columns of its arrays: the state at the end, then deflections (k) and rates (k) in the middle and at the end.
    """

    stages = (0.5, 1.0)
    tail = INPUTS

    def __init__(self, system: System, output_dofs: np.ndarray, step: float) -> None:
        rows = widened(system.couplings.rows.T, system.couplings.drives).T
        linear = first_order(system.M, system.C, system.K, input_columns(system), rows)
        s, k = len(linear.H), len(rows)
        from_state, forced, now, middle, end = _columns(linear, step)
        self.states = s
        self.forced = np.vstack([forced[INPUTS:], forced[:INPUTS]])
        self._free = np.vstack([from_state, now])
        self._middle, self._end = middle, end
        self._couple = (np.ascontiguousarray(middle[:, s:]), np.ascontiguousarray(end[:, s:]))
        gain = _mesh_gain(system, middle, end)
        refuse_coarse(lambda shorter: _mesh_gain(system, *_columns(linear, shorter)[3:]), step, gain)
        n = system.size
        acceleration = linear.acceleration[output_dofs].T
        displacement = np.zeros((s + INPUTS + k, len(output_dofs)))
        displacement[output_dofs, np.arange(len(output_dofs))] = 1.0
        order = np.r_[0:s, s + INPUTS : s + INPUTS + k, s : s + INPUTS]
        self.output = np.ascontiguousarray(np.hstack([displacement, acceleration])[order])
        self._state = np.zeros(2 * n + k)

    def begin(self, displacement: np.ndarray, velocity: np.ndarray, excess: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Stand at a displacement and velocity with the couplings' excess."""
        del held  # nothing is held over from step to step
        self._state = np.concatenate([displacement, velocity, excess[1]])
        return self._state

    def advance(
        self,
        laws: Laws,
        held: np.ndarray,
        inputs: np.ndarray,
        forced: np.ndarray,
        record: np.ndarray,
        force: np.ndarray,
    ) -> int:
        """Advance by n steps; see `method.Method`."""
        del inputs  # `forced` holds all of their effect
        arrays = (self._free, self._middle, self._end, *self._couple)
        return int(_advance(*arrays, laws, held, forced, self._state, record, force))


def _columns(linear: LinearSystem, step: float) -> list[np.ndarray]:
    """Compute what the state, u, and g now, in the middle and at the end add to the columns of the class, by row."""
    s, k = len(linear.H), len(linear.observe) // 2
    half, whole = polynomial_response(linear.H, linear.E, step)
    blocks = [_by_inputs(response, s, k, step) for response in (half, whole)]
    columns = np.vstack([blocks[1], linear.observe @ blocks[0], linear.observe @ blocks[1]])
    pieces = np.split(columns, np.cumsum([s, 2 * INPUTS, k, k]), axis=1)
    return [np.ascontiguousarray(piece.T) for piece in pieces]


def _mesh_gain(system: System, middle: np.ndarray, end: np.ndarray) -> np.ndarray:
    """How the excess of open meshes, in the middle and at the end of a step, comes back on itself, (2p, 2p)."""
    p, s = system.couplings.drives, 2 * system.size
    stiffness, damping, k = system.couplings.stiffness[0], system.couplings.damping[0], len(middle)
    blocks = [
        [stiffness * pushed[:p, at : at + p] + damping * pushed[:p, at + k : at + k + p] for at in (s, s + 2 * k)]
        for pushed in (middle, end)
    ]
    return np.block(blocks)


def _by_inputs(response: np.ndarray, s: int, k: int, step: float) -> np.ndarray:
    """From polynomial coefficients to values: columns (v, u now, u next, g now, g middle, g end)."""
    T, P0, P1, P2 = np.split(response, [s, s + INPUTS + k, s + 2 * (INPUTS + k)], axis=1)
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
    laws: Laws,
    held: np.ndarray,
    forced: np.ndarray,
    state: np.ndarray,
    record: np.ndarray,
    force: np.ndarray,
) -> int:
    """Compiled `Lobatto.advance`; couple_… are the coupling columns of from_…, state (s + k,) is v and g, updated."""
    k = force.shape[1]
    s = len(state) - k
    known, result, motion = state.copy(), np.empty(s + 4 * k), np.empty(4 * k)
    stages = motion.reshape(2, 2, k)
    g_middle, g_end, scratch = np.empty(k), np.empty(k), np.empty(k)
    for n in range(len(record)):
        result[:] = forced[n]
        _add_product(free, known, result)
        g_middle[:] = known[s:]
        g_end[:] = known[s:]
        for _ in range(_ROUNDS):
            motion[:] = result[s:]
            _add_product(couple_middle, g_middle, motion)
            _add_product(couple_end, g_end, motion)
            forces(stages[0], held, 2 * n, laws, scratch, g_middle)
            forces(stages[1], held, 2 * n + 1, laws, force[n], g_end)
        _add_product(from_middle, g_middle, result)
        _add_product(from_end, g_end, result)
        known[:s] = result[:s]
        known[s:] = g_end
        record[n, : s + k] = known
        if not math.isfinite(force[n, 0]) or not math.isfinite(result[0]):
            return n
    state[:] = known
    return len(record)
