"""Where a series of levels changes: the best cut of all, seldom one where nothing changes, and in a real comparison."""

from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tbm_gsa.signals.changes import _cut, changes

SHORTEST = 2


def left(values, ends):
    """Squares about the mean of each part."""
    return sum(np.square(values[a:b] - values[a:b].mean(axis=0)).sum() for a, b in pairwise(ends))


@settings(max_examples=30)
@given(arrays(float, (9, 2), elements=st.floats(-3.0, 3.0)), st.floats(0.01, 20.0))
def test_no_other_cut_is_cheaper(values, price):
    every = [
        (0, *inner, 9)
        for count in range(4)
        for inner in combinations(range(1, 9), count)
        if min(np.diff((0, *inner, 9))) >= SHORTEST
    ]
    best = min(left(values, ends) + price * (len(ends) - 2) for ends in every)
    found = (0, *_cut(values, SHORTEST, price), 9)
    assert min(np.diff(found)) >= SHORTEST
    assert left(values, found) + price * (len(found) - 2) == pytest.approx(best, abs=1e-9)


def series(rng, count=60, statistics=24, alike=0.5):
    """Statistics that move together in part."""
    common = rng.standard_normal((count, 1))
    return 0.1 * (np.sqrt(1.0 - alike) * rng.standard_normal((count, statistics)) + np.sqrt(alike) * common)


def test_a_series_without_a_change_is_seldom_cut():
    rng = np.random.default_rng(3)
    assert sum(bool(changes(series(rng, alike=alike), 7)) for alike in (0.0, 0.3, 0.8) for _ in range(60)) <= 5


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
