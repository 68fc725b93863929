"""Where the simulations of a study are made."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from tbm_gsa.arrays import Array
from tbm_gsa.study.errors import StudyError
from tbm_gsa.study.inputs import InputSet


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


def latin_hypercube(inputs: InputSet, train: int, test: int, seed: int) -> Design:
    """Two independent Latin hypercubes.

    The seeds of the two are derived from one, so that neither design changes with the size of the other.

    Parameters
    ----------
    inputs : InputSet
    train, test : int
        Numbers of points.
    seed : int

    Returns
    -------
    Design
    """
    if train < 1 or test < 0:
        raise StudyError(f"a design needs at least one training point and no negative number, got {train} and {test}")
    streams = np.random.SeedSequence(seed).spawn(2)
    return Design(*(_hypercube(inputs, n, stream) for n, stream in zip((train, test), streams, strict=True)))


def _hypercube(inputs: InputSet, count: int, stream: np.random.SeedSequence) -> Array:
    """Draw a Latin hypercube (count, d) in the units of the inputs."""
    unit = qmc.LatinHypercube(d=len(inputs), seed=np.random.default_rng(stream)).random(count)
    lower, upper = inputs.bounds.T
    points: Array = lower + unit * (upper - lower)
    return points
