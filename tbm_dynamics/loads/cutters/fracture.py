"""Loading and chipping of the rock under a disc: a sawtooth whose teeth have random lengths and heights.

The force ramps up until a chip breaks out and drops within a share of the tooth. Teeth follow each other along the way
of a disc (angle of the head) or in time. The k-th chip breaks near the k-th point of a regular lattice, so any segment
can be computed by itself: its numbers are hashed from seed, disc and k alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from tbm_dynamics.loads.cutters.description import Fracture
from tbm_dynamics.loads.noise import hashed_generator
from tbm_msgs_py.base.arrays import Array

_HASHED = 256
"""Chips whose numbers come from one generator."""


class Teeth(NamedTuple):
    """Chips of n discs around a segment, in cycles of the lattice.

    Attributes
    ----------
    first : (n,) ndarray of int
        Number of the first chip of each.
    place, height : (n, k) ndarray
        Of the chips, less `first`; of the teeth that they end.
    """

    first: np.ndarray
    place: np.ndarray
    height: np.ndarray


def teeth(fracture: Fracture, seed: int, low: Array, high: Array) -> Teeth:
    """Chips of discs that go through cycles from low (n,) to high (n,)."""
    first = np.floor(low).astype(np.int64) - 1
    count = int(np.max(np.floor(high) - first)) + 3
    drawn = np.array([_numbers(seed, disc, int(start), count) for disc, start in enumerate(first)])
    smallest, largest = fracture.heights
    return Teeth(
        first=first,
        place=np.arange(count) + fracture.jitter * (drawn[:, 0] - 0.5),
        height=smallest + (largest - smallest) * drawn[:, 1],
    )


def _numbers(seed: int, disc: int, start: int, count: int) -> Array:
    """Two numbers in 0 to 1 of each of the chips `start` on, (2, count)."""
    low, high = start // _HASHED, (start + count - 1) // _HASHED
    blocks = [hashed_generator(seed, f"chips/{disc}", block).random((2, _HASHED)) for block in range(low, high + 1)]
    return np.hstack(blocks)[:, start - low * _HASHED :][:, :count]


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def fluctuation(cycles: float, disc: int, teeth: Teeth, release: float) -> float:
    """Force of a disc over its mean, less 1, at a place in cycles within the segment."""
    whole = np.floor(cycles)
    at = cycles - whole
    k = int(whole) - teeth.first[disc]
    # Chip k lies within half a cycle of its lattice point.
    if k + at < teeth.place[disc, k]:
        k -= 1
    elif k + at >= teeth.place[disc, k + 1]:
        k += 1
    begin, end = teeth.place[disc, k], teeth.place[disc, k + 1]
    share = (whole - teeth.first[disc] + at - begin) / (end - begin)
    height, following = teeth.height[disc, k], teeth.height[disc, k + 1]
    if share < 1.0 - release:
        return float(height * (2.0 * share / (1.0 - release) - 1.0))
    drop = 0.5 * (1.0 - np.cos(np.pi * (share - 1.0 + release) / release))
    return float(height - drop * (height + following))
