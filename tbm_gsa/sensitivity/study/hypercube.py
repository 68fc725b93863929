"""Latin hypercubes on the unit cube: spread out, and extended by points that keep them stratified."""

from typing import Final

import numpy as np
import scipy  # its parts load on first use

from tbm_msgs_py.base.arrays import Array

SWAPS: Final = 5000


def extend_hypercube(existing: Array, count: int, rng: np.random.Generator) -> Array:
    """Points that make the most of a design that is kept.

    Each axis is cut into as many slices as there are points then. New points go into slices that hold none, each into
    another, so every projection has as many slices filled as can be; where a hypercube is doubled (tripled …) that is
    all of them, and the whole is a Latin hypercube again. Which of an axis' slices belong to one point is settled by
    `spread_out`.

    Parameters
    ----------
    existing : ndarray, shape (n, d)
        In [0, 1].
    count : int
        New points.
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (count, d)
    """
    total = len(existing) + count
    points = np.empty((count, existing.shape[1]))
    for axis, column in enumerate(existing.T):
        free = np.setdiff1d(np.arange(total), np.floor(column * total).astype(np.int64))
        points[:, axis] = (rng.choice(free, count, replace=False) + rng.random(count)) / total
    return spread_out(points, existing, rng)


def spread_out(points: Array, fixed: Array, rng: np.random.Generator) -> Array:
    """Enlarge the smallest distance between points (maximin) without leaving their slices.

    Again and again a point of the closest pair swaps one coordinate with another point; a swap that brings neither of
    the two as close to any other is kept. Coordinates only change hands, so all projections onto one axis stay as they
    are.

    Parameters
    ----------
    points : ndarray, shape (n, d)
        May change.
    fixed : ndarray, shape (m, d)
        Keep their places.
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (n, d)
    """
    count, axes = points.shape
    everything = np.vstack([points, fixed])
    distances = scipy.spatial.distance.cdist(points, everything)
    np.fill_diagonal(distances, np.inf)
    if distances.shape[1] < 2 or count < 2:
        return points
    for other, axis in zip(rng.integers(count, size=SWAPS), rng.integers(axes, size=SWAPS), strict=True):
        closest = int(distances.argmin()) // len(everything)
        if other == closest:
            continue
        pair = [closest, int(other)]
        everything[pair, axis] = everything[pair[::-1], axis]
        swapped = scipy.spatial.distance.cdist(everything[pair], everything)
        swapped[[0, 1], pair] = np.inf
        if swapped.min() > distances[closest].min():
            distances[pair] = swapped
            distances[:, pair] = swapped[:, :count].T
        else:
            everything[pair, axis] = everything[pair[::-1], axis]
    return everything[:count]
