"""Where the simulations of a study are made: first designs, and points added to them.

Every design is made on the unit cube and mapped through the distributions of the inputs.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import scipy  # its parts load on first use

from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_msgs_py.base.arrays import Array

SWAPS: Final = 5000


@dataclass(frozen=True, eq=False)
class Design:
    """Training and test points.

    Parameters
    ----------
    train : ndarray, shape (n, d)
    test : ndarray, shape (m, d)
        In the units of the inputs.
    """

    train: Array
    test: Array


def make_design(inputs: InputSet, train: int, test: int, seed: int, kind: str = "lhs") -> Design:
    """Training points of the kind that is asked for, and test points from a Latin hypercube of its own.

    The seeds of the two are derived from one, so that neither changes with the size of the other.

    Parameters
    ----------
    inputs : InputSet
    train, test : int
        Numbers of points.
    seed : int
    kind : str
        ``lhs``: Latin hypercube, random (scipy's `LatinHypercube`), as in the paper. ``lhs-discrepancy``: the same,
        with scipy's ``optimization="random-cd"``. ``lhs-maximin``: the same, with coordinates swapped until the closest
        points lie far apart (`spread_out`). ``sobol``: scrambled Sobol' sequence (scipy's `Sobol`), best with a power
        of two.
    """
    if train < 1 or test < 0:
        raise StudyError(f"{train} training and {test} test points, allowed: at least 1 and at least 0")
    check_kind(kind)
    points = KINDS[kind](train, len(inputs), _stream(seed, 0))
    return Design(inputs.from_unit(points), inputs.from_unit(_hypercube(test, len(inputs), _stream(seed, 1))))


def add_points(inputs: InputSet, existing: Array, count: int, seed: int, kind: str = "lhs") -> Array:
    """Training points beside existing ones, which are kept.

    A Sobol' sequence goes on where it stopped, so that the whole is the same as if it had been asked for at once; to a
    Latin hypercube of any kind come the points of `extend_hypercube`.

    Parameters
    ----------
    inputs : InputSet
    existing : ndarray, shape (n, d)
        All training points so far, in the units of the inputs.
    count : int
        New points.
    seed, kind
        Of the first design.

    Returns
    -------
    ndarray, shape (count, d)
    """
    if count < 1:
        raise StudyError(f"{count} points to add, allowed: at least 1")
    check_kind(kind)
    if kind == "sobol":
        return inputs.from_unit(_sobol(len(existing) + count, len(inputs), _stream(seed, 0))[len(existing) :])
    # A stream for each size: additions one after the other never share theirs.
    rng = np.random.default_rng(_stream(seed, 2 + len(existing)))
    return inputs.from_unit(extend_hypercube(inputs.to_unit(existing), count, rng))


def check_kind(kind: str) -> None:
    """Raise a StudyError unless there is such a design."""
    if kind not in KINDS:
        raise StudyError(f"unknown design {kind!r}, allowed: {', '.join(KINDS)}")


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


def _stream(seed: int, number: int) -> np.random.SeedSequence:
    """Return the numbered child of a seed."""
    return np.random.SeedSequence(seed, spawn_key=(number,))


def _maximin(count: int, axes: int, stream: np.random.SeedSequence) -> Array:
    rng = np.random.default_rng(stream.spawn(1)[0])
    return spread_out(_hypercube(count, axes, stream), np.empty((0, axes)), rng)


def _hypercube(count: int, axes: int, stream: np.random.SeedSequence, optimization: str | None = None) -> Array:
    """Latin hypercube (count, axes) from scipy."""
    sampler = scipy.stats.qmc.LatinHypercube(d=axes, optimization=optimization, seed=np.random.default_rng(stream))
    points: Array = sampler.random(count)
    return points


def _sobol(count: int, axes: int, stream: np.random.SeedSequence) -> Array:
    """First points (count, axes) of a scrambled sequence; drawn as a power of two, which scipy wants."""
    sampler = scipy.stats.qmc.Sobol(d=axes, scramble=True, seed=np.random.default_rng(stream))
    points: Array = sampler.random_base2((count - 1).bit_length())[:count]
    return points


KINDS: Final[Mapping[str, Callable[[int, int, np.random.SeedSequence], Array]]] = {
    "lhs": _hypercube,
    "lhs-discrepancy": partial(_hypercube, optimization="random-cd"),
    "lhs-maximin": _maximin,
    "sobol": _sobol,
}
