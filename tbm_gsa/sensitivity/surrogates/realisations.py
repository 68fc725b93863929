"""What samples share that were simulated under the same realisation of the loads: an effect of its own, taken off.

A peak is larger under a harsher realisation whatever the machine. Where a few realisations are shared out among the
samples, that part of chance can be told from what the inputs do, and need not be noise to the surrogate:
y(x, s) = f(x) + b_s + ε, on the scale on which the surrogate is fitted.
"""

from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import chi2

from tbm_gsa.sensitivity.surrogates.expansion import gaussian_kernel
from tbm_gsa.sensitivity.surrogates.likelihood import Correlation, maximum_likelihood
from tbm_msgs_py.base.arrays import Array, Integers

CONFIDENCE: Final = 0.95
ROUNDS: Final = 2
"""Of process and effects in turn; a third changes indices in the fourth digit."""


@dataclass(frozen=True)
class ChanceShare:
    """Sobol indices of the loads' realisation as an input of its own, on the scale on which the surrogate is fitted.

    Parameters
    ----------
    first : float
        What it explains by itself: what it adds whatever the machine.
    first_interval : tuple of 2 floats
        95 %, of χ² over the realisations.
    total : float
        With all its interactions, at most: what the surrogate does not follow for another reason is in it, too.
    """

    first: float
    first_interval: tuple[float, float]
    total: float


@dataclass(frozen=True, eq=False)
class RealisationEffects:
    """Effects of realisations on an output, as random effects beside a Gaussian process of the inputs [1]_.

    Parameters
    ----------
    labels : ndarray of int, shape (n,)
        Realisation of every sample, from 0 on.
    values : ndarray, shape (k,)
        Effect of each, of mean 0, in the unit of the fitted scale. Best linear unbiased prediction: the estimate by
        generalised least squares, drawn towards 0 by what of its variance is the error of estimation.
    spread : float
        Variance of the estimates over the realisations.
    error : float
        Of it, what is the error of estimation.
    process : Correlation
        Of the inputs' part, whose rates and nugget the effects of a part of the samples are found with.

    References
    ----------
    .. [1] G. K. Robinson, "That BLUP is a good thing: the estimation of random effects", Statistical Science 6 (1991)
       15–32.
    """

    labels: Integers
    values: Array
    spread: float
    error: float
    process: Correlation

    @classmethod
    def fit(cls, unit: Array, values: Array, labels: Integers) -> Self:
        """Fit effects to inputs (n, d) in the unit cube, an output (n,) on its fitted scale, and realisations (n,)."""
        found = cls(labels, np.zeros(labels.max() + 1), 0.0, 0.0, _process(unit, values))
        for _ in range(ROUNDS):
            found = replace(found, process=_process(unit, values - found.on(labels)))._estimated(unit, values)
        return found

    def on(self, labels: Integers) -> Array:
        """Effects on samples of given realisations, (m,); 0 where nothing is known of one."""
        return np.append(self.values, 0.0)[np.minimum(labels, len(self.values))]

    def share(self, variance: float, unexplained: float) -> "ChanceShare":
        """Share of chance in an output.

        Parameters
        ----------
        variance : float
            Of the samples without the effects, on the fitted scale.
        unexplained : float
            Mean square of what the surrogate misses of held-out samples, on the fitted scale.
        """
        degrees = max(1, len(self.values) - 1)
        tails = chi2.ppf([0.5 + 0.5 * CONFIDENCE, 0.5 - 0.5 * CONFIDENCE], degrees)
        effect, *ends = np.maximum(self.spread * np.array([1.0, *(degrees / tails)]) - self.error, 0.0)
        low, high = (float(end / (end + variance)) for end in ends)
        whole = effect + variance
        return ChanceShare(float(effect / whole), (low, high), min(1.0, float((effect + unexplained) / whole)))

    def subset(self, rows: Integers, unit: Array, values: Array) -> Self:
        """Effects as some of the samples alone show them: nothing of the others is left in them."""
        return replace(self, labels=self.labels[rows])._estimated(unit, values)

    def _estimated(self, unit: Array, values: Array) -> Self:
        """Estimate the effects from samples under the present process."""
        theta, nugget = self.process.theta, self.process.nugget
        factor = cho_factor(gaussian_kernel(unit, unit, theta) + nugget * np.eye(len(unit)), lower=True)
        there = np.unique(self.labels)
        members = (self.labels[:, None] == there).astype(float)
        weighted = cho_solve(factor, members)
        covariance = np.linalg.inv(members.T @ weighted)
        estimates = covariance @ (weighted.T @ values)
        residuals = values - members @ estimates
        variance = float(residuals @ cho_solve(factor, residuals)) / max(1, len(values) - len(there))
        centred = np.eye(len(there)) - 1.0 / len(there)
        estimates = centred @ estimates
        error = variance * float(np.trace(centred @ covariance)) / max(1, len(there) - 1)
        spread = float(estimates @ estimates) / max(1, len(there) - 1)
        effects = np.zeros(len(self.values))
        effects[there] = estimates * (max(0.0, 1.0 - error / spread) if spread > 0.0 else 0.0)
        return replace(self, values=effects, spread=spread, error=error)


def _process(unit: Array, values: Array) -> Correlation:
    """Fit the process of an output of any size and spread."""
    return maximum_likelihood(unit, (values - values.mean()) / values.std())
