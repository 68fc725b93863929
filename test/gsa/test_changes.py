"""Where a series of levels changes: the best cut of all, seldom one where nothing changes, and in a real comparison."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tbm_gsa.signals.changes import _best_cut, changes

SHORTEST = 2


@settings(max_examples=30)
@given(arrays(float, (9, 1), elements=st.integers(-9, 9).map(float)))
def test_no_other_cut_saves_more(values):
    """Of one statistic, whose scale is the scatter of the differences of neighbours."""
    scale = np.var(np.diff(values, axis=0))
    assume(scale > 0.0)
    left = [9 * np.var(values)]
    left += [at * np.var(values[:at]) + (9 - at) * np.var(values[at:]) for at in range(SHORTEST, 8)]
    place, saved = _best_cut(values, SHORTEST)
    assert saved * scale == pytest.approx(left[0] - min(left[1:]), abs=1e-9)
    assert left[1 + place - SHORTEST] == pytest.approx(min(left[1:]), abs=1e-9)


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
