"""The slow copies for live display: the same in any chunks, and free of aliases.

Source: scipy's `sosfilt` over the whole signal, and the response of a Butterworth low-pass |H|² = 1/(1 + (f/fc)¹²).
Chunks give the same bits; levels are held to 1 % because the record is finite.
"""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tbm_dynamics.streaming.sensors import LiveFilter

RATE, STRIDE = 10_000.0, 200  # 50 Hz out, corner 20 Hz


def run(values, first=0, stride=STRIDE, cuts=()):
    slow, actual = LiveFilter(RATE, stride), []
    edges = [0, *sorted(cuts), len(values)]
    for a, b in pairwise(edges):
        if b > a:
            actual += slow.process(first + a, values[a:b])
    return actual


@settings(max_examples=40)
@given(first=st.integers(0, 10**9), cuts=st.sets(st.integers(1, 999), max_size=10), stride=st.sampled_from([1, 7, 200]))
def test_any_chunks_give_the_same_bits(first, cuts, stride):
    values = np.random.default_rng(1).standard_normal((1000, 3))
    whole, pieces = run(values, first, stride), run(values, first, stride, cuts)
    assert [step for step, _ in pieces] == [step for step, _ in whole]
    assert all(np.array_equal(a, b) for (_, a), (_, b) in zip(whole, pieces, strict=True))
    assert all(step % stride == 0 for step, _ in whole)
    assert len(whole) in {1000 // stride, 1000 // stride + 1}


def test_without_a_stride_nothing_is_filtered():
    values = np.random.default_rng(1).standard_normal((50, 2))
    assert np.array_equal([row for _, row in run(values, stride=1)], values)


@pytest.mark.parametrize("frequency", [2.0, 20.0, 60.0, 1050.0])
def test_what_is_too_fast_is_gone(frequency):
    time = np.arange(100_000) / RATE
    values = np.sqrt(2.0) * np.sin(2 * np.pi * frequency * time)[:, None]
    slow = np.array([row[0] for step, row in run(values) if step > 20_000])
    # The corner of the digital filter is warped, so frequencies well below the rate.
    expected = 1.0 / np.sqrt(1.0 + (frequency / 20.0) ** 12)
    level = np.sqrt(np.mean(slow**2)) if frequency != 20.0 else np.abs(slow).max() / np.sqrt(2.0)
    assert level == pytest.approx(expected, rel=0.01, abs=1e-3)


def test_it_starts_as_if_the_first_value_had_always_been_there():
    assert np.array([row for _, row in run(np.full((1000, 2), 7.0))]) == pytest.approx(np.full((5, 2), 7.0), rel=1e-9)
