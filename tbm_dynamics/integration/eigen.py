"""The production method: the Lobatto quadrature of `lobatto`, carried out in the eigenvectors of the damped system.

Order 4 in the mesh excess g where it is smooth; stages at the start, the middle and the end of a step, g the quadratic
through them. In the eigenvectors of H the transfer over a step is diagonal and the response to g is known in closed
form for every eigenvalue: a step costs a few hundred operations for the states and thin products between states and
meshes, whatever the damping couples. The values of g in the middle and at the end are found by iteration among the
2 × 2p deflections and rates of the meshes alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numba import njit

from tbm_dynamics.integration.errors import SimulationError
from tbm_dynamics.integration.kernel import MeshLaws, mesh_condition, mesh_forces
from tbm_dynamics.integration.linear import INPUTS, LinearSystem

# Rounds over the middle and end values of g. A round shrinks the error by about (ω_mesh τ)²/2 of the change.
_ROUNDS = 3
# Beyond this the eigenvectors lose more digits than the indicators can spare.
_WORST_CONDITION = 1e9


@dataclass(frozen=True)
class Eigenbasis:
    """Real form of the eigenvectors of H: pairs (a, b) of states, complex conjugates or two real ones.

    Attributes
    ----------
    vectors : (s, s) ndarray
        v = vectors · (a, b), the a of all pairs first.
    values : (2, s/2) ndarray of complex
        Eigenvalue that each a and each b belongs to: λ and its conjugate, or two real ones.
    paired : (s/2,) ndarray of bool
        Whether the pair is a complex one.
    """

    vectors: np.ndarray
    values: np.ndarray
    paired: np.ndarray


def eigenbasis(H: np.ndarray) -> Eigenbasis:
    """Eigenvectors of H (s, s), s even, in pairs."""
    values, vectors = scipy.linalg.eig(H)
    upper = np.flatnonzero(values.imag > 0.0)
    real = np.flatnonzero(values.imag == 0.0)
    first, second = real[0::2], real[1::2]
    a = np.hstack([vectors[:, upper].real, vectors[:, first].real])
    b = np.hstack([-vectors[:, upper].imag, vectors[:, second].real])
    pairs = np.array(
        [np.concatenate([values[upper], values[first]]), np.concatenate([values[upper].conj(), values[second]])]
    )
    return Eigenbasis(np.hstack([a, b]), pairs, np.arange(pairs.shape[1]) < len(upper))


def scalar_responses(values: np.ndarray, step: float) -> np.ndarray:
    """exp(λτ) and the response over a step, and the same over half of it, for every eigenvalue λ, complex.

    Returns
    -------
    (2, 6, n) ndarray
        Half step, whole step; transfer, input linear over the whole step by its value now and at the end, g quadratic
        over the whole step by its value now, in the middle and at the end.
    """
    augmented = np.zeros((len(values), 4, 4), dtype=complex)
    augmented[:, 0, 0] = values
    augmented[:, [0, 1, 2], [1, 2, 3]] = 1.0
    found = []
    for part in (0.5 * step, step):
        transfer, p0, p1, p2 = scipy.linalg.expm(augmented * part)[:, 0].T
        p1, p2 = p1 / step, p2 / step**2
        found.append([transfer, p0 - p1, p1, p0 - 3.0 * p1 + 4.0 * p2, 4.0 * p1 - 8.0 * p2, -p1 + 4.0 * p2])
    return np.array(found)


def as_pairs(basis: Eigenbasis, factors: np.ndarray) -> np.ndarray:
    """Real 2×2 action of complex factors (2, m) of the eigenvalues on the pairs, rows (aa, ab, ba, bb), (4, m).

    λ acts on (a, b) of v = a·Re φ − b·Im φ as [[Re, −Im], [Im, Re]]; two real ones act on their own.
    """
    upper, lower = factors
    zero = np.zeros(len(basis.paired))
    imaginary = np.where(basis.paired, upper.imag, zero)
    second = np.where(basis.paired, upper.real, lower.real)
    return np.array([upper.real, -imaginary, imaginary, second])


class Eigen:
    """Integration method on eigenvectors, see `method.Method`; s states in s/2 pairs, p meshes.

    Raises
    ------
    SimulationError
        Eigenvectors that are nearly dependent.
    """

    def __init__(self, linear: LinearSystem, step: float) -> None:
        basis = eigenbasis(linear.H)
        condition = np.linalg.cond(basis.vectors / np.linalg.norm(basis.vectors, axis=0))
        if condition > _WORST_CONDITION:
            raise SimulationError(
                f"the eigenvectors of the damped system are nearly dependent (condition {condition:.1e}); "
                "change a damping ratio slightly, or use method 'full'"
            )
        inputs = np.linalg.solve(basis.vectors, linear.E)
        loads, meshes = inputs[:, :INPUTS], inputs[:, INPUTS:]
        upper, lower = (scalar_responses(values, step) for values in basis.values)
        half, whole = (
            [as_pairs(basis, np.array(pair)) for pair in zip(*parts, strict=True)]
            for parts in zip(upper, lower, strict=True)
        )
        observe = linear.observe @ basis.vectors
        self.states = len(linear.H)
        self.output = np.vstack([basis.vectors.T @ linear.output[: self.states], linear.output[self.states :]])
        self._vectors = basis.vectors
        self._state = np.zeros(self.states + meshes.shape[1])
        self._arrays = _Arrays(
            actions=np.array([whole[0], *whole[3:]]),
            load=_columns(np.hstack([act(action, loads) for action in whole[1:3]])),
            push=_columns(meshes),
            observe=np.ascontiguousarray(observe),
            observe_middle=np.ascontiguousarray(act(_transposed(half[0]), observe.T).T),
            load_middle=_columns(observe @ np.hstack([act(action, loads) for action in half[1:3]])),
            couple_now=_columns(observe @ act(half[3], meshes)),
            couple=_columns(
                np.block([[observe @ act(action, meshes) for action in part[4:]] for part in (half, whole)])
            ),
        )

    def begin(self, state: np.ndarray, excess: np.ndarray) -> None:
        """Stand at v with the meshes' excess g."""
        self._state = np.concatenate([np.linalg.solve(self._vectors, state), excess])

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
        return int(_advance(self._arrays, laws, inputs, phase, first, self._state, record, force))


class _Arrays(NamedTuple):
    """Constant arrays of a step.

    Attributes
    ----------
    actions : (4, 4, s/2) ndarray
        Actions on the pairs of exp(λτ), and of the pushes of g now, in the middle and at the end.
    load : (14, s) ndarray
        What u now and u at the end add to the states over the step.
    push : (p, s) ndarray
        g to the states.
    observe, observe_middle : (2p, s) ndarray
        Mesh deflections and rates at the end from the states there, in the middle from the states at the start.
    load_middle : (14, 2p) ndarray
        What u now and u at the end add to those in the middle.
    couple_now : (p, 2p) ndarray
        What g now adds to those in the middle.
    couple : (2p, 4p) ndarray
        What g in the middle and at the end add to those in the middle and at the end.
    """

    actions: np.ndarray
    load: np.ndarray
    push: np.ndarray
    observe: np.ndarray
    observe_middle: np.ndarray
    load_middle: np.ndarray
    couple_now: np.ndarray
    couple: np.ndarray


def _columns(matrix: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(matrix.T)


def _transposed(action: np.ndarray) -> np.ndarray:
    return action[[0, 2, 1, 3]]


def act(action: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Apply 2×2 actions (4, m) on pairs to columns of states (2m, c)."""
    a, b = np.split(states, 2)
    aa, ab, ba, bb = action[:, :, None]
    return np.vstack([aa * a + ab * b, ba * a + bb * b])


@njit(cache=True, error_model="numpy", fastmath={"contract"})  # type: ignore[untyped-decorator]
def _add(rows: np.ndarray, weights: np.ndarray, out: np.ndarray) -> None:
    """Add weights @ rows to out, several rows at a time: out is loaded and stored less often."""
    count, columns = rows.shape
    whole = count - count % 5
    for i in range(0, whole, 5):
        a, b, c, d, e = weights[i], weights[i + 1], weights[i + 2], weights[i + 3], weights[i + 4]
        for j in range(columns):
            first = a * rows[i, j] + b * rows[i + 1, j] + c * rows[i + 2, j]
            out[j] += first + (d * rows[i + 3, j] + e * rows[i + 4, j])
    for i in range(whole, count):
        weight = weights[i]
        for j in range(columns):
            out[j] += weight * rows[i, j]


# Dot products may be summed in vectors: their length is that of the state, so each is always summed in the same order.
@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})  # type: ignore[untyped-decorator]
def _products(matrix: np.ndarray, vector: np.ndarray, out: np.ndarray) -> None:
    """Write matrix @ vector to out; an even number of rows, two at a time."""
    for i in range(0, matrix.shape[0], 2):
        first = second = 0.0
        for j in range(matrix.shape[1]):
            first += matrix[i, j] * vector[j]
            second += matrix[i + 1, j] * vector[j]
        out[i] = first
        out[i + 1] = second


@njit(cache=True, error_model="numpy", fastmath={"contract"})  # type: ignore[untyped-decorator]
def _act(action: np.ndarray, states: np.ndarray, out: np.ndarray) -> None:
    """Add the 2×2 actions on pairs of states to out."""
    m = action.shape[1]
    a, b = states[:m], states[m:]
    upper, lower = out[:m], out[m:]
    for j in range(m):
        upper[j] += action[0, j] * a[j] + action[1, j] * b[j]
    for j in range(m):
        lower[j] += action[2, j] * a[j] + action[3, j] * b[j]


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _advance(
    arrays: _Arrays,
    laws: MeshLaws,
    inputs: np.ndarray,
    phase: np.ndarray,
    first: int,
    state: np.ndarray,
    record: np.ndarray,
    force: np.ndarray,
) -> int:
    """Compiled `Eigen.advance`; state (s + p,) holds the pairs and g, updated."""
    p, s = arrays.push.shape
    u = inputs.shape[1]
    pairs, moved = state[:s].copy(), np.empty(s)
    now, later, scratch = state[s:].copy(), np.empty(2 * p), np.empty(p)
    pushed_now, pushed_middle, pushed_end = np.zeros(s), np.empty(s), np.empty(s)
    _add(arrays.push, now, pushed_now)
    known = np.empty(2 * u)
    free, motion = np.empty(4 * p), np.empty(4 * p)
    middle, end = np.empty((4, p)), np.empty((4, p))
    for k in range(len(record)):
        mesh_condition(phase[0] + (first + k + 0.5) * phase[1], phase[2], laws, middle)
        mesh_condition(phase[0] + (first + k + 1.0) * phase[1], phase[2], laws, end)
        known[:u] = inputs[k]
        known[u:] = inputs[k + 1]
        _products(arrays.observe_middle, pairs, free[: 2 * p])
        _add(arrays.load_middle, known, free[: 2 * p])
        _add(arrays.couple_now, now, free[: 2 * p])
        moved[:] = 0.0
        _add(arrays.load, known, moved)
        _act(arrays.actions[0], pairs, moved)
        _act(arrays.actions[1], pushed_now, moved)
        _products(arrays.observe, moved, free[2 * p :])
        later[:p] = now
        later[p:] = now
        for _ in range(_ROUNDS):
            motion[:] = free
            _add(arrays.couple, later, motion)
            mesh_forces(motion[: 2 * p], middle, laws.constants, scratch, later[:p])
            mesh_forces(motion[2 * p :], end, laws.constants, force[k], later[p:])
        pushed_middle[:] = 0.0
        pushed_end[:] = 0.0
        _add(arrays.push, later[:p], pushed_middle)
        _add(arrays.push, later[p:], pushed_end)
        _act(arrays.actions[2], pushed_middle, moved)
        _act(arrays.actions[3], pushed_end, moved)
        pairs, moved = moved, pairs
        pushed_now, pushed_end = pushed_end, pushed_now
        now[:] = later[p:]
        record[k, :s] = pairs
        record[k, s : s + u] = inputs[k + 1]
        record[k, s + u :] = now
        if not math.isfinite(force[k, 0]) or not math.isfinite(pairs[0]):
            return k
    state[:s] = pairs
    state[s:] = now
    return len(record)
