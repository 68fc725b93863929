"""Where the simulations of a study are made: first designs, and points added to them.

Every design is made on the unit cube and mapped through the distributions of the inputs.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy  # its parts load on first use

from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.hypercube import extend_hypercube, spread_out
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_msgs_py.base.arrays import Array


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

    Returns
    -------
    Design
    """
    if train < 1 or test < 0:
        raise StudyError(f"{train} training and {test} test points, allowed: at least 1 and at least 0")
    check_kind(kind)
    points = KINDS[kind](train, len(inputs), _stream(seed, 0))
    return Design(inputs.from_unit(points), inputs.from_unit(_random(test, len(inputs), _stream(seed, 1))))


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


def _stream(seed: int, number: int) -> np.random.SeedSequence:
    """Return the numbered child of a seed."""
    return np.random.SeedSequence(seed, spawn_key=(number,))


def _random(count: int, axes: int, stream: np.random.SeedSequence) -> Array:
    return _hypercube(count, axes, stream)


def _discrepancy(count: int, axes: int, stream: np.random.SeedSequence) -> Array:
    return _hypercube(count, axes, stream, optimization="random-cd")


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
    "lhs": _random,
    "lhs-discrepancy": _discrepancy,
    "lhs-maximin": _maximin,
    "sobol": _sobol,
}
