"""The compiled step: one matrix–vector product, then the meshes among themselves.

No reduction is reordered (no fast-math), so a step gives the same bits in whatever chunk it falls.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

# Rounds over the middle and end values of g. A round shrinks the error by about (ω_mesh τ)²/2 of the change.
_ROUNDS = 3


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def mesh_condition(
    cycle: float, table: np.ndarray, shifts: np.ndarray, errors: np.ndarray, rate: float, out: np.ndarray
) -> None:
    """Stiffness, error and error rate of every mesh at a mesh phase.

    Parameters
    ----------
    cycle : float
        Mesh phase (cycles).
    table : (n,) ndarray
        Stiffness over a cycle.
    shifts : (p, 5) ndarray
        Mesh phase γ, cos and sin of 2πγ, cos and sin of the shaft phase.
    errors : (3,) ndarray
        Error amplitudes at mesh and at shaft frequency (m), shaft turns per mesh cycle.
    rate : float
        Mesh frequency (Hz).
    out : (p, 3) ndarray
        k (N/m), e (m), ė (m/s).
    """
    tooth, shaft, turns = errors
    angle = 2.0 * math.pi * (cycle - math.floor(cycle))
    sine, cosine = math.sin(angle), math.cos(angle)
    turned = cycle * turns
    shaft_angle = 2.0 * math.pi * (turned - math.floor(turned))
    shaft_sine, shaft_cosine = math.sin(shaft_angle), math.cos(shaft_angle)
    size = len(table)
    for i in range(len(shifts)):
        phase = cycle - shifts[i, 0]
        position = (phase - math.floor(phase)) * size
        j = int(position)
        part = position - j
        j = j % size
        out[i, 0] = table[j] + part * (table[(j + 1) % size] - table[j])
        s1 = sine * shifts[i, 1] - cosine * shifts[i, 2]
        c1 = cosine * shifts[i, 1] + sine * shifts[i, 2]
        s2 = shaft_sine * shifts[i, 3] + shaft_cosine * shifts[i, 4]
        c2 = shaft_cosine * shifts[i, 3] - shaft_sine * shifts[i, 4]
        out[i, 1] = tooth * s1 + shaft * s2
        out[i, 2] = 2.0 * math.pi * rate * (tooth * c1 + shaft * turns * c2)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def mesh_forces(
    motion: np.ndarray,
    condition: np.ndarray,
    statics: np.ndarray,
    laws: np.ndarray,
    force: np.ndarray,
    excess: np.ndarray,
) -> None:
    """Compute the forces of every mesh and their excess g over the mean linear part.

    Parameters
    ----------
    motion : (2p,) ndarray
        Deflections and rates about the equilibrium.
    condition : (p, 3) ndarray
        From `mesh_condition`.
    statics : (p, 2) ndarray
        Deflection (m) and force (N) at equilibrium.
    laws : (3,) ndarray
        k̄ (N/m), c_m (N·s/m), half gap (m).
    force, excess : (p,) ndarray
        Written: F and g (N).
    """
    mean, damping, gap = laws
    p = len(condition)
    for i in range(p):
        deflection = statics[i, 0] + motion[i] + condition[i, 1]
        rate = motion[p + i] + condition[i, 2]
        total = 0.0
        if deflection > gap:
            total = condition[i, 0] * (deflection - gap) + damping * rate
        elif deflection < -gap:
            total = condition[i, 0] * (deflection + gap) + damping * rate
        force[i] = total
        excess[i] = total - statics[i, 1] - mean * motion[i] - damping * motion[p + i]


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _add_product(matrix: np.ndarray, known: np.ndarray, result: np.ndarray) -> None:
    """Add known @ matrix to result, four rows at a time so that the result stays in registers longer."""
    rows, columns = matrix.shape
    whole = rows - rows % 4
    for j in range(0, whole, 4):
        a, b, c, d = known[j], known[j + 1], known[j + 2], known[j + 3]
        for i in range(columns):
            result[i] += (matrix[j, i] * a + matrix[j + 1, i] * b) + (matrix[j + 2, i] * c + matrix[j + 3, i] * d)
    for j in range(whole, rows):
        for i in range(columns):
            result[i] += matrix[j, i] * known[j]


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def advance(
    free: np.ndarray,
    from_middle: np.ndarray,
    from_end: np.ndarray,
    couple_middle: np.ndarray,
    couple_end: np.ndarray,
    table: np.ndarray,
    shifts: np.ndarray,
    errors: np.ndarray,
    statics: np.ndarray,
    laws: np.ndarray,
    inputs: np.ndarray,
    phase: np.ndarray,
    first: int,
    state: np.ndarray,
    record: np.ndarray,
    force: np.ndarray,
) -> int:
    """Advance by len(record) steps.

    Parameters
    ----------
    inputs : (n + 1, 7) ndarray
        u at the step where the state stands and at the n steps after it.
    couple_middle, couple_end : (p, 4p) ndarray
        The columns of `from_middle` and `from_end` that belong to the meshes, contiguous.
    phase : (3,) ndarray
        Mesh phase at a reference step (cycles), cycles per step, mesh frequency (Hz).
    first : int
        Steps from the reference step to where the state stands.
    state : (s + p,) ndarray
        v and g where the run stands; updated.
    record : (n, s + 7 + p) ndarray
        Written: v, u and g after each step.
    force : (n, p) ndarray
        Written: mesh forces after each step (N).

    Returns
    -------
    int
        Number of steps done; fewer than n if the motion is no longer finite.
    """
    p = len(shifts)
    s = len(state) - p
    n_inputs = inputs.shape[1]
    known = np.empty(s + 2 * n_inputs + p)
    result = np.empty(s + 4 * p)
    motion = np.empty(4 * p)
    middle, end = np.empty((p, 3)), np.empty((p, 3))
    g_middle, g_end, scratch = np.empty(p), np.empty(p), np.empty(p)
    known[:s] = state[:s]
    known[s + 2 * n_inputs :] = state[s:]
    for k in range(len(record)):
        known[s : s + n_inputs] = inputs[k]
        known[s + n_inputs : s + 2 * n_inputs] = inputs[k + 1]
        mesh_condition(phase[0] + (first + k + 0.5) * phase[1], table, shifts, errors, phase[2], middle)
        mesh_condition(phase[0] + (first + k + 1.0) * phase[1], table, shifts, errors, phase[2], end)
        result[:] = 0.0
        _add_product(free, known, result)
        for i in range(p):
            g_middle[i] = known[s + 2 * n_inputs + i]
            g_end[i] = g_middle[i]
        for _ in range(_ROUNDS):
            motion[:] = result[s:]
            _add_product(couple_middle, g_middle, motion)
            _add_product(couple_end, g_end, motion)
            mesh_forces(motion[: 2 * p], middle, statics, laws, scratch, g_middle)
            mesh_forces(motion[2 * p :], end, statics, laws, force[k], g_end)
        _add_product(from_middle, g_middle, result)
        _add_product(from_end, g_end, result)
        mesh_forces(result[s + 2 * p :], end, statics, laws, force[k], g_end)
        known[:s] = result[:s]
        known[s + 2 * n_inputs :] = g_end
        record[k, :s] = result[:s]
        record[k, s : s + n_inputs] = inputs[k + 1]
        record[k, s + n_inputs :] = g_end
        if not math.isfinite(force[k, 0]) or not math.isfinite(result[0]):
            return k
    state[:s] = known[:s]
    state[s:] = known[s + 2 * n_inputs :]
    return len(record)
