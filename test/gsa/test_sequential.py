"""The sequential test for a change of the machine: its run lengths, what it does not see, and what it must find.

Sources: run lengths of EWMA and multivariate EWMA charts while nothing has changed,

| p | λ | limit h | run length | from |
| --- | --- | --- | --- | --- |
| 1 | .5; .05 | 2² | 26.45; 127.53 | Crowder, Technometrics 29 (1987), table 1 |
| 1 | .5; .03 | 3.071²; 2.437² | 500 | Lucas and Saccucci, Technometrics 32 (1990), table 3 |
| 2, 4, 10, 20 | .1 | 8.64, 12.73, 22.67, 37.01 | 200 | Prabhu and Runger, J. Qual. Technol. 29 (1997) |
| 3 | .25, .2, .15, .1, .05 | 15.82, 15.62, 15.31, 14.76, 13.60 | 1000 | Knoth, J. Qual. Technol. 49 (2017), table 2 |

and draws from the law of a machine whose band powers add.
"""

from dataclasses import replace

import numpy as np
import pytest
import scipy.stats
from added_powers import COUNT, GROUPS, added_powers, of_sensors, spans
from numpy.random import default_rng

from tbm_gsa.explanation.machine_state import CauseGrid, MachineState
from tbm_gsa.explanation.run_length import chart_limit, even_squares, run_length
from tbm_gsa.explanation.sensor_fault import sensor_fault
from tbm_gsa.explanation.sequential import LEAST_SPANS, MachineChart, commission
from tbm_gsa.sensitivity.study.distributions import Uniform
from tbm_gsa.sensitivity.study.inputs import Input
from tbm_msgs_py.base.errors import InputError

PUBLISHED = [
    (1, 0.5, 2.0**2, 26.45),
    (1, 0.05, 2.0**2, 127.53),
    (1, 0.5, 3.071**2, 500.0),
    (1, 0.03, 2.437**2, 500.0),
    (2, 0.1, 8.64, 200.0),
    (4, 0.1, 12.73, 200.0),
    (10, 0.1, 22.67, 200.0),
    (20, 0.1, 37.01, 200.0),
    (3, 0.25, 15.82, 1000.0),
    (3, 0.2, 15.62, 1000.0),
    (3, 0.15, 15.31, 1000.0),
    (3, 0.1, 14.76, 1000.0),
    (3, 0.05, 13.60, 1000.0),
]


@pytest.mark.parametrize(("dimension", "weight", "limit", "published"), PUBLISHED)
def test_run_lengths_and_limits_are_those_published(dimension, weight, limit, published):
    assert run_length(limit, dimension, weight) == pytest.approx(published, rel=0.006)
    assert chart_limit(published, dimension, weight) == pytest.approx(limit, abs=0.02)


def test_a_weight_of_one_is_a_chi_square_test():
    assert 1.0 / run_length(20.0, 7, 1.0) == pytest.approx(scipy.stats.chi2.sf(20.0, 7), rel=1e-6)


def test_a_weighted_sum_of_squares_keeps_mean_and_variance():
    weights = np.array([1.0, 0.5, 0.1])
    scale, freedom = even_squares(weights.sum(), np.square(weights).sum())
    assert scale * freedom == pytest.approx(weights.sum())
    assert 2.0 * scale**2 * freedom == pytest.approx(2.0 * np.square(weights).sum())


@pytest.mark.parametrize("wrong", [(0.0, 2, 0.1), (5.0, 0, 0.1), (5.0, 2, 0.0), (5.0, 2, 1.1)])
def test_a_chart_without_sense_is_refused(wrong):
    with pytest.raises(InputError, match="a chart needs limit > 0"):
        run_length(*wrong)
    with pytest.raises(InputError, match="run length above 1"):
        chart_limit(1.0, 2, 0.1)


@pytest.fixture(scope="module")
def model():
    return added_powers()


@pytest.fixture(scope="module")
def baseline(model):
    return commission(model, list(spans(model, 80)))


def distances(model, baseline, rows, length=500.0):
    chart = MachineChart(model, baseline, length)
    points = [chart.update(row) for row in rows]
    return np.array([point.distance for point in points]), np.array([point.limit for point in points])


def test_the_rock_may_change_as_it_likes(model, baseline):
    """A factor of two up in one group, down in another, from one minute to the next, and no alarm."""
    factors = np.array([2.0, 0.5, 1.0, 2.0, 0.5, 1.0])
    rows = np.vstack([spans(model, 60, 1), spans(model, 60, 2, factors)])
    found, limit = distances(model, baseline, rows, 43_200.0)
    assert (found < limit).all()


@pytest.mark.parametrize("size", [1.3, 1.0 / 1.3, 1e3, 1e-3])
def test_a_change_is_found_up_and_down_alike(model, baseline, size):
    """Of one band at one place, while the rock walks."""
    rows = spans(model, 60, 3)
    rows[:, 4] += 2.0 * np.log(size)
    found, limit = distances(model, baseline, rows, 43_200.0)
    first = int(np.argmax(found > limit))
    assert found[-1] > limit[-1]
    assert first < (30 if abs(np.log(size)) < 1.0 else 1)


def test_the_offset_of_the_machine_from_its_model_is_learnt(model):
    """A constant beside the model, in the baseline and after it, changes nothing."""
    away = 0.3 * default_rng(9).standard_normal(COUNT)
    same = commission(model, list(spans(model, 60, 4) + away))
    found, limit = distances(model, same, spans(model, 40, 5) + away, 43_200.0)
    assert (found < limit).all()
    assert same.error[0] > 0.1  # and its model is trusted less where the rock changes


def test_a_baseline_of_few_spans_is_trusted_less(model, baseline):
    charts = [MachineChart(model, replace(baseline, spans=count), 500.0) for count in (LEAST_SPANS, 120)]
    for chart in charts:
        for row in spans(model, 5, 6):
            chart.update(row)
    assert (np.diag(charts[0].covariance) > np.diag(charts[1].covariance)).all()


def test_the_stated_run_length_is_kept(model, baseline):
    """A limit of 15 spans; fewer alarms are right, for errors of model and baseline widen it."""
    found, limit = distances(model, baseline, spans(model, 150, 7, np.ones(GROUPS)), 15.0)
    over = found > limit
    rises = int(np.count_nonzero(over[1:] & ~over[:-1]) + over[0])
    assert rises <= 16  # of 10 expected, Poisson


def test_a_band_that_is_missing_is_left_out(model, baseline):
    """Not measured for a while, it neither counts nor holds up the others."""
    rows = spans(model, 40, 8)
    rows[:, 2] = np.nan
    found, limit = distances(model, baseline, rows)
    assert np.isfinite(found).all()
    assert (found < limit).mean() > 0.9
    with pytest.raises(InputError, match="no band power that was measured"):
        MachineChart(model, baseline, 500.0).update(np.full(COUNT, np.nan))


def test_a_baseline_of_too_little_is_refused(model):
    with pytest.raises(InputError, match=f"allowed: at least {LEAST_SPANS}"):
        commission(model, list(spans(model, LEAST_SPANS - 1)))
    rows = spans(model, LEAST_SPANS)
    rows[:, 1] = np.nan
    with pytest.raises(InputError, match="every band power in some span"):
        commission(model, list(rows))


@pytest.mark.parametrize(
    ("shift", "kind", "gain"),
    [
        ([2.0 * np.log(1.2)] * 3, "gain", 1.2),
        ([2.0 * np.log(1000.0)] * 3, "gain", 1000.0),
        ([2.0 * np.log(0.001)] * 3, "dead", 0.001),
        ([1.5, 0.0, 0.2], "noise", None),
        ([0.6, -0.6, 0.0], None, None),
    ],
)
def test_a_fault_of_one_sensor_is_called_that(model, shift, kind, gain):
    """Two bands that move against each other are the machine."""
    sensors = of_sensors(model)
    baseline = commission(sensors, list(spans(sensors, 40, 10)))
    rows = spans(sensors, 6, 11)
    rows[:, 3:6] += shift
    found = sensor_fault(sensors, baseline, list(rows))
    assert (found and (found.kind, found.point, found.axes)) == (kind and (kind, "p1", ("x",)))
    if gain:
        assert found.gain == pytest.approx(gain, rel=0.1)
        assert found.low < found.gain < found.high


def test_a_change_at_two_sensors_is_no_sensor_s(model):
    sensors = of_sensors(model)
    baseline = commission(sensors, list(spans(sensors, 40, 10)))
    rows = spans(sensors, 6, 12)
    rows[:, [4, 7]] += 1.0
    assert sensor_fault(sensors, baseline, list(rows)) is None
    with pytest.raises(InputError, match="no span of time"):
        sensor_fault(sensors, baseline, [])


@pytest.mark.parametrize(("true", "found"), [(0.7, "b"), (1.3, "b"), (None, None)])
def test_the_input_that_has_changed_is_named_with_its_value(model, baseline, true, found):
    """Three inputs: the first scales one band, the second another with its square, the third nothing."""
    transfer, unit = model.scatter.transfer, np.linspace(0.0, 1.0, 21)
    values = 0.5 + unit
    gain = np.tile(transfer.gain, (3, len(unit), 1, 1))
    gain[0, :, :, 2] *= values[:, None]
    gain[1, :, :, 5] *= np.square(values)[:, None]
    inputs = tuple(Input(code, code, code, "", "multiplier", 1.0, Uniform(0.5, 1.5)) for code in "abc")
    grid = CauseGrid(inputs, gain, np.tile(transfer.meshes, (3, len(unit), 1)))
    chart = MachineChart(model, baseline, 500.0)
    state = MachineState(model, grid, chart)
    rows = spans(model, 60, 13)
    if true is not None:
        rows[:, 5] += 2.0 * np.log(true)
    for row in rows:
        state.add(chart.update(row).fit)
    states = {one.name: one for one in state.inputs()}
    assert states["c"].value == pytest.approx(1.0)  # not seen: it keeps its prior
    assert (states["c"].low, states["c"].high) == (pytest.approx(0.55), pytest.approx(1.45))
    if found is None:
        assert sum(one.probability for one in states.values()) < 0.5
    else:
        assert states[found].probability > 0.95
        assert states[found].low < true < states[found].high
        assert states[found].high - states[found].low < 0.3
