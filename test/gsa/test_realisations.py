"""Studies whose simulations share out realisations of the loads.

The stochastic function is y(x, s) = exp(Σ a_k x_k + b_s + ε) or the same sum without exp, x uniform on the unit cube, b
and ε normal. Of the sum the indices are exact: a_k² / 12 of an input, σ_b² of the realisation, σ_ε² of what chance does
to each point in its own way, each over their sum; of the mean response a_k² / Σ a².
"""

import json

import numpy as np
import pytest
from evaluations import analytic
from here import simulations_here, small_samplings

from tbm_dynamics import load_machine, simulate
from tbm_gsa.app.cli.gsa_planning import planned_study
from tbm_gsa.sensitivity.sobol.of_surrogate import sobol_of_surrogate
from tbm_gsa.sensitivity.study.campaign import run_campaign
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS, InputSet
from tbm_gsa.sensitivity.study.problem import StudyProblem, difference
from tbm_gsa.sensitivity.study.run import StudyOptions, report_study
from tbm_gsa.sensitivity.study.store import STORE_NAME, Store
from tbm_gsa.sensitivity.surrogates import fit_surrogate, load_surrogate, save_surrogate
from tbm_msgs_py.base.errors import InputError

SLOPES = np.array([3.0, 2.0, 1.0, 0.0, 0.0])
BOX = [[0.0, 1.0]] * len(SLOPES)
EFFECT, NOISE = 0.5, 0.2
COUNT, REALISATIONS = 200, 20
CODES = ("x2", "x4", "x16")
PROBLEM = StudyProblem(InputSet(tuple(PAPER_INPUTS[code] for code in CODES)), ("force",), 60, 6, 0, realisations=6)


def _drawn(seed):
    generator = np.random.default_rng(seed)
    X, labels = generator.random((COUNT, len(SLOPES))), generator.permutation(np.arange(COUNT) % REALISATIONS)
    effects = EFFECT * generator.standard_normal(REALISATIONS)
    return X, labels, effects, X @ SLOPES + effects[labels] + NOISE * generator.standard_normal(COUNT)


@pytest.mark.parametrize(("transform", "method"), [("none", "krg"), ("none", "prs"), ("log", "krg")])
def test_indices_are_those_of_the_mean_response(transform, method):
    X, labels, effects, sums = _drawn(1)
    y = np.exp(sums) if transform == "log" else sums
    model = fit_surrogate(method, X, y, bounds=BOX, transform=transform, realisations=labels)
    found = model.samples.effects.values
    np.testing.assert_allclose(found, effects - effects.mean(), atol=4.0 * NOISE / np.sqrt(COUNT / REALISATIONS))
    if transform == "none":
        exact = SLOPES**2 / np.sum(SLOPES**2)
        np.testing.assert_allclose(sobol_of_surrogate(model).first, exact, atol=0.02)
        blind = sobol_of_surrogate(fit_surrogate(method, X, y, bounds=BOX)).first
        assert np.abs(sobol_of_surrogate(model).first - exact).max() < np.abs(blind - exact).max()


def test_chance_is_told_with_its_share():
    X, labels, effects, y = _drawn(2)
    model = fit_surrogate("krg", X, y, bounds=BOX, realisations=labels)
    held_out = model.cross_validate(10)
    share = model.samples.effects.share(float(np.var(model.samples.transformed)), held_out.rmse**2)
    whole = np.sum(SLOPES**2) / 12.0 + effects.var() + NOISE**2
    low, high = share.first_interval
    assert low < EFFECT**2 / (np.sum(SLOPES**2) / 12.0 + EFFECT**2 + NOISE**2) < high
    assert share.first == pytest.approx(effects.var() / whole, abs=0.02)
    # At most: beside the noise there is what 180 samples leave open.
    assert (effects.var() + NOISE**2) / whole - 0.01 < share.total < (effects.var() + 2.0 * NOISE**2) / whole


def test_no_effect_is_found_where_there_is_none():
    X, labels, _, y = _drawn(3)
    model = fit_surrogate("krg", X, X @ SLOPES, bounds=BOX, realisations=labels)
    assert np.abs(model.samples.effects.values).max() < 1e-3
    one = fit_surrogate("krg", X, y, bounds=BOX, realisations=np.zeros(COUNT, dtype=int))
    np.testing.assert_array_equal(one.predict(X), fit_surrogate("krg", X, y, bounds=BOX).predict(X))


def test_a_fold_knows_nothing_of_what_it_holds_out():
    X, labels, _, y = _drawn(4)
    model = fit_surrogate("prs", X, y, bounds=BOX, realisations=labels)
    held_out = model.cross_validate(5)
    part = held_out.parts[0]
    changed = y.copy()
    changed[part] += 100.0
    other = fit_surrogate("prs", X, changed, bounds=BOX, realisations=labels)
    # The rates that weight the samples in an effect are found from all of them; nothing else is.
    kept = np.setdiff1d(np.arange(COUNT), part)
    one, two = model.samples.effects, other.samples.effects
    same = type(one)(two.labels, two.values, two.spread, two.error, one.process)
    np.testing.assert_array_equal(
        one.subset(kept, X[kept], y[kept]).values, same.subset(kept, X[kept], changed[kept]).values
    )


def test_points_may_be_repeated_under_other_loads(tmp_path):
    X, _, effects, _ = _drawn(5)
    X = np.repeat(X[:60], 2, axis=0)
    labels = np.arange(120) % 2
    y = X @ SLOPES + effects[labels]
    with pytest.raises(InputError, match="are the same point, y differs; allowed: one value a point"):
        fit_surrogate("krg", X, y, bounds=BOX)
    model = fit_surrogate("krg", X, y, bounds=BOX, realisations=labels)
    save_surrogate(model, tmp_path / "twice.npz")
    np.testing.assert_array_equal(load_surrogate(tmp_path / "twice.npz").predict(X), model.predict(X))
    for wrong in (labels[1:], labels - 1, labels / 2):
        with pytest.raises(InputError, match=r"realisations of shape .*, allowed: 120 whole numbers from 0"):
            fit_surrogate("krg", X, y, bounds=BOX, realisations=wrong)


def test_realisations_are_dealt_out_evenly():
    rows = PROBLEM.realisations_of_rows()
    assert np.bincount(rows[:60]).tolist() == [10] * 6
    assert sorted(rows[60:]) == list(range(6))
    assert (np.diff(rows[:60]) != 1).any(), "not in the order of the design"
    grown = StudyProblem(PROBLEM.inputs, PROBLEM.outputs, 60, 6, 0, added=(20,), realisations=6).realisations_of_rows()
    np.testing.assert_array_equal(grown[:66], rows)
    assert np.bincount(grown[66:]).tolist() == [0] * 6 + [10] * 2, "further ones, in proportion"
    common = StudyProblem(PROBLEM.inputs, PROBLEM.outputs, 60, 6, 0)
    assert difference(common, PROBLEM) == "its loads are common to all, here 6 realisations"
    assert StudyProblem.from_json(PROBLEM.to_json()) == PROBLEM


def _under_loads(sample, realisation):
    force = analytic(sample)["force"]
    return {"force": force * (1.0 + 0.2 * np.random.default_rng(realisation).standard_normal())}


def test_a_study_reports_the_share_of_chance(tmp_path):
    with Store.create_or_open(tmp_path / STORE_NAME, PROBLEM) as store:
        with simulations_here():
            run_campaign(store, _under_loads, workers=1)
        (X, Y), labels = store.results("train"), store.realisations("train")
        expected = [_under_loads(PROBLEM.inputs.sample(x), label)["force"] for x, label in zip(X, labels, strict=True)]
        np.testing.assert_array_equal(Y[:, 0], expected)
    with small_samplings():
        result = report_study(tmp_path, StudyOptions(("prs",), workers=1, quick=True)).result
    force = result.outputs["force"]
    assert force.r2_cv > 0.99, "chance that realisations share is no noise"
    assert force.r2_test > 0.99
    assert 0.0 < force.seed.first_interval[0] < force.seed.first < force.seed.total < 1.0
    assert json.loads((tmp_path / "result.json").read_text())["realisations"] == 6


def test_every_realisation_has_loads_of_its_own():
    evaluate = MachineEvaluation.of("dz101", 0.05, 3)
    sample = {"x2": 2000.0}
    found = [evaluate(sample)["PAcc_A"], *(evaluate(sample, realisation)["PAcc_A"] for realisation in (0, 1, 0))]
    assert len(set(found)) == 3
    assert found[1] == found[3]
    machine = load_machine("dz101").with_inputs(**sample)
    assert found[0] == simulate(machine, 0.05, 3).indicators()["PAcc_A"]
    neighbour = MachineEvaluation.of("dz101", 0.05, 4)
    assert neighbour(sample, 0)["PAcc_A"] != found[2], "a study with the next seed shares none of its loads"


@pytest.mark.parametrize(("samples", "common", "realisations"), [(200, False, 20), (12, False, 2), (200, True, 0)])
def test_a_plan_says_how_many_realisations(samples, common, realisations):
    plan = ("dz101", 3.0, None, None, None, "lhs", (samples, 20), 0, None)
    assert planned_study(*plan, common)[0].realisations == realisations


def test_a_study_with_other_loads_is_refused(tmp_path):
    Store.create_or_open(tmp_path / STORE_NAME, PROBLEM).close()
    common = StudyProblem(PROBLEM.inputs, PROBLEM.outputs, 60, 6, 0)
    with pytest.raises(StudyError, match=r"holds another study \(its loads are 6 realisations, here common to all\)"):
        Store.create_or_open(tmp_path / STORE_NAME, common)
