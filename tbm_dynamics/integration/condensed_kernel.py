"""The compiled step of `condensed`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tbm_dynamics.integration.condensed_arrays import PATTERNS, Arrays, Room, State
from tbm_dynamics.integration.laws import Laws, forces

SUBSTEPS = 32
"""Parts of a step in which a mesh meets or leaves a flank."""

# Rounds over g at the end of a step. A round shrinks the error by about (ω_mesh τ)²/6.
_ROUNDS = 2

# No slices of arrays within the steps: each would be counted as a reference. Dot products may be summed in vectors:
# their length is fixed, so each is always summed in the same order.
_INNER = {"cache": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "error_model": "numpy"}
_SUMS = {**_INNER, "fastmath": {"reassoc", "contract", "nsz"}}
_LOOPS = {**_INNER, "fastmath": {"contract"}}


@njit(**_SUMS)  # type: ignore[untyped-decorator]
def _observe(matrix: np.ndarray, a: np.ndarray, b: np.ndarray, place: int, out: np.ndarray) -> None:
    """Write the four motions of a pattern, matrix (4, 2, w), from its pairs (a, b) to a place of out (12,)."""
    w = x = y = z = 0.0
    for j in range(len(a)):
        first, second = a[j], b[j]
        w += matrix[0, 0, j] * first + matrix[0, 1, j] * second
        x += matrix[1, 0, j] * first + matrix[1, 1, j] * second
        y += matrix[2, 0, j] * first + matrix[2, 1, j] * second
        z += matrix[3, 0, j] * first + matrix[3, 1, j] * second
    out[place], out[place + 1], out[place + 2], out[place + 3] = w, x, y, z


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _push(
    rows: np.ndarray, level: int, g: np.ndarray, place: int, upper: np.ndarray, lower: np.ndarray, old: bool
) -> None:
    """Add to a pattern's pairs what its g at `place` pushes: that before and now (`old`), or that at the end."""
    a, b, c, d, e, f = g[0, place], g[0, place + 1], g[1, place], g[1, place + 1], g[2, place], g[2, place + 1]
    if old:
        for j in range(len(upper)):
            first = a * rows[level, 0, 0, j] + b * rows[level, 1, 0, j]
            upper[j] += first + (c * rows[level, 2, 0, j] + d * rows[level, 3, 0, j])
        for j in range(len(lower)):
            first = a * rows[level, 0, 1, j] + b * rows[level, 1, 1, j]
            lower[j] += first + (c * rows[level, 2, 1, j] + d * rows[level, 3, 1, j])
    else:
        for j in range(len(upper)):
            upper[j] += e * rows[level, 4, 0, j] + f * rows[level, 5, 0, j]
        for j in range(len(lower)):
            lower[j] += e * rows[level, 4, 1, j] + f * rows[level, 5, 1, j]


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _transfer(action: np.ndarray, level: int, pairs: np.ndarray, forced: np.ndarray, k: int, out: np.ndarray) -> None:
    """Write to out (2, M) what the pairs become by themselves and by the inputs, row k of forced."""
    m = pairs.shape[1]
    for j in range(m):
        out[0, j] = forced[k, j] + (action[level, 0, j] * pairs[0, j] + action[level, 1, j] * pairs[1, j])
    for j in range(m):
        out[1, j] = forced[k, m + j] + (action[level, 2, j] * pairs[0, j] + action[level, 3, j] * pairs[1, j])


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _own_free(
    action: np.ndarray, push: np.ndarray, level: int, own: np.ndarray, alone: np.ndarray, out: np.ndarray
) -> None:
    """Write what the own parts become by themselves and by their g before and now."""
    m = action.shape[2]
    for half in range(2):
        for j in range(m):
            first, second, row = action[level, 2 * half, j], action[level, 2 * half + 1, j], half * m + j
            a, b, c, d = push[level, row, 0], push[level, row, 1], push[level, row, 2], push[level, row, 3]
            for i in range(own.shape[1]):
                pushed = (a * alone[0, 0, i] + b * alone[0, 1, i]) + (c * alone[1, 0, i] + d * alone[1, 1, i])
                out[row, i] = (first * own[j, i] + second * own[m + j, i]) + pushed


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _own_end(push: np.ndarray, level: int, alone: np.ndarray, free: np.ndarray, out: np.ndarray) -> None:
    """Write what the own parts become by themselves and by what their g at the end pushes."""
    for row in range(push.shape[1]):
        e, f = push[level, row, 4], push[level, row, 5]
        for i in range(alone.shape[2]):
            out[row, i] = free[row, i] + (e * alone[2, 0, i] + f * alone[2, 1, i])


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _mixed(weights: np.ndarray, rows: np.ndarray, out: np.ndarray) -> None:
    """Write weights (4, n) @ rows (n, L) to out (4, L); n even."""
    for i in range(rows.shape[1]):
        out[0, i] = out[1, i] = out[2, i] = out[3, i] = 0.0
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
def _together(shared: np.ndarray, g: np.ndarray, out: np.ndarray) -> None:
    """Write g at the end in the patterns, by pattern and kind."""
    for pattern in range(PATTERNS):
        mesh = gearbox = 0.0
        for i in range(shared.shape[1]):
            mesh += shared[pattern, i] * g[2, 0, i]
            gearbox += shared[pattern, i] * g[2, 1, i]
        out[2, 2 * pattern], out[2, 2 * pattern + 1] = mesh, gearbox


@njit(**_SUMS)  # type: ignore[untyped-decorator]
def _beyond(couple: np.ndarray, level: int, g: np.ndarray, free: np.ndarray, out: np.ndarray) -> None:
    """Write the motions of the patterns, (12,), from the free ones and g at the end."""
    for i in range(12):
        total = free[i]
        for j in range(6):
            total += couple[level, i, j] * g[2, j]
        out[i] = total


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _coupled(
    own: np.ndarray,
    level: int,
    shared: np.ndarray,
    g: np.ndarray,
    pattern: np.ndarray,
    free: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write the motions (4, L): the own parts' free ones, what g at the end adds to them, the patterns' (12,)."""
    for q in range(4):
        a, b, x, y, z = own[level, q, 0], own[level, q, 1], pattern[q], pattern[4 + q], pattern[8 + q]
        for i in range(shared.shape[1]):
            alone = free[q, i] + (a * g[2, 0, i] + b * g[2, 1, i])
            out[q, i] = alone + (x * shared[0, i] + y * shared[1, i] + z * shared[2, i])


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _alone(shared: np.ndarray, g: np.ndarray, together: np.ndarray, out: np.ndarray) -> None:
    """Write what of g at the end is beyond the patterns."""
    for kind in range(2):
        x, y, z = together[2, kind], together[2, 2 + kind], together[2, 4 + kind]
        for i in range(shared.shape[1]):
            out[2, kind, i] = g[2, kind, i] - (x * shared[0, i] + y * shared[1, i] + z * shared[2, i])


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _touching(motion: np.ndarray, held: np.ndarray, constants: np.ndarray, now: np.ndarray, out: np.ndarray) -> float:
    """Write which flanks touch; count those that did not before."""
    changed = 0.0
    for i in range(len(out)):
        deflection, gap = motion[0, i] + held[0, 1, i], constants[2, i]
        out[i] = (1.0 if deflection > gap else 0.0) - (1.0 if deflection < -gap else 0.0)
        changed += 1.0 if out[i] != now[i] else 0.0
    return changed


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _aged(g: np.ndarray, anew: bool) -> None:
    """Age g: that at the end becomes that now; `anew`: it has jumped, and what it was before says nothing."""
    for i in range(len(g[0])):
        g[0, i] = g[2, i] if anew else g[1, i]
        g[1, i] = g[2, i]


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _spread(g: np.ndarray, factor: float) -> None:
    """Move g before along the line through it and g now: to a part of a step before, or back."""
    for i in range(len(g[0])):
        g[0, i] = g[1, i] - factor * (g[1, i] - g[0, i])


@njit(**_LOOPS)  # type: ignore[untyped-decorator]
def _part_of(
    part: int,
    inputs: np.ndarray,
    k: int,
    matrix: np.ndarray,
    before: np.ndarray,
    held: np.ndarray,
    out: np.ndarray,
    between: np.ndarray,
) -> None:
    """Write what the inputs add in a part of step k, and what is held then; both run linearly between its ends."""
    share, done = part / SUBSTEPS, (part - 1.0) / SUBSTEPS
    for j in range(matrix.shape[2]):
        out[0, j] = 0.0
    for i in range(14):
        fraction = share if i < 7 else done
        u = inputs[k, i % 7 + 7] + fraction * (inputs[k, i % 7] - inputs[k, i % 7 + 7])
        for j in range(matrix.shape[2]):
            out[0, j] += u * matrix[1, i, j]
    for q in range(3):
        for i in range(before.shape[1]):
            between[0, q, i] = before[q, i] + share * (held[k, q, i] - before[q, i])


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def advance(  # noqa: PLR0912, PLR0915 - one loop: a call for each piece would cost as much as the piece
    arrays: Arrays,
    laws: Laws,
    held: np.ndarray,
    inputs: np.ndarray,
    forced: np.ndarray,
    state: State,
    room: Room,
    wanted: np.ndarray,
    record: np.ndarray,
    force: np.ndarray,
) -> int:
    """Compiled `Condensed.advance`."""
    shared, transfer, couple = arrays.shared, arrays.transfer, arrays.couple
    own_transfer, own_push, own_couple = arrays.own_transfer, arrays.own_push, arrays.own_couple
    observe0, observe1, observe2 = arrays.observe
    push0, push1, push2 = arrays.push
    spans, fine, constants = arrays.spans, arrays.forced, laws.constants
    common, own, excess, patterns = state.common, state.own, state.excess, state.patterns
    alone, touch, standing = state.alone, state.touch, state.held
    lanes, pairs, n = shared.shape[1], transfer.shape[2], own_push.shape[1]
    moved, next_own, next_touch, fine_forced = room.moved, room.own, room.touch, room.forced
    a0, b0 = moved[0, spans[0, 0] : spans[0, 1]], moved[1, spans[0, 0] : spans[0, 1]]
    a1, b1 = moved[0, spans[1, 0] : spans[1, 1]], moved[1, spans[1, 0] : spans[1, 1]]
    a2, b2 = moved[0, spans[2, 0] : spans[2, 1]], moved[1, spans[2, 0] : spans[2, 1]]
    own_observe, free, free_pattern, pattern = arrays.own_observe, room.free, room.free_pattern, room.pattern
    motion, between, forced_by = room.motion, room.held, room.force
    stage, later = motion.reshape(2, 2 * lanes), excess[2].reshape(2 * lanes)
    flat = excess.reshape(3, 2 * lanes), patterns, alone.reshape(3, 2 * lanes)
    # Not as literals: the functions would be compiled anew for each.
    order = np.arange(PATTERNS)
    i0, i1, i2 = order[0], order[1], order[2]
    k = part = 0
    while k < len(record):
        level = 1 if part else 0
        if part:
            _part_of(part, inputs, k, fine, standing, held, fine_forced, between)
            _transfer(transfer, level, common, fine_forced, i0, moved)
        else:
            _transfer(transfer, level, common, forced, k, moved)
            for q in range(3):
                for i in range(2 * lanes):
                    between[0, q, i] = held[k, q, i]
        _push(push0, level, patterns, 2 * i0, a0, b0, True)
        _push(push1, level, patterns, 2 * i1, a1, b1, True)
        _push(push2, level, patterns, 2 * i2, a2, b2, True)
        _observe(observe0, a0, b0, 4 * i0, free_pattern)
        _observe(observe1, a1, b1, 4 * i1, free_pattern)
        _observe(observe2, a2, b2, 4 * i2, free_pattern)
        _own_free(own_transfer, own_push, level, own, alone, next_own)
        _mixed(own_observe, next_own, free)
        for kind in range(2):
            for i in range(lanes):
                excess[2, kind, i] = 2.0 * excess[1, kind, i] - excess[0, kind, i]
        for _ in range(_ROUNDS):
            _together(shared, excess, patterns)
            _beyond(couple, level, patterns, free_pattern, pattern)
            _coupled(own_couple, level, shared, excess, pattern, free, motion)
            forces(stage, between, i0, laws, forced_by, later)
        changed = _touching(stage, between, constants, touch, next_touch) > 0.0
        if changed and part == 0:
            part = 1
            for g in flat:
                _spread(g, 1.0 / SUBSTEPS)
            continue
        _together(shared, excess, patterns)
        _alone(shared, excess, patterns, alone)
        _push(push0, level, patterns, 2 * i0, a0, b0, False)
        _push(push1, level, patterns, 2 * i1, a1, b1, False)
        _push(push2, level, patterns, 2 * i2, a2, b2, False)
        _own_end(own_push, level, alone, next_own, own)
        for j in range(pairs):
            common[0, j], common[1, j] = moved[0, j], moved[1, j]
        for g in flat:
            _aged(g, changed)
        if part:
            for i in range(2 * lanes):
                touch[i] = next_touch[i]
            part += 1
            if part <= SUBSTEPS:
                continue
            part = 0
            for g in flat:
                _spread(g, float(SUBSTEPS))
        for q in range(3):
            for i in range(2 * lanes):
                standing[q, i] = held[k, q, i]
        for i in range(2 * lanes):
            force[k, i] = forced_by[i]
        for j in range(pairs):
            record[k, 2 * j], record[k, 2 * j + 1] = common[0, j], common[1, j]
        place = 2 * pairs
        for i in range(6):
            record[k, place + i] = patterns[1, i]
        place += 6
        for i in wanted:
            for j in range(n):
                record[k, place + j] = own[j, i]
            record[k, place + n], record[k, place + n + 1] = alone[1, 0, i], alone[1, 1, i]
            place += n + 2
        if not math.isfinite(forced_by[0]) or not math.isfinite(common[0, 0]):
            return k
        k += 1
    return len(record)
