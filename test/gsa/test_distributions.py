"""Distributions of inputs against closed forms, and the maps between values and the unit cube."""

import math
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tbm_gsa.sensitivity.study.distributions import (
    LogNormal,
    LogUniform,
    Normal,
    Triangular,
    Uniform,
    distribution_from,
)
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS, Input, InputSet

LAWS = (
    Uniform(-2.0, 3.0),
    LogUniform(2e-4, 5e-3),
    Normal(7.5e9, 8.5e9, 8.1e9, 2e8),
    Triangular(0.5, 2.0, 1.0),
    Triangular(0.0, 1.0, 0.0),
    LogNormal(0.25, 8.0, 1.0, 0.7),
)
UNIT = np.linspace(0.0, 1.0, 41)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_maps_are_inverse_and_rise_from_bound_to_bound(law):
    values = law.from_unit(UNIT)
    assert values[0] == pytest.approx(law.lower, rel=1e-12)
    assert values[-1] == pytest.approx(law.upper, rel=1e-12)
    assert (np.diff(values) > 0.0).all()
    np.testing.assert_allclose(law.to_unit(values), UNIT, atol=1e-9)
    assert distribution_from(law.to_dict()) == law


def test_quantiles_have_their_closed_forms():
    np.testing.assert_allclose(LAWS[0].from_unit(UNIT), -2.0 + 5.0 * UNIT, rtol=1e-14)
    np.testing.assert_allclose(LAWS[1].from_unit(UNIT), 2e-4 * 25.0**UNIT, rtol=1e-12)
    standard = NormalDist(8.1e9, 2e8)
    low, high = standard.cdf(7.5e9), standard.cdf(8.5e9)
    expected = [standard.inv_cdf(low + u * (high - low)) for u in UNIT[1:-1]]
    np.testing.assert_allclose(LAWS[2].from_unit(UNIT[1:-1]), expected, rtol=1e-9)
    # Lower branch lower + √(u (b - a)(c - a)), upper branch b - √((1 - u)(b - a)(b - c)).
    assert LAWS[3].from_unit(0.1) == pytest.approx(0.5 + math.sqrt(0.1 * 1.5 * 0.5), rel=1e-12)
    assert LAWS[3].from_unit(0.8) == pytest.approx(2.0 - math.sqrt(0.2 * 1.5 * 1.0), rel=1e-12)
    np.testing.assert_allclose(LAWS[4].from_unit(UNIT), 1.0 - np.sqrt(1.0 - UNIT), atol=1e-12)
    logs = NormalDist(0.0, 0.7)
    low, high = logs.cdf(math.log(0.25)), logs.cdf(math.log(8.0))
    expected = [math.exp(logs.inv_cdf(low + u * (high - low))) for u in UNIT[1:-1]]
    np.testing.assert_allclose(LAWS[5].from_unit(UNIT[1:-1]), expected, rtol=1e-9)


finite = st.floats(-1e6, 1e6)


@settings(max_examples=60)
@given(
    lower=finite,
    width=st.floats(1e-3, 1e6),
    place=st.floats(0.0, 1.0),
    spread=st.floats(0.05, 10.0),
    unit=st.floats(0.0, 1.0),
)
def test_quantiles_stay_inside_and_invert(lower, width, place, spread, unit):
    upper = lower + width
    middle = min(max(lower + place * width, lower), upper)
    for law in (Uniform(lower, upper), Normal(lower, upper, middle, spread * width), Triangular(lower, upper, middle)):
        value = law.from_unit(unit)
        assert lower <= value <= upper
        assert law.to_unit(value) == pytest.approx(unit, abs=1e-6)


def _input(code, law):
    return Input(code, "", "", "", "absolute", law.lower, law)


SET = InputSet(tuple(_input(f"x{k + 1}", law) for k, law in enumerate(LAWS)))


def test_a_set_maps_each_column_by_its_own_distribution():
    unit = np.random.default_rng(0).random((7, len(SET)))
    points = SET.from_unit(unit)
    for column, law in enumerate(LAWS):
        np.testing.assert_array_equal(points[:, column], law.from_unit(unit[:, column]))
    np.testing.assert_allclose(SET.to_unit(points), unit, atol=1e-9)


@pytest.mark.parametrize(("value", "shown"), [(1001.0 + 1500.0, "2501"), (999.0, "999"), (float("nan"), "nan")])
def test_points_outside_the_range_are_refused(value, shown):
    points = np.tile([item.initial for item in PAPER_INPUTS.inputs], (3, 1))
    points[1, 1] = value
    with pytest.raises(StudyError, match=rf"input x2: {shown}, allowed: 1000 to 2500"):
        PAPER_INPUTS.to_unit(points)


@pytest.mark.parametrize("shape", [(3,), (3, 4), (2, 2, 25)])
def test_points_of_another_shape_are_refused(shape):
    with pytest.raises(StudyError, match=r"points of shape .*, allowed: \(n, 25\), one column per input"):
        PAPER_INPUTS.to_unit(np.ones(shape))


@pytest.mark.parametrize("std", [1e-300, 1e300])
def test_a_normal_law_that_no_numbers_hold_is_refused(std):
    with pytest.raises(StudyError, match=r"std 1e.300, allowed: a size that tells values 1000 apart from each other"):
        Normal(1000.0, 2000.0, mean=1500.0, std=std)
    assert Normal(1000.0, 2000.0, mean=1500.0, std=1e6).from_unit(0.25) == pytest.approx(1250.0, rel=1e-3)
