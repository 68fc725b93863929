"""When a number agrees with the paper's: hand-made cases, the ends of every tolerance among them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tbm_gsa.paper.reproduction import verdict
from tbm_gsa.paper.reproduction.result import Row, count_verdicts
from tbm_gsa.paper.reproduction.sensitivity import spearman
from tbm_gsa.sensitivity.study.curves import Curve


def _means(agrees):
    return "agrees" if agrees else "differs"


@pytest.mark.parametrize(
    ("paper", "ours", "agrees"),
    [
        *((1.10, 1.10, True), (1.10, 1.265, True), (1.10, 0.935, True), (1.10, 1.266, False), (1.10, 0.934, False)),
        *((0.04, 0.046, True), (0.04, 0.047, False), (0.56, 0.0, False), (0.56, -0.56, False)),
    ],
)
def test_levels_agree_within_fifteen_percent(paper, ours, agrees):
    assert verdict.level(paper, ours) == _means(agrees)


@pytest.mark.parametrize(
    ("paper", "ours", "agrees"),
    [(0.8, 0.65, True), (0.8, 0.95, True), (0.8, 0.649, False), (0.6, 0.751, False), (1.0, 0.85, True)],
)
def test_shares_agree_within_fifteen_hundredths(paper, ours, agrees):
    assert verdict.share(paper, ours) == _means(agrees)


@pytest.mark.parametrize(
    ("paper", "ours", "agrees"),
    [(0.970, 0.965, True), (0.970, 0.9649, False), (0.752, 0.999, True), (0.9, -3.0, False)],
)
def test_r2_may_be_five_thousandths_lower(paper, ours, agrees):
    assert verdict.r_squared(paper, ours) == _means(agrees)


@pytest.mark.parametrize(
    ("ours", "agrees"), [(130.3, True), (130.8, True), (129.8, True), (130.81, False), (129.79, False), (None, False)]
)
def test_lines_agree_within_half_a_hertz(ours, agrees):
    assert verdict.line(130.3, ours) == _means(agrees)


@pytest.mark.parametrize(("ours", "agrees"), [(0.9, True), (1.05, True), (0.899, False), (1.051, False), (1.0, True)])
def test_first_indices_sum_to_almost_one(ours, agrees):
    assert verdict.first_sum(ours) == _means(agrees)


def test_what_is_greater_than_a_limit_is_not_the_limit():
    assert verdict.above(0.8, 0.8) == "differs"
    assert verdict.above(0.8, 0.801) == "agrees"
    assert verdict.between((125.0, 135.0), 125.0) == verdict.between((125.0, 135.0), 135.0) == "agrees"
    assert verdict.between((125.0, 135.0), 124.9) == verdict.between((125.0, 135.0), None) == "differs"


FIVE = ("x3", "x16", "x18", "x19", "x22")


@pytest.mark.parametrize(
    ("paper", "ranked", "agrees"),
    [
        (FIVE, ("x22", "x1", "x16", "x2", "x3", "x18", "x19"), True),
        (FIVE, ("x22", "x1", "x16", "x2", "x4", "x3", "x18"), False),  # the third comes sixth
        (("x2",), ("x2", "x1", "x3", "x4", "x5"), True),
        (("x2",), ("x1", "x2", "x3", "x4", "x5"), False),  # a single one must be the first
    ],
)
def test_three_of_five_main_parameters(paper, ranked, agrees):
    assert verdict.main_parameters(paper, ranked) == _means(agrees)


@pytest.mark.parametrize(
    ("response", "rises"),
    [([1.0, 2.0, 4.0, 8.0], 1.0), ([8.0, 4.0, 2.0, 1.0], -1.0), ([1.0, 1.0, 1.0, 1.0], 0.0)],
)
def test_trends_follow_the_sign_of_spearman(response, rises):
    rho = spearman(Curve("x2", np.arange(4.0), np.array(response)))
    assert rho == pytest.approx(rises)
    assert verdict.trend(1, rho) == _means(rises > 0.0)
    assert verdict.trend(-1, rho) == _means(rises < 0.0)


def test_a_trend_is_judged_by_its_ranks_not_its_ends():
    # Ends where it began, but falls nearly everywhere: Spearman's ρ by hand from Σd² = 20, n = 5: 1 − 6·20/120 = 0.
    assert spearman(Curve("x2", np.arange(5.0), np.array([4.0, 3.0, 2.0, 1.0, 5.0]))) == pytest.approx(0.0)
    assert verdict.trend(1, 0.0) == verdict.trend(-1, 0.0) == "differs"
    assert verdict.trend(1, float("nan")) == "differs"


def test_a_decay_falls_from_each_point_to_the_next():
    assert verdict.falling((1.1, 0.25, 0.04)) == "agrees"
    assert verdict.falling((1.1, 0.04, 0.25)) == verdict.falling((1.1, 1.1, 0.1)) == "differs"


@given(paper=st.floats(0.01, 10.0), ours=st.floats(-10.0, 10.0))
def test_neither_a_fit_nor_an_input_is_ever_an_agreement(paper, ours):
    plain = verdict.level(paper, ours)
    assert verdict.fitted(plain, True) == ("calibrated" if plain == "agrees" else "differs")
    assert verdict.fitted(plain, False) == plain
    assert {verdict.echoed(True), verdict.echoed(False)} == {"given", "differs"}


def test_a_row_has_a_difference_where_both_are_numbers():
    row = Row("table2.a", "level", 1.10, 1.00, "agrees", unit="g")
    assert row.difference == pytest.approx(-0.10)
    assert row.source == "Table 2"
    assert Row("table2.b", "line", 130.3, None, "differs").difference is None
    assert Row("figure2.c", "parts", "three", 3.0, "given").difference is None
    assert count_verdicts([row, row]) == {"agrees": 2, "differs": 0, "given": 0, "calibrated": 0, "no number": 0}
