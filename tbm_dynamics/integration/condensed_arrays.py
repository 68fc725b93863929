"""Arrays that `condensed` hands to its compiled step: constants, the state of a run, and the workspace of a step.

The letters in parentheses are those of the equations in `condensed_kernel`. There are M pairs of the symmetric parts, n
states of an individual part, and drives in L lanes. Coupling motion is of 4 kinds: deflection of mesh and of gearbox,
rate of mesh and of gearbox. The residual force is of 2 kinds, of mesh and of gearbox. Rows and columns of the patterns
are ordered by pattern, then time, then kind.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tbm_dynamics.integration.lanes import aligned

PATTERNS = 3
"""Least places P for the patterns of the drives: 1, cos and sin, idle ones zero; a drive with own seats adds one."""

BY_LENGTH = (
    *("transfer", "forced", "push", "shift", "couple", "couple_now"),
    *("own_transfer", "own_push", "own_shift", "own_couple", "own_couple_now", "own_forced"),
)
"""Arrays that depend on the length of a step."""


class Arrays(NamedTuple):
    """Constant arrays of a step; those `BY_LENGTH` hold two, for a whole step and for a substep.

    Attributes
    ----------
    spans : (P, 2) ndarray of unsigned int
        Pairs from and to which each pattern acts: those of the part that holds it.
    transfer : (2, 4, M) ndarray
        Action of a step on the pairs of the symmetric parts (A).
    forced : (2, 14, 2M) ndarray
        What the inputs at the end and at the start add to the pairs (B).
    push : (2, P, 2, 2, M) ndarray
        What the residual in a pattern a step before adds to the pairs (G).
    shift : (2, P, 4, 2, M) ndarray
        What the residual in a pattern a step before and now is in the motion beyond the pairs (P̂, P₊).
    observe : (P, 4, 2, M) ndarray
        Coupling motion of a pattern from the pairs (O).
    couple : (2, 4P, 2P) ndarray
        What the residual at the end adds to the motion of the patterns beyond what it adds to every drive (Q).
    couple_now : (2, 4P, 2P) ndarray
        What the residual now adds to the motion of the patterns at the end (O P̂).
    own_transfer : (2, 4, n/2), own_push : (2, n, 2), own_shift : (2, n, 4) ndarray
    own_observe : (4, n), own_couple, own_couple_now : (2, 4, 2) ndarray
        The same for the individual part of every drive (a, g, p̂ and p₊, o, q, o p̂).
    patterns : (P, L) ndarray
        The patterns (W), orthonormal.
    own_forced : (2, n, 2) ndarray
        What torque at the end and at the start adds to an individual part (b).
    own_torque : (L,) ndarray
        Torque on the individual part of each drive per unit of that on the cutterhead (s°).
    numbers : tuple of P int
        Of the patterns.
    """

    spans: np.ndarray
    transfer: np.ndarray
    forced: np.ndarray
    push: np.ndarray
    shift: np.ndarray
    observe: np.ndarray
    couple: np.ndarray
    couple_now: np.ndarray
    own_transfer: np.ndarray
    own_push: np.ndarray
    own_shift: np.ndarray
    own_observe: np.ndarray
    own_couple: np.ndarray
    own_couple_now: np.ndarray
    patterns: np.ndarray
    own_forced: np.ndarray
    own_torque: np.ndarray
    numbers: tuple[int, ...]


class Workspace(NamedTuple):
    """Arrays in which a step computes; nothing in them lasts beyond it.

    Attributes
    ----------
    symmetric : (2, M), individual : (n, L) ndarray
        States at the end (x₊, y₊).
    predicted_pattern, pattern_motion : (4P,) ndarray
        Coupling motion of the patterns without the residual at the end, and with it (D*, D).
    predicted, motion : (4, L) ndarray
        Coupling motion of every drive, the same (d*, d).
    force, contact_state : (2L,) ndarray
        Of the couplings at the end.
    mesh_inputs : (1, 3, 2L) ndarray
        Of the couplings at the end.
    forced : (1, 2M) ndarray
        What the inputs add to the pairs in a substep.
    """

    symmetric: np.ndarray
    individual: np.ndarray
    predicted_pattern: np.ndarray
    pattern_motion: np.ndarray
    predicted: np.ndarray
    motion: np.ndarray
    force: np.ndarray
    contact_state: np.ndarray
    mesh_inputs: np.ndarray
    forced: np.ndarray


class State(NamedTuple):
    """State of a run between two steps; of three residuals the last is room for that at the end of the next step.

    Attributes
    ----------
    symmetric : (2, M) ndarray
        Pairs of the symmetric parts, less the last two residuals (x).
    individual : (n, L) ndarray
        States of the drives' individual parts, less the last two residuals (y).
    residual : (3, 2, L) ndarray
        Residual force of every coupling a step before, now and at the end (r).
    pattern_residual : (3, 2P) ndarray
        The same in the patterns (R).
    individual_residual : (3, 2, L) ndarray
        The same beyond the patterns (r°).
    contact_state : (2L,) ndarray
        1 on the drive flank, 0 open, −1 on the back flank; always 0 without a gap.
    mesh_inputs : (3, 2L) ndarray
        Of the couplings now.
    workspace : Workspace
    """

    symmetric: np.ndarray
    individual: np.ndarray
    residual: np.ndarray
    pattern_residual: np.ndarray
    individual_residual: np.ndarray
    contact_state: np.ndarray
    mesh_inputs: np.ndarray
    workspace: Workspace


def zero_state(arrays: Arrays) -> State:
    """State without motion and force, with its workspace."""
    pairs, n = arrays.transfer.shape[2], arrays.own_push.shape[1]
    patterns, lanes = arrays.patterns.shape

    def zeros(*shape: int) -> np.ndarray:
        return aligned(np.zeros(shape))

    return State(
        symmetric=zeros(2, pairs),
        individual=zeros(n, lanes),
        residual=zeros(3, 2, lanes),
        pattern_residual=zeros(3, 2 * patterns),
        individual_residual=zeros(3, 2, lanes),
        contact_state=zeros(2 * lanes),
        mesh_inputs=zeros(3, 2 * lanes),
        workspace=Workspace(
            symmetric=zeros(2, pairs),
            individual=zeros(n, lanes),
            predicted_pattern=zeros(4 * patterns),
            pattern_motion=zeros(4 * patterns),
            predicted=zeros(4, lanes),
            motion=zeros(4, lanes),
            force=zeros(2 * lanes),
            contact_state=zeros(2 * lanes),
            mesh_inputs=zeros(1, 3, 2 * lanes),
            forced=zeros(1, 2 * pairs),
        ),
    )
