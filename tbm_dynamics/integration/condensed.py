"""The production method: exponential integration on the split basis, in eigenvectors.

Order 3 where the residual force of the couplings is smooth: it is the quadratic through its values a step before, now
and at the end (the implicit exponential Adams method of two steps: Hochbruck and Ostermann, BIT Numer. Math. 51, 2011),
to which the linear part answers exactly. In the eigenvectors of each part its transfer over a step is diagonal and its
response known in closed form (`pairs`). The symmetric parts act on all drives in a few patterns; the individual part of
each drive acts on that drive alone, with the same few numbers for all (`basis`). The equations of a step stand in
`condensed_kernel`; this module computes their constants.
"""

from __future__ import annotations

from functools import lru_cache, partial

import numpy as np
import scipy.linalg

from tbm_dynamics.integration.basis import ModalPart, SplitBasis, split_basis
from tbm_dynamics.integration.condensed_arrays import BY_LENGTH, PATTERNS, Arrays, State, zero_state
from tbm_dynamics.integration.condensed_kernel import SUBSTEPS, advance
from tbm_dynamics.integration.lanes import aligned, widened
from tbm_dynamics.integration.laws import CouplingLaws
from tbm_dynamics.integration.linear import INPUTS
from tbm_dynamics.integration.method import Method, Steps, fine_step, refuse_coarse
from tbm_dynamics.integration.pairs import act, as_pairs, scalar_responses
from tbm_dynamics.integration.start import Start
from tbm_dynamics.structure.system import System

# Number of pairs that fills vector registers.
_PAIRS = 8


class Condensed(Method[State]):
    """Integration method on the split basis, see `method.Method`.

    Raises
    ------
    SimulationError
        Eigenvectors that are nearly dependent, or a step too coarse for the couplings.
    """

    stages = (1.0,)

    def __init__(self, system: System, output_dofs: np.ndarray, step: float) -> None:
        split = split_basis(system)
        self._parts, whole = _over_a_step(split, step)
        self._drives, self._split = system.drives, split
        p, c = split.shared.shape
        self.linear = system.couplings.alike
        gap, damping = system.couplings.half_gap, system.couplings.damping
        self._own = aligned(widened(np.array([np.where(gap > 0.0, gap, -np.inf), damping - self.linear[1]]), p))
        alone = p > c  # else the patterns are all that the drives can do
        self.states = sum(len(part.linear.H) for part in split.symmetric) + alone * p * len(split.individual.linear.H)
        check_step(system, step)
        self._arrays = _with_substep(whole, _arrays(split, _SteppedParts(split, step / SUBSTEPS)))
        self.forced = self._arrays.forced[0]
        self._recorded = np.array(
            [i for i, dofs in enumerate(self._drives.dofs) if alone and np.isin(dofs, output_dofs).any()],
            dtype=np.intp,
        )
        self.output = self._outputs(output_dofs)
        self.tail = len(self.output) - 2 * self._arrays.transfer.shape[2]

    def _outputs(self, dofs: np.ndarray) -> np.ndarray:
        """Matrix from a row of the record: symmetric states, R₋, R₀, recorded drives' states, r°₋ and r°₀, u."""
        split, parts = self._split, self._parts
        pairs = self._arrays.transfer.shape[2]
        size = 2 * pairs
        of_residual = 2 * len(self._arrays.numbers)
        symmetric = np.zeros((size + 2 * of_residual, 2 * len(dofs)))
        inputs = np.zeros((INPUTS, 2 * len(dofs)))
        for part, stepped, places in zip(split.symmetric, parts.symmetric, parts.places, strict=True):
            by_state, by_residual, by_input = _observed(stepped, part, part.shapes[dofs])
            half, pair = np.divmod(places, pairs)
            symmetric[2 * pair + half] = by_state  # a record holds the two states of a pair side by side
            rows = _pattern_places(part, split.shared.shape[1], 1)
            symmetric[size + np.concatenate([rows, of_residual + rows])] += by_residual
            inputs[part.inputs] += by_input
        blocks = [symmetric]
        for i in self._recorded:
            places, outputs = np.nonzero(self._drives.dofs[i][:, None] == dofs)
            shapes = np.zeros((len(dofs), split.individual.shapes.shape[1]))
            shapes[outputs] = (self._drives.turns[i].T @ split.individual.shapes)[places]
            by_state, by_residual, by_input = _observed(parts.individual, split.individual, shapes)
            blocks += [by_state, by_residual]
            inputs[split.individual.inputs] += split.own_torque[i] * by_input
        return np.vstack([*blocks, inputs])

    def start(self, start: Start) -> tuple[State, np.ndarray]:
        """State and row of the record at the start of a run; see `method.Method`."""
        drives, shared, parts, W = self._drives, self._split.shared, self._parts, self._arrays.patterns
        p, lanes = len(shared), W.shape[1]
        state = zero_state(self._arrays)
        r = start.residual.reshape(2, 2, lanes)
        R = r @ W.T
        state.residual[:2] = r
        state.pattern_residual[:2] = R.transpose(0, 2, 1).reshape(2, -1)
        state.individual_residual[:2] = r - R @ W
        push = start.push.reshape(2, lanes)
        pushed = push @ W.T
        for part, stepped, places in zip(self._split.symmetric, parts.symmetric, parts.places, strict=True):
            moving = part.balanced(part.project @ start.velocity, pushed.ravel())
            pushes = state.pattern_residual[:2, _pattern_places(part, shared.shape[1], 1)].ravel()
            state.symmetric.flat[places] = stepped.inverse @ moving - stepped.shift @ pushes
        own = np.einsum("ide,ie->id", drives.turns, start.velocity[drives.dofs])
        own -= shared @ (shared.T @ own)
        individual = self._split.individual
        moving = individual.balanced(individual.project @ own.T, (push - pushed @ W)[:, :p])
        state.individual[:, :p] = parts.individual.inverse @ moving
        state.individual[:] -= parts.individual.shift @ state.individual_residual[:2].reshape(-1, lanes)
        state.mesh_inputs[:] = start.mesh_inputs
        state.contact_state[:] = np.where(np.isinf(self._own[0]), 0.0, start.flank)
        recorded = np.vstack([state.individual, *state.individual_residual[:2]])[:, self._recorded]
        known = [state.symmetric.T.ravel(), state.pattern_residual[:2].ravel(), recorded.T.ravel()]
        return state, np.concatenate(known)

    def advance(self, laws: CouplingLaws, steps: Steps, state: State) -> int:
        """Advance by n steps; see `method.Method`."""
        return int(advance(self._arrays, laws, self._own, self._recorded, steps, state))


def own_step(system: System) -> float:
    """Time step (s) of a system, unless another is asked for: `DEFAULT_STEP`, or what its stiffest mesh needs.

    Raises
    ------
    SimulationError
        Meshes that no step of `method` is short enough for.
    """
    return fine_step(partial(_gain_at, system))


def check_step(system: System, step: float) -> None:
    """Raise a SimulationError where a time step (s) is too coarse for the couplings of a system."""
    refuse_coarse(partial(_gain_at, system), step)


def _gain_at(system: System, step: float) -> np.ndarray:
    return _mesh_gain(system, _over_a_step(split_basis(system), step)[1])


class _SteppedPart:
    """A part in its eigenvectors, over a step; s states, i inputs, k couplings.

    Attributes
    ----------
    vectors, inverse : (s, s') and (s', s) ndarray
        Between states and pairs, the latter padded to a number that fills registers.
    transfer : (4, s'/2) ndarray
        Action on the pairs.
    load : (s', 2i), push : (s', k) ndarray
        What u at the end and now, and the residual before add to the pairs; see `condensed_kernel`.
    shift : (s', 2k) ndarray
        What the residual before and now is in the motion beyond the pairs.
    observe : (2k, s') ndarray
        Deflections and rates of the couplings from the pairs.
    """

    def __init__(self, part: ModalPart, step: float, multiple: int) -> None:
        linear = part.linear
        basis = part.eigenbasis
        loads, couplings = np.split(basis.inverse @ linear.E, [len(part.inputs)], axis=1)
        responses = [scalar_responses(values, step) for values in basis.values]
        transfer, at_start, at_end, *pushes = (as_pairs(basis, np.array(pair)) for pair in zip(*responses, strict=True))
        pad = -(len(linear.H) // 2) % multiple

        def padded(columns: np.ndarray) -> np.ndarray:
            """Rows of pairs (2m, c) to (2m', c)."""
            a, b = np.split(columns, 2)
            idle = np.zeros((pad, columns.shape[1]))
            return np.vstack([a, idle, b, idle])

        self.vectors = padded(basis.vectors.T).T
        self.inverse = padded(basis.inverse)
        self.transfer = np.hstack([transfer, np.zeros((4, pad))])
        self.load = padded(np.hstack([act(action, loads) for action in (at_end, at_start)]))
        before, now, end = (act(action, couplings) for action in pushes)
        late = now + act(transfer, end)
        self.push = padded(before + act(transfer, late))
        self.shift = padded(np.hstack([late, end]))
        self.observe = linear.observe @ self.vectors


class _SteppedParts:
    """All parts over a step; `places` of the symmetric ones' states, the first of all pairs before the second ones."""

    def __init__(self, split: SplitBasis, step: float) -> None:
        self.symmetric = [_SteppedPart(part, step, _PAIRS) for part in split.symmetric]
        self.individual = _SteppedPart(split.individual, step, 1)
        sizes = [part.transfer.shape[1] for part in self.symmetric]
        firsts = np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1])
        self.places = [np.concatenate([places, sum(sizes) + places]) for places in firsts]


@lru_cache(maxsize=2)
def _over_a_step(split: SplitBasis, step: float) -> tuple[_SteppedParts, Arrays]:
    """Parts and arrays over a step; the last are kept, for a step is tried before it is used."""
    parts = _SteppedParts(split, step)
    return parts, _arrays(split, parts)


def _observed(stepped: _SteppedPart, part: ModalPart, shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement and acceleration along shapes (o, m) from pairs (s', 2o), residuals (2k, 2o) and u (i, 2o)."""
    m = shapes.shape[1]
    by_states, by_inputs, by_couplings = np.split(
        shapes @ part.linear.acceleration, [2 * m, 2 * m + len(part.inputs)], axis=1
    )
    from_pairs = np.vstack([shapes @ stepped.vectors[:m], by_states @ stepped.vectors])
    by_residuals = from_pairs @ stepped.shift
    by_residuals[len(shapes) :, by_couplings.shape[1] :] += by_couplings
    return (
        from_pairs.T,
        by_residuals.T,
        np.vstack([np.zeros_like(by_inputs), by_inputs]).T,
    )


def _pattern_places(part: ModalPart, patterns: int, times: int) -> np.ndarray:
    """Places (times · k,) of a part's couplings in an order by pattern, then time, then kind."""
    kind, pattern = np.divmod(part.couplings, patterns)
    return np.concatenate([(pattern * times + t) * 2 + kind for t in range(times)])


def _arrays(split: SplitBasis, parts: _SteppedParts) -> Arrays:
    """Arrays of a step of one length; `_with_substep` makes those of the kernel from two."""
    p, c = split.shared.shape
    P = max(PATTERNS, c)
    pairs = sum(len(places) for places in parts.places) // 2
    push, shift, observe, forced = (np.zeros((rows, 2 * pairs)) for rows in (2 * P, 4 * P, 4 * P, 2 * INPUTS))
    couple, couple_now = np.zeros((2, 4 * P, 2 * P))
    spans = np.zeros((P, 2), dtype=np.uintp)  # unsigned: the kernel's loops then need no check for wrapping
    for part, stepped, places in zip(split.symmetric, parts.symmetric, parts.places, strict=True):
        motions, ends = _pattern_places(part, c, 2), _pattern_places(part, c, 1)
        observe[np.ix_(motions, places)] = stepped.observe
        push[np.ix_(ends, places)] = stepped.push.T
        shift[np.ix_(motions, places)] = stepped.shift.T
        forced[np.ix_(np.concatenate([part.inputs, INPUTS + part.inputs]), places)] = stepped.load.T
        couple_now[np.ix_(motions, ends)], couple[np.ix_(motions, ends)] = np.split(
            stepped.observe @ stepped.shift, 2, axis=1
        )
        for pattern in np.unique(part.couplings % c):
            low, high = spans[pattern] if spans[pattern, 1] else (places[0], 0)
            spans[pattern] = min(low, places[0]), max(high, places[0] + stepped.transfer.shape[1])
    own = parts.individual
    own_couple_now, own_couple = np.split(own.observe @ own.shift, 2, axis=1)
    patterns = widened(split.shared.T, p)
    return Arrays(
        spans=spans,
        transfer=np.hstack([stepped.transfer for stepped in parts.symmetric]),
        forced=forced,
        push=push.reshape(P, 2, 2, pairs),
        shift=shift.reshape(P, 4, 2, pairs),
        observe=aligned(observe.reshape(P, 4, 2, pairs)),
        # What is left of the patterns' couplings when every drive answers the whole residual as its own part does.
        couple=couple - np.kron(np.eye(P), own_couple),
        couple_now=couple_now,
        own_transfer=own.transfer,
        own_push=own.push,
        own_shift=own.shift,
        own_observe=aligned(own.observe),
        own_couple=own_couple,
        own_couple_now=own_couple_now,
        patterns=aligned(np.vstack([patterns, np.zeros((P - c, patterns.shape[1]))])),
        own_forced=own.load if len(split.individual.inputs) else np.zeros((len(own.push), 2)),
        own_torque=aligned(widened(split.own_torque[None], p)[0]),
        numbers=tuple(range(P)),
    )


def _with_substep(whole: Arrays, substep: Arrays) -> Arrays:
    """Arrays of a whole step, and for what depends on its length those of a substep beside them."""
    both = {name: aligned(np.array([getattr(whole, name), getattr(substep, name)])) for name in BY_LENGTH}
    return Arrays(**(whole._asdict() | both))


def _mesh_gain(system: System, arrays: Arrays) -> np.ndarray:
    """Return what the residual of open meshes at the end adds to itself, for the patterns and an individual part."""
    patterns, P = system.drives.shared.shape[1], len(arrays.numbers)
    k, c = system.couplings.alike[:, 0]
    beyond = np.abs(system.couplings.stiffness[: system.couplings.drives] - k).max()
    law = np.array([max(k, beyond), 0.0, c, 0.0])
    individual = law @ arrays.own_couple[:, 0]
    symmetric = np.einsum("q,aqbk->abk", law, arrays.couple.reshape(P, 4, P, 2))
    symmetric = symmetric[:patterns, :patterns, 0] + individual * np.eye(patterns)
    return np.asarray(scipy.linalg.block_diag(symmetric, individual))
