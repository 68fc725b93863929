"""What an analysis of variance returns, and the groups it may be asked about."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

CONFIDENCE: Final = 0.95  # of every interval
# Column numbers of the inputs that are taken together; None takes each input by itself.
Groups: TypeAlias = Sequence[Sequence[int]]


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """First, total and second Sobol indices of one output, all inputs uniform and independent.

    With groups, g stands for the number of groups, and "input" below for a group: its first index is the share that
    its members explain together, interactions among them included.

    Parameters
    ----------
    first, total : ndarray, shape (g,)
        Share of the variance an input explains alone, and with all its interactions.
    mean, variance : float
        Of the output, in its unit and its unit squared.
    first_interval, total_interval : ndarray, shape (g, 2), or None
        Lower and upper ends; what they contain is said by the function that made them.
    second : ndarray, shape (g, g), or None
        Share of the variance that two inputs explain by their interaction; symmetric, zero on the diagonal.
    second_interval : ndarray, shape (g, g, 2), or None
    evaluations : int
        Evaluations of the function that were spent; 0 in closed form.
    """

    first: Array
    total: Array
    mean: float
    variance: float
    first_interval: Array | None = None
    total_interval: Array | None = None
    second: Array | None = None
    second_interval: Array | None = None
    evaluations: int = 0

    @property
    def source(self) -> str:
        """How they were found."""
        return f"sampling, {self.evaluations} evaluations" if self.evaluations else "closed form"


def of_a_constant(count: int, mean: float) -> SobolIndices:
    """Return the indices of what does not vary: all are zero."""
    zeros, ends = np.zeros(count), np.zeros((count, 2))
    return SobolIndices(zeros, zeros, mean, 0.0, ends, ends, np.zeros((count, count)), np.zeros((count, count, 2)))


def checked_groups(groups: Groups | None, inputs: int) -> tuple[tuple[int, ...], ...]:
    """Return groups as tuples; each input by itself if there are none.

    Raises
    ------
    InputError
        An empty group, a column that does not exist, or one that is in two groups.
    """
    if groups is None:
        return tuple((k,) for k in range(inputs))
    checked = tuple(tuple(int(k) for k in group) for group in groups)
    members = [k for group in checked for k in group]
    if not checked or not all(checked):
        raise InputError("a group of no input, allowed: at least one")
    for k in members:
        if not 0 <= k < inputs:
            raise InputError(f"group with input {k}, allowed: 0 to {inputs - 1}")
        if members.count(k) > 1:
            raise InputError(f"input {k} is in more than one group, allowed: one")
    return checked
