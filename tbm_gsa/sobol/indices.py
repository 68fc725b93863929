"""What an analysis of variance returns."""

from dataclasses import dataclass

from tbm_gsa.arrays import Array


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """First and total Sobol indices of one output, all inputs uniform and independent.

    Parameters
    ----------
    first, total : ndarray, shape (d,)
        Share of the variance an input explains alone, and with all its interactions.
    mean, variance : float
        Of the output, in its unit and its unit squared.
    first_interval, total_interval : ndarray, shape (d, 2), or None
        Lower and upper ends; what they contain is said by the function that made them.
    evaluations : int
        Evaluations of the function that were spent; 0 in closed form.
    """

    first: Array
    total: Array
    mean: float
    variance: float
    first_interval: Array | None = None
    total_interval: Array | None = None
    evaluations: int = 0
