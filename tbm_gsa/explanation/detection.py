"""How large a change must be to be found in normal statistics, while others move them too.

Statistics y = y₀ + s δ + Jᵀ θ + ε have the slopes s over a change δ and J over nuisances θ with a normal prior, and
normal chance ε. With the nuisances marginalised the covariance is Σ = C + σ² Jᵀ J, the Fisher information on δ is
sᵀ Σ⁻¹ s, and the most powerful test of δ = 0 is the standardised z = sᵀ Σ⁻¹ (y − y₀) / (sᵀ Σ⁻¹ s)^½. Where several
changes are tested at once, the limit on the largest |z| is that of their joint law (Hothorn, Bretz and Westfall,
"Simultaneous inference in general parametric models", Biometrical Journal 50 (2008) 346–363).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import scipy.linalg
import scipy.special

from tbm_msgs_py.base.arrays import Array

_DRAWS = 20_000
_FELT = 1e-9  # standard deviations of the statistics, of a change by a factor of e: below it is rounding


@dataclass(frozen=True, eq=False)
class Detection:
    """What normal statistics say of changes; n changes, u statistics.

    Attributes
    ----------
    moves : ndarray, shape (n, u)
        Statistics over each change, in independent standard deviations.
    """

    moves: Array

    @classmethod
    def of(cls, slopes: Array, chance: Array, nuisances: Array, sigma: float) -> Self:
        """Return that of slopes (n, u) with chance of the covariance (u, u) and nuisances of the slopes (m, u).

        `sigma` is the standard deviation of the nuisances beforehand.
        """
        factor = scipy.linalg.cholesky(chance + sigma**2 * nuisances.T @ nuisances, lower=True)
        return cls(scipy.linalg.solve_triangular(factor, slopes.T, lower=True).T)

    @cached_property
    def information(self) -> Array:
        """Fisher information on each change alone, (n,)."""
        found = np.square(self.moves).sum(axis=1)
        return np.asarray(np.where(found > _FELT**2, found, 0.0))

    @property
    def correlation(self) -> Array:
        """Cosine between what two changes do, (n, n): ±1 if they cannot be told apart; 0 of one that does nothing."""
        units = self._units
        return np.asarray(units @ units.T)

    @cached_property
    def _units(self) -> Array:
        sizes = np.sqrt(self.information)[:, None]
        return np.asarray(np.divide(self.moves, sizes, out=np.zeros_like(self.moves), where=sizes > 0.0))

    def limit(self, false_rate: float) -> float:
        """Return what the largest |z| exceeds at a rate where nothing has changed."""
        draws = np.random.default_rng(0).standard_normal((_DRAWS, self.moves.shape[1]))
        return float(np.quantile(np.abs(draws @ self._units.T).max(axis=1, initial=0.0), 1.0 - false_rate))

    def smallest(self, false_rate: float, probability: float) -> Array:
        """Smallest changes (n,) found with a probability at a rate of false findings; infinite if they do nothing."""
        needed = self.limit(false_rate) + scipy.special.ndtri(probability)
        with np.errstate(divide="ignore"):
            return np.asarray(needed / np.sqrt(self.information))

    def bits(self, prior: Array) -> float:
        """Return the information on all changes together, with normal priors of the standard deviations (n,).

        The expected gain of a Bayesian D-optimal design (Chaloner and Verdinelli, "Bayesian experimental design: a
        review", Statistical Science 10 (1995) 273–304).
        """
        scaled = prior[:, None] * self.moves
        return float(0.5 * np.linalg.slogdet(np.eye(len(scaled)) + scaled @ scaled.T)[1] / np.log(2.0))
