"""All inputs at once: their joint posterior, sampled by an ensemble of walkers.

Goodman and Weare, "Ensemble samplers with affine invariance", Communications in Applied Mathematics and Computational
Science 5 (2010) 65–80, as emcee has it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import emcee
import numpy as np

from tbm_gsa.explanation.causes import Misfit
from tbm_msgs_py.base.arrays import Array

WALKERS_AN_INPUT: Final = 3
STEPS: Final = 900
BURNT: Final = 300


@dataclass(frozen=True, eq=False)
class JointPosterior:
    """Samples of the posterior.

    Attributes
    ----------
    samples : ndarray, shape (n, d)
        In the unit cube.
    accepted : float
        Share of accepted steps.
    effective : float
        Independent samples among them, of the slowest input.
    best : ndarray, shape (d,)
        The most probable of them.
    """

    samples: Array
    accepted: float
    effective: float
    best: Array


def joint_posterior(predict: Callable[[Array], Array], nominal: Array, misfit: Misfit, seed: int) -> JointPosterior:
    """Sample the posterior of all inputs, uniform in the unit cube beforehand.

    Parameters as those of `rank_causes`.
    """

    def log_posterior(points: Array) -> Array:
        inside = ((points >= 0.0) & (points <= 1.0)).all(axis=1)
        values = np.full(len(points), -np.inf)
        if inside.any():
            values[inside] = misfit.log_likelihood(predict(points[inside]))
        return values

    walkers = WALKERS_AN_INPUT * len(nominal)
    generator = np.random.default_rng(seed)
    # Around where the machine stands, over most of the ranges: a posterior with one maximum is reached from anywhere.
    start = np.clip(nominal + 0.2 * generator.standard_normal((walkers, len(nominal))), 0.02, 0.98)
    sampler = emcee.EnsembleSampler(walkers, len(nominal), log_posterior, vectorize=True)
    sampler.random_state = np.random.RandomState(seed).get_state()
    sampler.run_mcmc(start, STEPS, skip_initial_state_check=True)
    length = float(np.max(sampler.get_autocorr_time(discard=BURNT, tol=0)))
    samples: Array = sampler.get_chain(discard=BURNT, flat=True)
    best = samples[np.argmax(sampler.get_log_prob(discard=BURNT, flat=True))]
    return JointPosterior(samples, float(np.mean(sampler.acceptance_fraction)), len(samples) / max(length, 1.0), best)
