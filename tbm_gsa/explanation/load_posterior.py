"""Factors of the loads from the band powers of a recording, for a machine as it stands.

The logarithms of measured band powers are normal about those of P(f) + N with the covariance of chance, which is that
of their χ² laws, and the logarithms of the factors have normal priors. The most likely factors are found by
Gauss–Newton steps; about them the posterior is taken as normal (Laplace's approximation), which also gives the evidence
for the machine (MacKay, "Information Theory, Inference and Learning Algorithms", 2003, chapter 27).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import scipy.linalg
import scipy.special

from tbm_dynamics.loads.description import LoadFactors
from tbm_gsa.explanation.load_scatter import LoadScatter, of_logarithms
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError

MODEL_ERROR = 0.05
"""Standard deviation of a band power's logarithm that the model is wrong by in any case."""
MODULATION_ERROR = 0.7
"""And that times its share in what the meshes move, which is known to the first order only."""
LEAST_OVER_NOISE = 2.0
"""A band power below so many times that of the sensor's noise says nothing."""
DYNAMIC_RANGE = 1e-5
"""Nor does one so much weaker than the strongest band of its channel: leakage rules there."""
NOISE_ERROR = 0.5
"""And that times the share of the sensor's noise, whose density is known or estimated within so much."""
_ROUNDS, _SETTLED = 40, 1e-4
_INTERVAL = 1.6448536269514722  # standard deviations to either end of a 90 % interval


@dataclass(frozen=True, eq=False)
class BandObservation:
    """Band powers of a recording; k statistics.

    Attributes
    ----------
    powers : ndarray, shape (k,)
        (m/s²)².
    noise : ndarray, shape (k,)
        One-sided density of the noise of each statistic's sensor, m²/s⁴/Hz.
    duration_s : float
        Recorded time.
    coverage : ndarray, shape (k,), or None
        Share of it that each statistic's sensor has; None: all.
    """

    powers: Array
    noise: Array
    duration_s: float
    coverage: Array | None = None

    def only(self, places: Integers) -> Self:
        """Of some statistics (u,) alone."""
        coverage = None if self.coverage is None else self.coverage[places]
        return replace(self, powers=self.powers[places], noise=self.noise[places], coverage=coverage)


@dataclass(frozen=True, eq=False)
class LoadPosterior:
    """What is known of the factors of the loads after a recording; r groups, u used statistics.

    Attributes
    ----------
    log_factors : ndarray, shape (r,)
        Most likely logarithms.
    covariance : ndarray, shape (r, r)
        Of these.
    learnt : ndarray, shape (r,)
        Share of the prior's variance that is gone: 0 of a group that the sensors do not see.
    used : ndarray of int, shape (u,)
        Statistics that say something.
    residual : ndarray, shape (u,)
        Logarithms of the measured over the expected band powers.
    scatter : ndarray, shape (u, u)
        Covariance of these if the machine is right.
    log_evidence : float
        Logarithm of the probability of the band powers, all factors considered.
    """

    log_factors: Array
    covariance: Array
    learnt: Array
    used: Integers
    residual: Array
    scatter: Array
    log_evidence: float

    @property
    def factors(self) -> Array:
        """Medians of the factors, (r,)."""
        return np.exp(self.log_factors)

    @property
    def interval(self) -> Array:
        """Ends of the 90 % intervals of the factors, (r, 2)."""
        reach = _INTERVAL * np.sqrt(np.diag(self.covariance))
        return np.exp(self.log_factors[:, None] + np.outer(reach, [-1.0, 1.0]))

    @property
    def standardised(self) -> Array:
        """Residual of each statistic over its standard deviation, (u,)."""
        return np.asarray(self.residual / np.sqrt(np.diag(self.scatter)))

    @cached_property
    def misfit(self) -> float:
        """Squared Mahalanobis length of the residual: χ² with `freedom` degrees of freedom if the machine is right."""
        return float(self.residual @ scipy.linalg.solve(self.scatter, self.residual, assume_a="pos"))

    @property
    def freedom(self) -> float:
        """Statistics that are used less factors that are learnt."""
        return float(len(self.used) - self.learnt.sum())

    @property
    def surprise(self) -> float:
        """Probability of a misfit as large, if the machine is right."""
        return float(scipy.special.gammaincc(0.5 * self.freedom, 0.5 * self.misfit))


def load_posterior(
    observed: BandObservation,
    scatter: LoadScatter,
    prior: LoadFactors,
    model_error: float | Array = MODEL_ERROR,
    used: Integers | None = None,
    start: Array | None = None,
) -> LoadPosterior:
    """Find the factors of the loads that explain band powers, the machine being what it is.

    Parameters
    ----------
    observed : BandObservation
    scatter : LoadScatter
        Of the machine and the reading.
    prior : LoadFactors
        Medians, all positive, and the standard deviation of the logarithms.
    model_error : float or ndarray, shape (k,)
        Standard deviation of a band power's logarithm beside chance.
    used : ndarray of int, shape (u,), optional
        Statistics to use, by default those that say something (`telling`).
    start : ndarray, shape (r,), optional
        Logarithms of factors to begin with, by default those of the prior.

    Raises
    ------
    InputError
        No band power that says anything.
    """
    used = telling(observed, scatter) if used is None else used
    if not used.size:
        raise InputError("no band power above the sensors' noise: nothing can be said of loads or machine")
    middle, size = np.log(prior.values), prior.log_sigma
    target = np.log(observed.powers[used])
    errors = np.broadcast_to(np.asarray(model_error), observed.powers.shape)[used]
    alone = scatter if len(used) == len(observed.powers) else scatter.only(used)
    step = _Step(observed.only(used), alone, errors)
    theta = _most_likely(step, target, middle, size, middle if start is None else start)
    residual, slope, chance = step.at(theta, target)
    covariance = np.linalg.inv(
        slope.T @ scipy.linalg.solve(chance, slope, assume_a="pos") + np.eye(len(theta)) / size**2
    )
    off = residual @ scipy.linalg.solve(chance, residual, assume_a="pos") + np.sum((theta - middle) ** 2) / size**2
    volume = np.linalg.slogdet(chance)[1] + len(target) * np.log(2.0 * np.pi)
    gained = np.linalg.slogdet(covariance / size**2)[1]
    return LoadPosterior(
        log_factors=theta,
        covariance=covariance,
        learnt=1.0 - np.diag(covariance) / size**2,
        used=used,
        residual=residual,
        scatter=chance,
        log_evidence=float(-0.5 * (off + volume - gained)),
    )


def _most_likely(step: _Step, target: Array, middle: Array, size: float, theta: Array) -> Array:
    """Logarithms (r,) of the factors that are most likely, from a guess on.

    A step that turns back on the one before is taken by half from then on: chance depends on the level, too, and a
    level that hardly anything tells would go to and fro for ever.
    """
    before, share = np.zeros_like(theta), 1.0
    for _ in range(_ROUNDS):
        residual, slope, chance = step.at(theta, target)
        weighted = scipy.linalg.solve(chance, slope, assume_a="pos")
        precision = slope.T @ weighted + np.eye(len(theta)) / size**2
        move = np.linalg.solve(precision, weighted.T @ residual - (theta - middle) / size**2)
        if move @ before < 0.0:
            share *= 0.5
        theta = theta + move * min(share, 1.0 / float(np.abs(move).max()))  # a factor of e at most
        if np.abs(move).max() < _SETTLED:
            break
        before = move
    return theta


def telling(observed: BandObservation, scatter: LoadScatter) -> Integers:
    """Statistics above the noise, and within the dynamic range of their channel."""
    channels = [(one.point, one.axis) for one in scatter.transfer.statistics]
    strongest: dict[tuple[str, str], float] = {}
    for channel, power in zip(channels, observed.powers, strict=True):
        strongest[channel] = max(strongest.get(channel, 0.0), float(power))
    range_limit = DYNAMIC_RANGE * np.array([strongest[channel] for channel in channels])
    noise_limit = LEAST_OVER_NOISE * scatter.width * observed.noise
    return np.flatnonzero((observed.powers > noise_limit) & (observed.powers > range_limit))


@dataclass(frozen=True, eq=False)
class _Step:
    """What a Gauss–Newton step needs, of the used statistics alone."""

    observed: BandObservation
    scatter: LoadScatter
    model_error: Array

    def at(self, theta: Array, target: Array) -> tuple[Array, Array, Array]:
        """Residual (u,), slope of the expectation (u, r) and covariance (u, u) at logarithms of factors (r,)."""
        factors, noise = np.exp(theta), self.observed.noise
        powers = self.scatter.expected(factors, noise)
        slope = 2.0 * np.square(factors)[:, None] * self.scatter.transfer.gain / powers
        chance, shift = of_logarithms(
            self.scatter.covariance(factors, noise, self.observed.duration_s, self.observed.coverage)
        )
        moved = np.square(factors) @ self.scatter.transfer.modulated / powers
        noisy = self.scatter.width * noise / powers
        chance += np.diag(
            np.square(self.model_error) + np.square(MODULATION_ERROR * moved) + np.square(NOISE_ERROR * noisy)
        )
        residual = target - np.log(powers) - shift
        return residual, slope.T, chance
