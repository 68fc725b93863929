"""Compiled steps of `condensed`: predict, contact, correct, record.

Let z be the pairs of the symmetric parts, yᵢ the states of drive i's individual part, u the inputs, and r the residual
force of the couplings: what their forces F are above the mean linear part. The patterns W (1, cos and sin of the
drives' angles, orthonormal) split r into R = W r, which acts on z, and r° = r − Wᵀ R, which acts on y. Indices −, 0 and
+ mean a step before, now and at the end. A step takes r as the quadratic through r₋, r₀ and r₊, to which z and y answer
exactly; the small letters a, p, o, q do for a drive what A, P, O, Q do for the patterns:

    z₊ = A z + B u + P₋ R₋ + P₀ R₀ + P₊ R₊

What is kept is not z but x, and likewise not y, less the last two residuals, so that one product in place of three
remains of them (`_add_residuals` goes from one to the other):

    x = z − P₊ R₀ − P̂ R₋,  P̂ = P₀ + A P₊   ⟹   x₊ = A x + B u + G R₋,  G = P₋ + A P̂

Predict, all that does not depend on r₊:

    x₊ = A x + B u + G R₋                   `_transfer_symmetric`, `_push_symmetric`
    D* = O x₊ + O P̂ R₀                      `_observe_symmetric`
    y₊ = a y + g r°₋                        `_predict_individual`
    y₊ += b s° u                            `_drive_individual`, only where the motors share unequally
    d* = o y₊ + o p̂ r°₀                     `_observe_individual`

Contact, from r₊ ≈ 2 r₀ − r₋ in two rounds, d being the deflections and rates of the couplings:

    R₊ = W r₊                               `_into_patterns`
    D = D* + Q R₊                           `_pattern_motion`
    d = d* + q r₊ + Wᵀ D                    `_coupling_motion`
    r₊ = F(d) − F_s − k̄ d − c ḋ             `coupling_forces`, less c ḋ of the linear part where it differs

As every drive answers the whole of r with q, Q is what the patterns' answer exceeds it by. Then the contact state of
the meshes, 1 on the drive flank, 0 open, −1 on the back flank (`_contact_state`). Where it changes, r jumps (by the
damper) or turns (by the spring): the step is discarded and taken again in 32 substeps, u and the mesh inputs linear
between its ends (`_substep_inputs`), r₋ moved along its line to a substep before (`_move_before`). After the substep
that holds the jump the quadratic begins anew, r₋ = r₀.

Accept:

    R₊ = W r₊,  r°₊ = r₊ − Wᵀ R₊            `_into_patterns`, `_individual_residual`
    x, y = x₊, y₊;  r₋, r₀ = r₀, r₊         `_copy`, `_shift`

Record: x, R₋, R₀, and of the drives asked for y, r°₋ and r°₀ (`_record`).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tbm_dynamics.integration.condensed_arrays import Arrays, State
from tbm_dynamics.integration.laws import CouplingLaws, coupling_forces
from tbm_dynamics.integration.linear import INPUTS, MOTORS
from tbm_dynamics.integration.method import Steps

SUBSTEPS = 32
"""Parts of a step in which a mesh meets or leaves a flank."""

# A round shrinks the error of the residual by about (ω_mesh τ)²/6.
_ROUNDS = 2

# The numbers of the patterns are a tuple: its length is a constant of the compiled code, one for each length.
# No slices of arrays within the steps: each would be counted as a reference. Dot products may be summed in vectors:
# their length is fixed, so each is always summed in the same order.
_INNER = {"cache": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "error_model": "numpy"}
_SUMS = {**_INNER, "fastmath": {"reassoc", "contract", "nsz"}}
_LOOPS = {**_INNER, "fastmath": {"contract"}}


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _transfer_symmetric(
    action: np.ndarray, level: int, pairs: np.ndarray, forced: np.ndarray, k: int, out: np.ndarray
) -> None:
    """Write A z + B u, the latter row k of `forced`, to out (2, M)."""
    m = pairs.shape[1]
    for j in range(m):
        out[0, j] = forced[k, j] + (action[level, 0, j] * pairs[0, j] + action[level, 1, j] * pairs[1, j])
    for j in range(m):
        out[1, j] = forced[k, m + j] + (action[level, 2, j] * pairs[0, j] + action[level, 3, j] * pairs[1, j])


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _push_symmetric(
    numbers: tuple[int, ...], rows: np.ndarray, level: int, spans: np.ndarray, R: np.ndarray, out: np.ndarray
) -> None:
    """Add G R₋ to out (2, M)."""
    for q in range(len(numbers)):
        a, b = R[0, 2 * q], R[0, 2 * q + 1]
        for half in range(2):
            for j in range(spans[q, 0], spans[q, 1]):
                out[half, j] += a * rows[level, q, 0, half, j] + b * rows[level, q, 1, half, j]


@njit(**_SUMS)  # type: ignore[untyped-decorator]
def _observe_symmetric(
    numbers: tuple[int, ...],
    matrix: np.ndarray,
    couple: np.ndarray,
    level: int,
    spans: np.ndarray,
    pairs: np.ndarray,
    R: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write D* = O x₊ + O P̂ R₀, (4P,)."""
    for q in range(len(numbers)):
        w = x = y = z = 0.0
        for j in range(spans[q, 0], spans[q, 1]):
            first, second = pairs[0, j], pairs[1, j]
            w += matrix[q, 0, 0, j] * first + matrix[q, 0, 1, j] * second
            x += matrix[q, 1, 0, j] * first + matrix[q, 1, 1, j] * second
            y += matrix[q, 2, 0, j] * first + matrix[q, 2, 1, j] * second
            z += matrix[q, 3, 0, j] * first + matrix[q, 3, 1, j] * second
        out[4 * q], out[4 * q + 1], out[4 * q + 2], out[4 * q + 3] = w, x, y, z
    for i in range(4 * len(numbers)):
        for j in range(2 * len(numbers)):
            out[i] += couple[level, i, j] * R[1, j]


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _predict_individual(
    action: np.ndarray, push: np.ndarray, level: int, own: np.ndarray, r: np.ndarray, out: np.ndarray
) -> None:
    """Write y₊ = a y + g r°₋, (n, L)."""
    m = action.shape[2]
    for half in range(2):
        for j in range(m):
            first, second, row = action[level, 2 * half, j], action[level, 2 * half + 1, j], half * m + j
            a, b = push[level, row, 0], push[level, row, 1]
            for i in range(own.shape[1]):
                out[row, i] = (first * own[j, i] + second * own[m + j, i]) + (a * r[0, 0, i] + b * r[0, 1, i])


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _drive_individual(
    forced: np.ndarray, level: int, torque: np.ndarray, inputs: np.ndarray, k: int, substep: int, out: np.ndarray
) -> None:
    """Add b s° u to out (n, L), u the motors' torque at the end of the step or substep and at its start."""
    before, after = inputs[k, INPUTS + MOTORS], inputs[k, MOTORS]
    start = before + (substep - 1.0) / SUBSTEPS * (after - before) if substep else before
    end = before + substep / SUBSTEPS * (after - before) if substep else after
    for row in range(forced.shape[1]):
        added = forced[level, row, 0] * end + forced[level, row, 1] * start
        for i in range(len(torque)):
            out[row, i] += added * torque[i]


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _observe_individual(
    weights: np.ndarray, couple: np.ndarray, level: int, rows: np.ndarray, r: np.ndarray, out: np.ndarray
) -> None:
    """Write d* = o y₊ + o p̂ r°₀, (4, L); n even."""
    for k in range(4):
        a, b = couple[level, k, 0], couple[level, k, 1]
        for i in range(rows.shape[1]):
            out[k, i] = a * r[1, 0, i] + b * r[1, 1, i]
    for k in range(0, weights.shape[1], 2):
        a, b, c, d = weights[0, k], weights[1, k], weights[2, k], weights[3, k]
        e, f, g, h = weights[0, k + 1], weights[1, k + 1], weights[2, k + 1], weights[3, k + 1]
        for i in range(rows.shape[1]):
            first, second = rows[k, i], rows[k + 1, i]
            out[0, i] += a * first + e * second
            out[1, i] += b * first + f * second
            out[2, i] += c * first + g * second
            out[3, i] += d * first + h * second


@njit(**_SUMS)  # type: ignore[untyped-decorator]
def _into_patterns(numbers: tuple[int, ...], patterns: np.ndarray, r: np.ndarray, R: np.ndarray) -> None:
    """Write R₊ = W r₊, by pattern and kind."""
    for q in range(len(numbers)):
        mesh = gearbox = 0.0
        for i in range(patterns.shape[1]):
            mesh += patterns[q, i] * r[2, 0, i]
            gearbox += patterns[q, i] * r[2, 1, i]
        R[2, 2 * q], R[2, 2 * q + 1] = mesh, gearbox


@njit(**_SUMS)  # type: ignore[untyped-decorator]
def _pattern_motion(
    numbers: tuple[int, ...], couple: np.ndarray, level: int, R: np.ndarray, predicted: np.ndarray, out: np.ndarray
) -> None:
    """Write D = D* + Q R₊, (4P,)."""
    for i in range(4 * len(numbers)):
        total = predicted[i]
        for j in range(2 * len(numbers)):
            total += couple[level, i, j] * R[2, j]
        out[i] = total


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _coupling_motion(
    numbers: tuple[int, ...],
    couple: np.ndarray,
    level: int,
    patterns: np.ndarray,
    r: np.ndarray,
    D: np.ndarray,
    predicted: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write d = d* + q r₊ + Wᵀ D, (4, L)."""
    for k in range(4):
        a, b, x, y, z = couple[level, k, 0], couple[level, k, 1], D[k], D[4 + k], D[8 + k]
        for i in range(patterns.shape[1]):
            own = predicted[k, i] + (a * r[2, 0, i] + b * r[2, 1, i])
            out[k, i] = own + (x * patterns[0, i] + y * patterns[1, i] + z * patterns[2, i])
        for q in range(3, len(numbers)):
            x = D[4 * q + k]
            for i in range(patterns.shape[1]):
                out[k, i] += x * patterns[q, i]


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _contact_state(
    motion: np.ndarray, mesh_inputs: np.ndarray, own: np.ndarray, now: np.ndarray, out: np.ndarray
) -> bool:
    """Write the contact state at the end, (2L,); returns whether it differs from that now."""
    changed = 0.0
    for i in range(len(out)):
        deflection, gap = motion[0, i] + mesh_inputs[0, 1, i], own[0, i]
        out[i] = (1.0 if deflection > gap else 0.0) - (1.0 if deflection < -gap else 0.0)
        changed += 1.0 if out[i] != now[i] else 0.0
    return changed > 0.0


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _substep_inputs(
    substep: int,
    inputs: np.ndarray,
    k: int,
    matrix: np.ndarray,
    before: np.ndarray,
    mesh_inputs: np.ndarray,
    forced: np.ndarray,
    between: np.ndarray,
) -> None:
    """Write B u of a substep of step k, (1, 2M), and the mesh inputs at its end, (1, 3, 2L)."""
    share, done = substep / SUBSTEPS, (substep - 1.0) / SUBSTEPS
    for j in range(matrix.shape[2]):
        forced[0, j] = 0.0
    for i in range(14):
        fraction = share if i < 7 else done
        u = inputs[k, i % 7 + 7] + fraction * (inputs[k, i % 7] - inputs[k, i % 7 + 7])
        for j in range(matrix.shape[2]):
            forced[0, j] += u * matrix[1, i, j]
    for q in range(3):
        for i in range(before.shape[1]):
            between[0, q, i] = before[q, i] + share * (mesh_inputs[k, q, i] - before[q, i])


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _individual_residual(
    numbers: tuple[int, ...], patterns: np.ndarray, r: np.ndarray, R: np.ndarray, out: np.ndarray
) -> None:
    """Write r°₊ = r₊ − Wᵀ R₊."""
    for kind in range(2):
        x, y, z = R[2, kind], R[2, 2 + kind], R[2, 4 + kind]
        for i in range(patterns.shape[1]):
            out[2, kind, i] = r[2, kind, i] - (x * patterns[0, i] + y * patterns[1, i] + z * patterns[2, i])
        for q in range(3, len(numbers)):
            x = R[2, 2 * q + kind]
            for i in range(patterns.shape[1]):
                out[2, kind, i] -= x * patterns[q, i]


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _copy(values: np.ndarray, out: np.ndarray) -> None:
    """Write values (n, m) to out."""
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            out[i, j] = values[i, j]


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _shift(r: np.ndarray) -> None:
    """Shift the residuals (3, …) by a step."""
    for i in range(len(r[0])):
        r[0, i] = r[1, i]
        r[1, i] = r[2, i]


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _begin_anew(
    numbers: tuple[int, ...],
    patterns: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
    r: np.ndarray,
    R: np.ndarray,
    out: np.ndarray,
) -> None:
    """Begin the quadratics of couplings whose contact has changed now: r₋ = r₀ of them, R₋ = W r₋, r°₋ = r₋ − Wᵀ R₋."""
    lanes = patterns.shape[1]
    for kind in range(2):
        for i in range(lanes):
            if before[kind * lanes + i] != after[kind * lanes + i]:
                r[0, kind, i] = r[1, kind, i]
            out[0, kind, i] = r[0, kind, i]
        for q in range(len(numbers)):
            total = 0.0
            for i in range(lanes):
                total += patterns[q, i] * r[0, kind, i]
            R[0, 2 * q + kind] = total
            for i in range(lanes):
                out[0, kind, i] -= total * patterns[q, i]


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _add_residuals(
    shift: np.ndarray,
    own_shift: np.ndarray,
    level: int,
    sign: float,
    R: np.ndarray,
    r_own: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
) -> None:
    """Add sign · (P̂ R₋ + P₊ R₀) to x (2, M), and the same of every drive to y (n, L)."""
    for q in range(shift.shape[1]):
        for t in range(2):
            for kind in range(2):
                force = sign * R[t, 2 * q + kind]
                for half in range(2):
                    for j in range(x.shape[1]):
                        x[half, j] += force * shift[level, q, 2 * t + kind, half, j]
    for row in range(own_shift.shape[1]):
        for t in range(2):
            for kind in range(2):
                for i in range(y.shape[1]):
                    y[row, i] += sign * own_shift[level, row, 2 * t + kind] * r_own[t, kind, i]


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _move_before(r: np.ndarray, factor: float) -> None:
    """Move r₋ along the line through it and r₀: to a substep before, or back to a step before."""
    for i in range(len(r[0])):
        r[0, i] = r[1, i] - factor * (r[1, i] - r[0, i])


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _record(
    numbers: tuple[int, ...],
    x: np.ndarray,
    R: np.ndarray,
    y: np.ndarray,
    r: np.ndarray,
    drives: np.ndarray,
    k: int,
    record: np.ndarray,
) -> None:
    """Write x, R₋, R₀ and of the drives asked for y, r°₋ and r°₀ to row k of the record."""
    for j in range(x.shape[1]):
        record[k, 2 * j], record[k, 2 * j + 1] = x[0, j], x[1, j]
    place = 2 * x.shape[1]
    for t in range(2):
        for i in range(2 * len(numbers)):
            record[k, place + i] = R[t, i]
        place += 2 * len(numbers)
    for i in drives:
        for j in range(len(y)):
            record[k, place + j] = y[j, i]
        place += len(y)
        for t in range(2):
            record[k, place], record[k, place + 1] = r[t, 0, i], r[t, 1, i]
            place += 2


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def advance(  # noqa: PLR0912, PLR0915 - one loop: a call for each phase would cost as much as the phase
    arrays: Arrays, laws: CouplingLaws, own: np.ndarray, drives: np.ndarray, steps: Steps, state: State
) -> int:
    """Compiled `Condensed.advance`.

    `own` (2, 2L) are what each coupling has of its own: the deflection at which it touches, −∞ without a gap (such a
    one has the contact state 0), and what its damper exceeds that of the linear part by. `drives` are those whose
    individual parts are recorded.
    """
    (
        spans, transfer, B, push, shift, observe, couple, couple_now, own_transfer, own_push, own_shift, own_observe,
        own_couple, own_couple_now, W, b, s, numbers,
    ) = arrays  # fmt: skip
    mesh_inputs, inputs, forced, record, force = steps
    x, y, r, R, r_own, contact, mesh_now, workspace = state
    x_end, y_end, D_predicted, D, d_predicted, d, force_end, contact_end, mesh_end, forced_substep = workspace
    lanes = W.shape[1]
    residuals = (r.reshape(3, 2 * lanes), R, r_own.reshape(3, 2 * lanes))
    motion, r_end = d.reshape(2, 2 * lanes), r[2].reshape(2 * lanes)
    first = np.arange(1)[0]  # no literal: the functions would be compiled anew for it
    unequal, unlike = np.any(s != 0.0), np.any(own[1] != 0.0)
    k = substep = 0
    while k < len(record):
        # Predict.
        level = 1 if substep else 0
        if substep:
            _substep_inputs(substep, inputs, k, B, mesh_now, mesh_inputs, forced_substep, mesh_end)
            _transfer_symmetric(transfer, level, x, forced_substep, first, x_end)
        else:
            for q in range(3):
                for i in range(2 * lanes):
                    mesh_end[0, q, i] = mesh_inputs[k, q, i]
            _transfer_symmetric(transfer, level, x, forced, k, x_end)
        _push_symmetric(numbers, push, level, spans, R, x_end)
        _observe_symmetric(numbers, observe, couple_now, level, spans, x_end, R, D_predicted)
        _predict_individual(own_transfer, own_push, level, y, r_own, y_end)
        if unequal:
            _drive_individual(b, level, s, inputs, k, substep, y_end)
        _observe_individual(own_observe, own_couple_now, level, y_end, r_own, d_predicted)
        # Contact.
        for kind in range(2):
            for i in range(lanes):
                r[2, kind, i] = 2.0 * r[1, kind, i] - r[0, kind, i]
        for _ in range(_ROUNDS):
            _into_patterns(numbers, W, r, R)
            _pattern_motion(numbers, couple, level, R, D_predicted, D)
            _coupling_motion(numbers, own_couple, level, W, r, D, d_predicted, d)
            coupling_forces(motion, mesh_end, first, laws, force_end, r_end)
            if unlike:
                for i in range(2 * lanes):
                    r_end[i] += own[1, i] * motion[1, i]
        changed = _contact_state(motion, mesh_end, own, contact, contact_end)
        if changed and substep == 0:
            substep = 1
            _add_residuals(shift, own_shift, 0, 1.0, R, r_own, x, y)
            for values in residuals:
                _move_before(values, 1.0 / SUBSTEPS)
            _add_residuals(shift, own_shift, 1, -1.0, R, r_own, x, y)
            continue
        # Accept.
        _into_patterns(numbers, W, r, R)
        _individual_residual(numbers, W, r, R, r_own)
        _copy(x_end, x)
        _copy(y_end, y)
        for values in residuals:
            _shift(values)
        if substep:
            substep = (substep + 1) % (SUBSTEPS + 1)
            if changed or not substep:
                _add_residuals(shift, own_shift, 1, 1.0, R, r_own, x, y)
                if changed:
                    _begin_anew(numbers, W, contact, contact_end, r, R, r_own)
                if not substep:
                    for values in residuals:
                        _move_before(values, float(SUBSTEPS))
                _add_residuals(shift, own_shift, 1 if substep else 0, -1.0, R, r_own, x, y)
            for i in range(2 * lanes):
                contact[i] = contact_end[i]
            if substep:
                continue
        for q in range(3):
            for i in range(2 * lanes):
                mesh_now[q, i] = mesh_inputs[k, q, i]
        # Record.
        _record(numbers, x, R, y, r_own, drives, k, record)
        for i in range(2 * lanes):
            force[k, i] = force_end[i]
        if not math.isfinite(force_end[0]) or not math.isfinite(x[0, 0]):
            return k
        k += 1
    return len(record)
