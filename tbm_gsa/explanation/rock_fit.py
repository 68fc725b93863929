"""What of a set of band powers the loads can be, whatever their level, and what is left for the machine.

About the most likely factors of the loads the logarithms of the powers are linear: a small difference d of them from
what the machine gives leaves the residual R d, R = I − J (Jᵀ W J + S⁻¹)⁻¹ Jᵀ W, with the slopes J of the loads'
logarithms, the weights W of the powers and the prior covariance S of the factors. What the loads can do, R takes out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from tbm_dynamics.loads.description import LoadFactors
from tbm_gsa.explanation.load_posterior import MODEL_ERROR, MODULATION_ERROR
from tbm_gsa.explanation.load_scatter import LoadScatter, of_logarithms
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

_ROUNDS, _SETTLED = 30, (0.1, 1e-3)
_LONGEST = 1.0  # step of a logarithm
_LEAST_VARIANCE = 1e-9
LEARNT_NOISE_ERROR = 0.3
"""Standard deviation of the logarithm of a sensor's noise density that was learnt from the sensor itself."""


@dataclass(frozen=True, eq=False)
class RockFit:
    """Band powers of one span of time about the most likely level of the loads; r groups, k statistics, s sources.

    Attributes
    ----------
    log_factors : ndarray, shape (r,)
    covariance : ndarray, shape (r, r)
        Of these.
    residual : ndarray, shape (k,)
        Logarithms of the measured over the expected band powers; 0 of one that was not measured.
    left : ndarray, shape (k, k)
        R: what a difference of the logarithms leaves in the residual.
    slope : ndarray, shape (k, r)
        J.
    chance : ndarray, shape (k, k)
        Covariance of the logarithms over realisations of the loads.
    shares : ndarray, shape (s, k)
        Of the groups of loads, without what the meshes move; of that; of the meshes; of the sensors' noise.
    """

    log_factors: Array
    covariance: Array
    residual: Array
    left: Array
    slope: Array
    chance: Array
    shares: Array


@dataclass(frozen=True, eq=False)
class RockModel:
    """The machine as it was commissioned.

    Attributes
    ----------
    scatter : LoadScatter
    prior : LoadFactors
        Medians, all positive, and the standard deviation of the logarithms.
    noise : ndarray, shape (k,)
        One-sided density of the noise of each statistic's sensor, m²/s⁴/Hz.
    duration_s : float
        Time that the band powers are of.
    coverage : ndarray, shape (k,), or None
        Share of it that each statistic's sensor has; None: all.
    """

    scatter: LoadScatter
    prior: LoadFactors
    noise: Array
    duration_s: float
    coverage: Array | None = None

    @property
    def error(self) -> Array:
        """Standard deviations (s,) of the logarithms of the sources of power, as `RockFit.shares` has them."""
        groups = len(self.scatter.transfer.gain)
        return np.array([*(groups * [MODEL_ERROR]), MODULATION_ERROR, MODEL_ERROR, LEARNT_NOISE_ERROR])

    def fit(self, log_powers: Array, offset: Array) -> RockFit:
        """Fit the level of the loads.

        Parameters
        ----------
        log_powers : ndarray, shape (k,)
            Of (m/s²)²; NaN of one that was not measured.
        offset : ndarray, shape (k,)
            Of the machine from its model.

        Raises
        ------
        InputError
            No band power that was measured.
        """
        used = np.isfinite(log_powers)
        if not used.any():
            raise InputError("no band power that was measured: nothing can be said of loads or machine")
        target = np.where(used, log_powers - offset, 0.0)
        middle, precision = np.log(self.prior.values), np.eye(len(self.prior.values)) / self.prior.log_sigma**2
        theta = middle
        for settled in _SETTLED:  # the weights of the prior's median find the level well enough for its own
            law = self._first if theta is middle else self._law(theta)
            weight = law.weight(used)
            for _ in range(_ROUNDS):
                expected, slope, _ = self._at(theta)
                residual = np.where(used, target - expected - law.shift, 0.0)
                weighted = slope.T @ weight
                step = weighted @ residual - precision @ (theta - middle)
                move = np.linalg.solve(weighted @ slope + precision, step)
                theta = theta + move * min(1.0, _LONGEST / max(float(np.abs(move).max()), 1e-12))
                if np.abs(move).max() < settled:
                    break
        expected, slope, shares = self._at(theta)
        residual = np.where(used, target - expected - law.shift, 0.0)
        covariance: Array = np.asarray(np.linalg.inv(slope.T @ weight @ slope + precision), dtype=np.float64)
        left = (np.eye(len(used)) - slope @ covariance @ slope.T @ weight) * np.outer(used, used)
        return RockFit(theta, covariance, np.asarray(residual), left, slope, law.chance, shares)

    def expected(self, fit: RockFit) -> Array:
        """Logarithms (k,) of the band powers of the machine as it was commissioned, at the level of a fit."""
        return self._at(fit.log_factors)[0]

    def _at(self, theta: Array) -> tuple[Array, Array, Array]:
        """Logarithms (k,) of the expected powers, their slopes (k, r) and the shares (s, k) of the sources."""
        transfer, squares = self.scatter.transfer, np.exp(2.0 * theta)
        groups, noise = squares[:, None] * transfer.gain, self.scatter.width * self.noise
        powers = groups.sum(axis=0) + transfer.meshes + noise
        moved = squares @ transfer.modulated
        direct = squares[:, None] * (transfer.gain - transfer.modulated)
        shares = np.vstack([direct, moved, transfer.meshes, noise]) / powers
        return np.log(powers), 2.0 * (groups / powers).T, shares

    @cached_property
    def _first(self) -> _Law:
        return self._law(np.log(self.prior.values))

    def _law(self, theta: Array) -> _Law:
        chance, shift = of_logarithms(
            self.scatter.covariance(np.exp(theta), self.noise, self.duration_s, self.coverage)
        )
        _, _, shares = self._at(theta)
        wrong = np.square(self.error) @ np.square(shares) + _LEAST_VARIANCE
        return _Law(chance, shift, wrong)


@dataclass(frozen=True, eq=False)
class _Law:
    """Logarithms of band powers at a level of the loads.

    Attributes
    ----------
    chance : ndarray, shape (k, k)
        Covariance.
    shift : ndarray, shape (k,)
        Mean over the logarithm of the powers' mean.
    wrong : ndarray, shape (k,)
        Variance by the error of the model.
    """

    chance: Array
    shift: Array
    wrong: Array

    def weight(self, used: NDArray[np.bool_]) -> Array:
        """Inverse of the covariance of the statistics that are used (k,), 0 of the others, (k, k)."""
        weight, within = np.zeros_like(self.chance), np.ix_(used, used)
        weight[within] = scipy.linalg.inv(self.chance[within] + np.diag(self.wrong[used]))
        return weight
