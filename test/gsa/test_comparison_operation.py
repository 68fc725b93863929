"""Which windows may be compared while they arrive: the rule of the levels, written down here for single windows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tbm_gsa.comparison.levels import KEPT_NS, TOLERANCE, LiveOperation

SECOND = 1_000_000_000
DRIVEN, STILL = (0.59, 3.0e6, 1.2e7), (0.0, 0.0, 1.2e7)


def driven(*entries):
    operation = LiveOperation()
    for at, point in entries:
        operation.add(round(at * SECOND), point)
    return lambda begin, end: operation.kind(round(begin * SECOND), round(end * SECOND))


def test_nothing_known_is_steady():
    assert driven()(0.0, 2.0) == "steady"


def test_a_standstill_and_the_windows_around_it():
    kind = driven((0.0, DRIVEN), (10.0, STILL), (20.0, DRIVEN))
    assert [kind(begin, begin + 2.0) for begin in (0.0, 8.0, 9.0, 10.0, 18.0, 19.0, 20.0, 90.0)] == [
        "steady",
        "steady",
        "standstill",
        "standstill",
        "standstill",
        "standstill",
        "steady",
        "steady",
    ]


def test_the_first_one_holds_before_itself_too():
    assert driven((10.0, STILL))(0.0, 2.0) == "standstill"


@given(change=st.floats(-0.4, 0.4), which=st.integers(0, 2))
def test_a_change_within_a_window(change, which):
    other = np.array(DRIVEN)
    other[which] *= 1.0 + change
    kind = driven((0.0, DRIVEN), (3.0, other))
    assert kind(2.0, 4.0) == ("steady" if abs(change) <= TOLERANCE else "transient")
    assert kind(3.0, 5.0) == "steady"


def test_stamps_that_jump_back_begin_anew():
    kind = driven((0.0, DRIVEN), (10.0, STILL), (4.0, DRIVEN))
    assert kind(12.0, 14.0) == "steady"


def test_memory_is_bounded():
    operation = LiveOperation()
    for second in range(20_000):
        operation.add(second * SECOND, DRIVEN)
    assert len(operation._stamps) == pytest.approx(KEPT_NS / SECOND, abs=2)
    assert operation.kind(19_000 * SECOND, 19_002 * SECOND) == "steady"


def readings(shape):
    """Operating points each second whose torque follows a shape, (120,)."""
    operation = LiveOperation()
    for second, factor in enumerate(shape):
        operation.add(second * SECOND + SECOND // 3, np.array(DRIVEN) * [1.0, factor, 1.0])
    return operation


@pytest.mark.parametrize(
    ("shape", "steady"),
    [
        (np.ones(120), True),
        (1.0 + 0.3 * (-1.0) ** np.arange(120), True),  # readings scatter, their means do not
        (1.0 + 0.3 * np.random.default_rng(0).standard_normal(120), False),
        (1.0 + 0.6 * np.arange(120) / 120.0, False),
        (np.where(np.arange(120) < 90, 1.0, 1.2), False),
        (np.where(np.arange(120) // 10 == 7, 0.0, 1.0), False),
    ],
)
def test_a_minute_is_steady_if_its_means_of_ten_seconds_are(shape, steady):
    level = readings(shape).level(60 * SECOND, 120 * SECOND)
    if not steady:
        assert level is None
        return
    held = shape[np.floor(np.arange(60.005, 120.0, 0.01) - 1.0 / 3.0).astype(int)]  # a hundred times a second
    np.testing.assert_allclose(level, np.array(DRIVEN) * [1.0, held.mean(), 1.0], rtol=1e-3)


def test_one_operating_point_holds_for_ever_and_none_is_no_level():
    assert not LiveOperation()
    assert LiveOperation().level(0, SECOND) is None
    np.testing.assert_allclose(readings([1.0]).level(-60 * SECOND, 0), DRIVEN)
