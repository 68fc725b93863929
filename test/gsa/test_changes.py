"""Where a series of levels changes: the best cut of all, and seldom one where nothing changes."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.covariance import LedoitWolf

from tbm_gsa.signals.changes import _best_cut, changes


@settings(max_examples=20)
@given(st.integers(0, 2**31), st.integers(1, 4), st.integers(2, 5))
def test_the_cut_saves_most_of_all(seed, statistics, shortest):
    values = np.random.default_rng(seed).standard_normal((17, statistics))
    steps = np.diff(values, axis=0)
    covariance = LedoitWolf(assume_centered=False).fit(steps / steps.std(axis=0)).covariance_
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    even = (values / steps.std(axis=0)) @ whiten.T

    def left(part):
        return np.square(part - part.mean(axis=0)).sum()

    saved = {cut: left(even) - left(even[:cut]) - left(even[cut:]) for cut in range(shortest, 18 - shortest)}
    place, most = _best_cut(values, shortest)
    assert most == pytest.approx(max(saved.values()))
    assert saved[place] == pytest.approx(most)


def series(rng, count=60, statistics=24, alike=0.5):
    """Statistics that move together in part."""
    common = rng.standard_normal((count, 1))
    return 0.1 * (np.sqrt(1.0 - alike) * rng.standard_normal((count, statistics)) + np.sqrt(alike) * common)


def test_a_series_without_a_change_is_seldom_cut():
    rng = np.random.default_rng(3)
    found = [
        changes(series(rng, 40, 8, alike), 7, together)
        for alike, together in product((0.0, 0.8), (1, 3))
        for _ in range(25)
    ]
    assert sum(map(bool, found)) <= 4  # one expected


def test_neighbours_that_know_of_one_another_stay_together():
    """Levels that wander are cut where each is taken by itself."""
    rng, cut = np.random.default_rng(5), {1: 0, 6: 0}
    for _ in range(8):
        wander = np.cumsum(rng.standard_normal((66, 3)), axis=0)
        slow = wander[6:] - wander[:-6]  # the sum of six steps
        for together in cut:
            cut[together] += bool(changes(slow, 12, together))
    assert cut[1] > 4
    assert cut[6] <= cut[1] / 2


@pytest.mark.parametrize("places", [[30], [15, 40], [8]])
def test_changes_are_found_where_they_are(places):
    values = series(np.random.default_rng(1))
    for number, place in enumerate(places):
        values[place:, number::3] += 0.3  # a third of the statistics, three standard deviations
    found = changes(values, 7)
    assert len(found) == len(places)
    assert np.abs(np.array(found) - places).max() <= 1


def test_what_is_too_short_or_silent_is_not_cut():
    rng = np.random.default_rng(0)
    assert changes(series(rng, count=13), 7) == []
    assert changes(np.zeros((60, 3)), 7) == []
    assert changes(np.zeros((60, 0)), 7) == []
    one = np.concatenate([rng.standard_normal((40, 1)), 9.0 + rng.standard_normal((20, 1))])
    assert changes(np.hstack([one, np.zeros((60, 1))]), 7) == [40]
