"""All inputs at once: their joint posterior with the level of the loads, sampled by an ensemble of walkers.

Goodman and Weare, "Ensemble samplers with affine invariance", Communications in Applied Mathematics and Computational
Science 5 (2010) 65–80, as emcee has it. Changes of inputs add in the logarithms of powers, each along its own curve.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import emcee
import numpy as np

from tbm_dynamics.loads.description import LoadFactors
from tbm_gsa.explanation.cause_curves import CauseCurves
from tbm_gsa.explanation.judgement import Judgement
from tbm_msgs_py.base.arrays import Array

WALKERS_A_NUMBER: Final = 3
STEPS: Final = 600
_TABLE: Final = 65  # places along an input

Score = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class SeparableCurves:
    """Band powers of a machine with any of its inputs changed; d inputs, r groups of loads, k statistics.

    Attributes
    ----------
    curves : CauseCurves
    logs : ndarray, shape (d, t, r + 1, k)
        Logarithms of the gains and of what the meshes excite at even places of each input, over those as it stands.
    """

    curves: CauseCurves
    logs: Array

    @classmethod
    def of(cls, curves: CauseCurves) -> SeparableCurves:
        """Tabulate curves."""
        before = _parts(curves, *curves.nominal_place)
        places = np.linspace(0.0, 1.0, _TABLE)
        return cls(curves, np.array([[_parts(curves, code, one) - before for one in places] for code in curves.tables]))

    def expected(self, points: Array, factors: Array, noise: Array) -> Array:
        """Band powers (m, k) at points (m, d) of the unit cube and factors (m, r), with the noise densities (k,)."""
        place = points * (_TABLE - 1)
        low = np.minimum(place.astype(int), _TABLE - 2)
        share = (place - low)[..., None, None]
        rows = np.arange(len(self.logs))
        change = ((1.0 - share) * self.logs[rows, low] + share * self.logs[rows, low + 1]).sum(axis=1)
        nominal = self.curves.nominal
        powers = np.einsum("mr,mrk,rk->mk", np.square(factors), np.exp(change[:, :-1]), nominal.transfer.gain)
        return np.asarray(powers + np.exp(change[:, -1]) * nominal.transfer.meshes + nominal.width * noise)


def _parts(curves: CauseCurves, code: str, place: float) -> Array:
    """Logarithms (r + 1, k) of gains and meshes; of nothing that of the least number."""
    transfer = curves.along(code, place).transfer
    return np.log(np.maximum(np.vstack([transfer.gain, transfer.meshes]), np.finfo(float).tiny))


@dataclass(frozen=True, eq=False)
class InputsPosterior:
    """Samples of the posterior of all inputs, the level of the loads marginalised.

    Attributes
    ----------
    units : ndarray, shape (n, d)
        Inputs in the unit cube.
    accepted : float
        Share of accepted steps.
    effective : float
        Independent samples among them, of the slowest number.
    standardised : ndarray, shape (k,)
        What the most probable of them leaves, in standard deviations.
    """

    units: Array
    accepted: float
    effective: float
    standardised: Array


def inputs_posterior(found: Judgement, prior: LoadFactors, steps: int, seed: int) -> InputsPosterior:
    """Sample the inputs, uniform in the unit cube beforehand, and the loads' factors with their prior.

    Chance is that of the finding that was chosen.

    Parameters
    ----------
    found : Judgement
    prior : LoadFactors
    steps : int
        Of every walker; the first third is left out.
    seed : int
    """
    model, chosen = SeparableCurves.of(found.curves), found.chosen.best
    count, size = len(model.logs), prior.log_sigma
    target, noise, middle = np.log(found.bands.powers), found.bands.noise, np.log(prior.values)
    factor = np.linalg.cholesky(np.linalg.inv(chosen.scatter))

    def residual(points: Array) -> Array:
        return np.asarray(target - np.log(model.expected(points[:, :count], np.exp(points[:, count:]), noise)))

    def log_posterior(points: Array) -> Array:
        inside = ((points[:, :count] >= 0.0) & (points[:, :count] <= 1.0)).all(axis=1)
        values = np.full(len(points), -np.inf)
        if inside.any():
            left = residual(points[inside]) @ factor
            away = (points[inside, count:] - middle) / size
            values[inside] = -0.5 * (np.square(left).sum(axis=1) + np.square(away).sum(axis=1))
        return values

    generator = np.random.default_rng(seed)
    walkers = WALKERS_A_NUMBER * (count + len(middle))
    walkers += walkers % 2
    own = found.curves.inputs.to_unit([[item.initial for item in found.curves.inputs.inputs]])[0]
    start = np.hstack(
        [
            # Over most of the ranges: a posterior with one maximum is reached from anywhere.
            np.clip(own + 0.2 * generator.standard_normal((walkers, count)), 0.02, 0.98),
            chosen.log_factors + 0.1 * generator.standard_normal((walkers, len(middle))),
        ]
    )
    samples, logs, sampler = sampled(log_posterior, start, steps, seed)
    length = float(np.max(sampler.get_autocorr_time(discard=steps // 3, tol=0)))
    best = residual(samples[np.argmax(logs)][None])[0]
    return InputsPosterior(
        samples[:, :count],
        float(np.mean(sampler.acceptance_fraction)),
        len(samples) / max(length, 1.0),
        best / np.sqrt(np.diag(chosen.scatter)),
    )


def sampled(log_posterior: Score, start: Array, steps: int, seed: int) -> tuple[Array, Array, emcee.EnsembleSampler]:
    """Return samples (n, d) of a posterior after a third of the steps, their logarithms (n,), and the sampler."""
    sampler = emcee.EnsembleSampler(*start.shape, log_posterior, vectorize=True)
    sampler.random_state = np.random.RandomState(seed).get_state()
    sampler.run_mcmc(start, steps, skip_initial_state_check=True)
    kept = {"discard": steps // 3, "flat": True}
    return sampler.get_chain(**kept), sampler.get_log_prob(**kept), sampler
