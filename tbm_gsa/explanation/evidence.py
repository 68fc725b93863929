"""Evidence for hypotheses by quadrature over their place, the loads' level marginalised at each.

The evidence is the mean of the likelihood over the place (Kass and Raftery, "Bayes factors", Journal of the American
Statistical Association 90 (1995) 773–795). Places are added where the likelihood is, until the curve is smooth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.interpolate

from tbm_dynamics.loads.description import LoadFactors
from tbm_gsa.explanation.hypotheses import Hypothesis
from tbm_gsa.explanation.load_posterior import BandObservation, LoadPosterior, load_posterior
from tbm_msgs_py.base.arrays import Array

FIRST_PLACES: Final = 11
LARGEST_STEP: Final = 1.0
"""Of the logarithm of the likelihood from a place to the next; more where the likelihood is small, as its root."""
SMALLEST_CELL: Final = 1.0 / 1024.0
HOPELESS: Final = 50.0
"""Logarithm by which a likelihood may lie below the best known at both ends of a cell that is looked into."""
_MOST, _FINER = 60, 16
QUANTILES: Final = (0.05, 0.5, 0.95)
_REACH: Final = 1.6448536269514722


@dataclass(frozen=True, eq=False)
class Finding:
    """What a recording says of a hypothesis; n places.

    Attributes
    ----------
    hypothesis : Hypothesis
    places : ndarray, shape (n,)
    shares : ndarray, shape (n,)
        Of the posterior probability.
    loads : tuple of LoadPosterior
        At each place.
    log_evidence : float
    quantiles : ndarray, shape (3,)
        Of the place: median between the ends of the 90 % interval.
    """

    hypothesis: Hypothesis
    places: Array
    shares: Array
    loads: tuple[LoadPosterior, ...]
    log_evidence: float
    quantiles: Array

    @property
    def best(self) -> LoadPosterior:
        """Loads at the most likely place."""
        return self.loads[int(np.argmax([one.log_evidence for one in self.loads]))]

    def factors(self) -> tuple[Array, Array]:
        """Medians (r,) of the loads' factors and 90 % intervals (r, 2), the place marginalised."""
        means = np.array([one.log_factors for one in self.loads])
        spread = np.array([np.diag(one.covariance) for one in self.loads])
        middle = self.shares @ means
        reach = _REACH * np.sqrt(self.shares @ (spread + np.square(means - middle)))
        return np.exp(middle), np.exp(middle[:, None] + np.outer(reach, [-1.0, 1.0]))


def find(hypothesis: Hypothesis, observed: BandObservation, prior: LoadFactors, best: float = -np.inf) -> Finding:
    """Weigh a hypothesis by a recording, all of whose statistics are used.

    `best` is the largest logarithm of a likelihood of other hypotheses: what lies far below is not looked at closely.
    """
    used, start = np.arange(len(observed.powers)), None
    known: dict[float, LoadPosterior] = {}

    def log_likelihood(place: float) -> float:
        nonlocal start
        scatter, error = hypothesis.at(place)
        known[place] = load_posterior(observed, scatter, prior, error, used, start)
        start = known[place].log_factors
        return known[place].log_evidence

    places = refined(log_likelihood, best) if hypothesis.places else np.array([0.5])
    logs = np.array([known[place].log_evidence if place in known else log_likelihood(place) for place in places])
    log_evidence, shares, quantiles = integrated(places, logs)
    return Finding(hypothesis, places, shares, tuple(known[place] for place in places), log_evidence, quantiles)


def refined(function: Callable[[float], float], best: float = -np.inf) -> Array:
    """Places (n,) from 0 to 1 between which the logarithm of a likelihood is smooth where it counts.

    It does not where it is hopelessly below the `best` of other hypotheses.
    """
    known = {float(place): function(float(place)) for place in np.linspace(0.0, 1.0, FIRST_PLACES)}
    while len(known) < _MOST:
        places = np.array(sorted(known))
        logs = np.array([known[place] for place in places])
        step, high, top = np.abs(np.diff(logs)), np.maximum(logs[1:], logs[:-1]), logs.max()
        # A peak may hide between the highest place and one of about its height.
        beside = np.isin(np.arange(len(step)), np.argmax(logs) + np.array([-1, 0]))
        step[beside] = step[beside].max()
        cells = np.flatnonzero(
            (step > LARGEST_STEP * np.exp(0.5 * np.minimum(top - high, HOPELESS)))
            & (np.diff(places) > SMALLEST_CELL)
            & (high > best - HOPELESS)
        )
        if not cells.size:
            break
        for cell in cells[np.argsort(-high[cells])][: _MOST - len(known)]:
            middle = float(0.5 * (places[cell] + places[cell + 1]))
            known[middle] = function(middle)
    return np.array(sorted(known))


def integrated(places: Array, logs: Array) -> tuple[float, Array, Array]:
    """Logarithm of the mean of a likelihood over 0 to 1, shares (n,) of its places, and its quantiles (3,)."""
    if len(places) == 1:
        return float(logs[0]), np.ones(1), np.repeat(places, 3)
    top, widths = float(logs.max()), np.diff(places)
    heights = np.exp(logs - top)
    shares = 0.5 * heights * (np.append(widths, 0.0) + np.append(0.0, widths))
    # The logarithm is smooth between places, the likelihood is not.
    fine = np.interp(np.arange(_FINER * len(widths) + 1) / _FINER, np.arange(len(places)), places)
    smooth = np.exp(scipy.interpolate.PchipInterpolator(places, logs)(fine) - top)
    cells = 0.5 * (smooth[1:] + smooth[:-1]) * np.diff(fine)
    cumulative = np.append(0.0, np.cumsum(cells)) / cells.sum()
    return top + float(np.log(cells.sum())), shares / shares.sum(), np.interp(QUANTILES, cumulative, fine)
