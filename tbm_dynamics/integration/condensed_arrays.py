"""The arrays that `condensed` hands to its compiled step: what is constant, where a run stands, and room to work."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

PATTERNS = 3
"""Places for the patterns of the drives: 1, cos and sin; idle ones are zero."""


class Arrays(NamedTuple):
    """Constant arrays of a step; M pairs of the common parts, n states of an own part, drives in L lanes.

    What depends on the length of the step stands twice, for a whole step and for a part of one. Motions are of 4 kinds:
    deflection of mesh and of gearbox, rate of mesh and of gearbox. g is of 2 kinds, the excess of mesh and of gearbox.
    Rows and columns of patterns go by pattern, then time, then kind. A pattern acts on w of the pairs only, those of
    the part that holds it.

    Attributes
    ----------
    spans : (3, 2) ndarray of int
        Pairs from and to which each pattern acts.
    transfer : (2, 4, M) ndarray
        Action on the pairs of the common parts.
    observe : tuple of 3 (4, 2, w) ndarray
        Motions in a pattern from the pairs.
    push : tuple of 3 (2, 6, 2, w) ndarray
        What g in a pattern, a step before, now and at the end, adds to the pairs at the end.
    couple : (2, 12, 6 …) ndarray
        What g at the end adds to the motions beyond what `own_couple` adds to every drive; idle columns at the end.
    own_transfer : (2, 4, n/2), own_push : (2, n, 6) ndarray
        The same for the own part of every drive.
    own_observe : (4, n) ndarray
        Motions of a drive beyond the patterns from its states.
    own_couple : (2, 4, 2) ndarray
        What g at the end adds to them.
    shared : (3, L) ndarray
        The patterns.
    forced : (2, 14, 2M) ndarray
        What u at the end and u now add to the pairs.
    """

    spans: np.ndarray
    transfer: np.ndarray
    observe: tuple[np.ndarray, np.ndarray, np.ndarray]
    push: tuple[np.ndarray, np.ndarray, np.ndarray]
    couple: np.ndarray
    own_transfer: np.ndarray
    own_push: np.ndarray
    own_observe: np.ndarray
    own_couple: np.ndarray
    shared: np.ndarray
    forced: np.ndarray


class State(NamedTuple):
    """Where a run stands; g a step before, now, and room for it at the end of the next.

    Attributes
    ----------
    common : (2, M) ndarray
        Pairs of the common parts.
    own : (n, L) ndarray
        States of the drives' own parts.
    excess : (3, 2, L) ndarray
        g of every coupling.
    patterns : (3, 6) ndarray
        The same in the patterns.
    alone : (3, 2, L) ndarray
        The same of the drives beyond the patterns.
    touch : (2L,) ndarray
        1 on the drive flank, 0 open, −1 on the back flank.
    held : (3, 2L) ndarray
        What was held of the couplings now.
    """

    common: np.ndarray
    own: np.ndarray
    excess: np.ndarray
    patterns: np.ndarray
    alone: np.ndarray
    touch: np.ndarray
    held: np.ndarray


class Room(NamedTuple):
    """Where a step puts what it computes, before it becomes the state.

    Attributes
    ----------
    moved : (2, M) ndarray
        Pairs of the common parts.
    own : (n, L) ndarray
        Own parts without their g at the end.
    free, motion : (4, L) ndarray
        Motions of every drive beyond the patterns without g at the end, and all of them.
    free_pattern, pattern : (12,) ndarray
        Motions in the patterns without g at the end, and all of them.
    force, touch : (2L,) ndarray
        Of the couplings at the end.
    held : (1, 3, 2L) ndarray
        What is held of them there.
    forced : (1, 2M) ndarray
        What the inputs add in a part of a step.
    """

    moved: np.ndarray
    own: np.ndarray
    free: np.ndarray
    motion: np.ndarray
    free_pattern: np.ndarray
    pattern: np.ndarray
    force: np.ndarray
    touch: np.ndarray
    held: np.ndarray
    forced: np.ndarray
