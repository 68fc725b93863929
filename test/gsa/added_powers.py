"""A machine whose band powers add, and spans of time drawn from its law."""

from dataclasses import replace

import numpy as np
from numpy.random import default_rng

from tbm_dynamics.loads.description import LoadFactors
from tbm_gsa.explanation.band_reading import BandStatistic
from tbm_gsa.explanation.load_scatter import LoadScatter
from tbm_gsa.explanation.load_transfer import LoadTransfer
from tbm_gsa.explanation.rock_fit import RockModel

GROUPS, COUNT, SPAN_S = 6, 12, 60.0


def added_powers():
    """Two statistics a group of loads, a little of the next group in each; scatter of bands of 10 Hz."""
    gain = np.kron(np.eye(GROUPS) + 0.1 * np.roll(np.eye(GROUPS), 1, axis=1), np.ones(2))
    statistics = tuple(BandStatistic("shield", "x", float(low), low + 1.0) for low in range(COUNT))
    transfer = LoadTransfer(statistics, gain, np.zeros_like(gain), np.full(COUNT, 0.01))
    falling = np.zeros((GROUPS + 2, GROUPS + 2, COUNT, COUNT))
    for place in range(COUNT):
        falling[:-2, :-2, place, place] = np.outer(gain[:, place], gain[:, place]) / 10.0
    scatter = LoadScatter(transfer, falling, np.zeros((GROUPS, GROUPS, COUNT, COUNT)), np.ones(COUNT), 4.0)
    return RockModel(scatter, LoadFactors(), np.zeros(COUNT), SPAN_S)


def spans(model, count, seed=0, factors=None):
    """Logarithms of band powers (count, k); the rock walks unless its factors are given."""
    random = default_rng(seed)
    found, logs = [], np.zeros(GROUPS)
    for _ in range(count):
        logs = np.clip(logs + 0.1 * random.standard_normal(GROUPS), -np.log(2.0), np.log(2.0))
        now = np.exp(logs) if factors is None else factors
        chance = np.diag(model.scatter.covariance(now, model.noise, SPAN_S))
        powers = model.scatter.expected(now, model.noise) * random.chisquare(2.0 / chance) * 0.5 * chance
        found.append(np.log(powers))
    return np.array(found)


def of_sensors(model):
    """Four sensors of one axis with three bands each, one group of loads or two in each of them."""
    places = range(COUNT)
    statistics = tuple(BandStatistic(f"p{one // 3}", "x", float(one % 3), one % 3 + 1.0) for one in places)
    gain = np.tile(model.scatter.transfer.gain[:3, ::4], (2, 4)) + 0.05
    transfer = replace(model.scatter.transfer, statistics=statistics, gain=gain, modulated=np.zeros_like(gain))
    falling = np.zeros_like(model.scatter.falling)
    for one in places:
        falling[:-2, :-2, one, one] = np.outer(gain[:, one], gain[:, one]) / 10.0
    return replace(model, scatter=replace(model.scatter, transfer=transfer, falling=falling))
