"""The production method: exponential integration on the split basis, in eigenvectors.

Order 3 where the excess g of the couplings is smooth: g is the quadratic through its values a step before, now and at
the end (the implicit exponential Adams method of two steps: Hochbruck and Ostermann, BIT Numer. Math. 51, 2011), to
which the linear part answers exactly. In the eigenvectors of each part its transfer over a step is diagonal and its
response known in closed form (`pairs`). The common parts act on all drives in a few patterns; each drive's own states
act on that drive alone, with the same few numbers for all (`basis`). g at the end is found by iteration among the
deflections and rates of the couplings alone.

A mesh that meets or leaves a flank makes g jump (its damper) or turn (its spring): such a step is taken again in parts,
and the quadratic begins anew after the jump.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from tbm_dynamics.integration import aligned
from tbm_dynamics.integration.basis import Part, SplitBasis, split_basis
from tbm_dynamics.integration.condensed_arrays import PATTERNS, Arrays, Room, State
from tbm_dynamics.integration.condensed_kernel import SUBSTEPS, advance
from tbm_dynamics.integration.iteration import refuse_coarse
from tbm_dynamics.integration.laws import Laws, widened
from tbm_dynamics.integration.linear import INPUTS
from tbm_dynamics.integration.pairs import act, as_pairs, eigenbasis, scalar_responses
from tbm_dynamics.structure.system import System

# Number of pairs that fills vector registers.
_PAIRS = 4


class Condensed:
    """Integration method on the split basis, see `method.Method`.

    Raises
    ------
    SimulationError
        Eigenvectors that are nearly dependent, or a step too coarse for the couplings.
    """

    stages = (1.0,)

    def __init__(self, system: System, output_dofs: np.ndarray, step: float) -> None:
        split = split_basis(system)
        self._drives, self._shared, self._split = system.drives, split.shared, split
        self._common, self._own = _stepped(split, step)
        p, c = split.shared.shape
        lonely = p > c  # else the patterns are all that the drives can do
        self.states = sum(len(part.linear.H) for part in split.common) + lonely * p * len(split.own.linear.H)
        arrays = _arrays(split, self._common, self._own)
        refuse_coarse(
            lambda shorter: _mesh_gain(system, _arrays(split, *_stepped(split, shorter))),
            step,
            _mesh_gain(system, arrays),
        )
        self._arrays = _both(arrays, _arrays(split, *_stepped(split, step / SUBSTEPS)))
        self.forced = self._arrays.forced[0]
        self._state, self._room = _still(self._arrays), _room(self._arrays)
        self._wanted = np.array(
            [i for i, dofs in enumerate(self._drives.dofs) if lonely and np.isin(dofs, output_dofs).any()],
            dtype=np.intp,
        )
        self.output = self._outputs(output_dofs)
        self.tail = len(self.output) - 2 * self._arrays.transfer.shape[2]

    def _outputs(self, dofs: np.ndarray) -> np.ndarray:
        """Matrix from a row of the record: common states, g in the patterns, wanted drives' states and g, u."""
        c = self._shared.shape[1]
        pairs = self._arrays.transfer.shape[2]
        size = 2 * pairs
        common = np.zeros((size + 2 * PATTERNS, 2 * len(dofs)))
        inputs = np.zeros((INPUTS, 2 * len(dofs)))
        for part, stepped, places in zip(self._split.common, self._common, _pair_places(self._common), strict=True):
            by_state, by_coupling, by_input = _observed(stepped, part, part.shapes[dofs])
            half, pair = np.divmod(places, pairs)
            common[2 * pair + half] = by_state  # a record holds the two states of a pair side by side
            common[size + _pattern_places(part, c, 1)] += by_coupling
            inputs[part.inputs] += by_input
        rows = [common]
        for i in self._wanted:
            places, found = np.nonzero(self._drives.dofs[i][:, None] == dofs)
            shapes = np.zeros((len(dofs), self._split.own.shapes.shape[1]))
            shapes[found] = (self._drives.turns[i].T @ self._split.own.shapes)[places]
            rows += _observed(self._own, self._split.own, shapes)[:2]
        return np.vstack([*rows, inputs])

    def begin(self, displacement: np.ndarray, velocity: np.ndarray, excess: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Stand at a displacement and velocity with the couplings' excess a step before and now."""
        drives, shared = self._drives, self._shared
        self._state = state = _still(self._arrays)
        motion = np.array([displacement, velocity])
        for part, stepped, places in zip(self._split.common, self._common, _pair_places(self._common), strict=True):
            state.common.flat[places] = stepped.inverse @ (motion @ part.project.T).ravel()
        own = np.einsum("ide,tie->tid", drives.turns, motion[:, drives.dofs])
        own -= np.einsum("ia,ja,tjd->tid", shared, shared, own)
        coordinates = np.einsum("md,tid->tmi", self._split.own.project, own).reshape(-1, len(shared))
        state.own[:, : len(shared)] = self._own.inverse @ coordinates
        g = excess.reshape(2, 2, -1)
        together = g @ self._arrays.shared.T
        state.excess[:2] = g
        state.patterns[:2] = together.transpose(0, 2, 1).reshape(2, -1)
        state.alone[:2] = g - together @ self._arrays.shared
        state.held[:] = held
        state.touch[: len(shared)] = 1.0  # the motors hold the meshes on the drive flank
        state.touch[self._arrays.shared.shape[1] :][: len(shared)] = 1.0
        wanted = np.vstack([state.own, state.alone[1]])[:, self._wanted]
        return np.concatenate([state.common.T.ravel(), state.patterns[1], wanted.T.ravel()])

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
        return int(
            advance(self._arrays, laws, held, inputs, forced, self._state, self._room, self._wanted, record, force)
        )


class _Stepped:
    """A part in its eigenvectors, over a step; s states, i inputs, k couplings.

    Attributes
    ----------
    vectors, inverse : (s, s') and (s', s) ndarray
        Between states and pairs, the latter padded to a number that fills registers.
    transfer : (4, s'/2) ndarray
        Action on the pairs.
    load : (s', 2i), push : (s', 3k) ndarray
        What u at the end and now, and g before, now and at the end, add to the pairs.
    observe : (2k, s') ndarray
        Deflections and rates of the couplings from the pairs.
    """

    def __init__(self, part: Part, step: float, multiple: int) -> None:
        linear = part.linear
        basis = eigenbasis(linear.H)
        inputs = np.linalg.solve(basis.vectors, linear.E) if len(linear.H) else linear.E
        loads, couplings = np.split(inputs, [len(part.inputs)], axis=1)
        responses = [scalar_responses(values, step) for values in basis.values]
        transfer, now, end, *pushes = (as_pairs(basis, np.array(pair)) for pair in zip(*responses, strict=True))
        pad = -(len(linear.H) // 2) % multiple

        def padded(columns: np.ndarray) -> np.ndarray:
            """Rows of pairs (2m, c) to (2m', c)."""
            a, b = np.split(columns, 2)
            idle = np.zeros((pad, columns.shape[1]))
            return np.vstack([a, idle, b, idle])

        self.vectors = padded(basis.vectors.T).T
        self.inverse = padded(np.linalg.inv(basis.vectors) if len(linear.H) else basis.vectors)
        self.transfer = np.hstack([transfer, np.zeros((4, pad))])
        self.load = padded(np.hstack([act(action, loads) for action in (end, now)]))
        self.push = padded(np.hstack([act(action, couplings) for action in pushes]))
        self.observe = linear.observe @ self.vectors


def _stepped(split: SplitBasis, step: float) -> tuple[list[_Stepped], _Stepped]:
    """Bring the common parts and a drive's own over a step."""
    return [_Stepped(part, step, _PAIRS) for part in split.common], _Stepped(split.own, step, 1)


def _observed(stepped: _Stepped, part: Part, shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement and acceleration along shapes (o, m) from pairs (s', 2o), from g (k, 2o) and from u (i, 2o)."""
    m = shapes.shape[1]
    by_states, by_inputs, by_couplings = np.split(
        shapes @ part.linear.acceleration, [2 * m, 2 * m + len(part.inputs)], axis=1
    )
    return (
        np.vstack([shapes @ stepped.vectors[:m], by_states @ stepped.vectors]).T,
        np.vstack([np.zeros_like(by_couplings), by_couplings]).T,
        np.vstack([np.zeros_like(by_inputs), by_inputs]).T,
    )


def _pattern_places(part: Part, patterns: int, times: int) -> np.ndarray:
    """Places (times · k,) of a part's couplings in an order by pattern, then time, then kind."""
    kind, pattern = np.divmod(part.couplings, patterns)
    return np.concatenate([(pattern * times + t) * 2 + kind for t in range(times)])


def _pair_places(common: list[_Stepped]) -> list[np.ndarray]:
    """Places of each part's states when the first of all pairs stand before the second ones."""
    sizes = [stepped.transfer.shape[1] for stepped in common]
    firsts = np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1])
    return [np.concatenate([places, sum(sizes) + places]) for places in firsts]


def _arrays(split: SplitBasis, common: list[_Stepped], own: _Stepped) -> Arrays:
    p, c = split.shared.shape
    places = _pair_places(common)
    pairs = sum(len(found) for found in places) // 2
    push, observe, forced = (np.zeros((rows, 2 * pairs)) for rows in (6 * PATTERNS, 4 * PATTERNS, 2 * INPUTS))
    couple = np.zeros((4 * PATTERNS, 2 * PATTERNS))
    spans = np.zeros((PATTERNS, 2), dtype=np.intp)
    for part, stepped, found in zip(split.common, common, places, strict=True):
        motions, ends = _pattern_places(part, c, 2), _pattern_places(part, c, 1)
        observe[np.ix_(motions, found)] = stepped.observe
        push[np.ix_(_pattern_places(part, c, 3), found)] = stepped.push.T
        forced[np.ix_(np.concatenate([part.inputs, INPUTS + part.inputs]), found)] = stepped.load.T
        couple[np.ix_(motions, ends)] = stepped.observe @ stepped.push[:, 2 * len(ends) :]
        for pattern in np.unique(part.couplings % c):
            low, high = spans[pattern] if spans[pattern, 1] else (found[0], 0)
            spans[pattern] = min(low, found[0]), max(high, found[0] + stepped.transfer.shape[1])
    own_couple = own.observe @ own.push[:, 4:]

    def by_pattern(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        groups = rows.reshape(PATTERNS, -1, 2, pairs)
        first, second, third = (group[:, :, low:high].copy() for group, (low, high) in zip(groups, spans, strict=True))
        return first, second, third

    shared = widened(split.shared.T, p)
    return Arrays(
        spans=spans,
        transfer=np.hstack([stepped.transfer for stepped in common]),
        observe=by_pattern(observe),
        push=by_pattern(push),
        # What is left of the patterns' couplings when every drive answers the whole of g as its own part does.
        couple=couple - np.kron(np.eye(PATTERNS), own_couple),
        own_transfer=own.transfer,
        own_push=own.push,
        own_observe=own.observe,
        own_couple=own_couple,
        shared=np.vstack([shared, np.zeros((PATTERNS - c, shared.shape[1]))]),
        forced=forced,
    )


def _both(whole: Arrays, part: Arrays) -> Arrays:
    """Arrays of a whole step, and for what depends on its length those of a part beside them."""

    def pair(name: str) -> np.ndarray:
        return aligned.copy(np.array([getattr(whole, name), getattr(part, name)]))

    first, second, third = (aligned.copy(np.array(both)) for both in zip(whole.push, part.push, strict=True))
    observe0, observe1, observe2 = (aligned.copy(rows) for rows in whole.observe)
    return Arrays(
        spans=whole.spans,
        transfer=pair("transfer"),
        observe=(observe0, observe1, observe2),
        push=(first, second, third),
        couple=pair("couple"),
        own_transfer=pair("own_transfer"),
        own_push=pair("own_push"),
        own_observe=aligned.copy(whole.own_observe),
        own_couple=pair("own_couple"),
        shared=aligned.copy(whole.shared),
        forced=pair("forced"),
    )


def _mesh_gain(system: System, arrays: Arrays) -> np.ndarray:
    """How the excess of open meshes at the end of a step comes back on itself, for the patterns and a drive alone."""
    k = system.drives.shared.shape[1]
    law = np.array([system.couplings.stiffness[0], 0.0, system.couplings.damping[0], 0.0])
    alone = law @ arrays.own_couple[:, 0]
    together = np.einsum("q,aqbk->abk", law, arrays.couple.reshape(PATTERNS, 4, PATTERNS, 2))[:k, :k, 0]
    return np.asarray(scipy.linalg.block_diag(together + alone * np.eye(k), alone))


def _still(arrays: Arrays) -> State:
    """State of no motion."""
    lanes, n = arrays.shared.shape[1], arrays.own_push.shape[1]
    return State(
        common=aligned.zeros(2, arrays.transfer.shape[2]),
        own=aligned.zeros(n, lanes),
        excess=aligned.zeros(3, 2, lanes),
        patterns=aligned.zeros(3, 2 * PATTERNS),
        alone=aligned.zeros(3, 2, lanes),
        touch=aligned.zeros(2 * lanes),
        held=aligned.zeros(3, 2 * lanes),
    )


def _room(arrays: Arrays) -> Room:
    pairs, lanes, n = arrays.transfer.shape[2], arrays.shared.shape[1], arrays.own_push.shape[1]
    return Room(
        moved=aligned.zeros(2, pairs),
        own=aligned.zeros(n, lanes),
        free=aligned.zeros(4, lanes),
        motion=aligned.zeros(4, lanes),
        free_pattern=aligned.zeros(4 * PATTERNS),
        pattern=aligned.zeros(4 * PATTERNS),
        force=aligned.zeros(2 * lanes),
        touch=aligned.zeros(2 * lanes),
        held=aligned.zeros(1, 3, 2 * lanes),
        forced=aligned.zeros(1, 2 * pairs),
    )
