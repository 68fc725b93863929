"""A whole study with an analytic evaluation: result, report, resume; and what importing the package loads.

An analysis of two outputs takes two seconds however small the study, and as much again in each process it is shared
with: what can be asked of one study is asked of one, and processes are started where the test is about them.
"""

import csv
import json
import subprocess
import sys

import numpy as np
import pytest
import scipy.special
from evaluations import OUTPUTS, analytic, doubtful, fails_above
from here import pictures_without_layout, simulations_here, small_samplings
from report_pages import check_page, check_widths

from tbm_dynamics import load_machine
from tbm_gsa import fit_surrogate, sobol_closed_form
from tbm_gsa.app.cli.gsa import show_indices
from tbm_gsa.app.report.gsa_page import write_study_report
from tbm_gsa.app.report.page import PageHead, render_page
from tbm_gsa.provenance import machine_sha256
from tbm_gsa.sensitivity.results import StudyResult
from tbm_gsa.sensitivity.study import run, workers
from tbm_gsa.sensitivity.study.errors import StudyCancelled, StudyError
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS, InputSet
from tbm_gsa.sensitivity.study.problem import StudyProblem
from tbm_gsa.sensitivity.study.run import StudyOptions, report_study, resume_study, run_study
from tbm_gsa.sensitivity.study.store import STORE_NAME, Store
from tbm_gsa.sensitivity.study.workers import Outcome

THREE = InputSet(tuple(PAPER_INPUTS[code] for code in ("x2", "x4", "x16")))
SETTINGS = {
    "machine": "dz101",
    "machine_sha256": machine_sha256(load_machine("dz101")),
    "note": "<b>analytic & quick</b>",
}
PROBLEM = StudyProblem(THREE, OUTPUTS, train=40, test=8, seed=0, settings=SETTINGS)
METHODS = ("svr", "krg", "prs")
QUICK = {"second": (), "by_surrogate": {}, "convergence": (), "paths": None, "fast": None, "morris": None}
"""What a quick study leaves out of an output."""
ANALYSED = [
    f"{phase} {done} of {len(OUTPUTS)} outputs"
    for phase in ("analysis", "other methods")
    for done in range(len(OUTPUTS) + 1)
]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Finished study, worked on in this process alone."""
    reports = []
    options = StudyOptions(
        METHODS, workers=1, progress=lambda message, _: reports.append(message), report=write_study_report
    )
    with simulations_here(), pictures_without_layout(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(workers, "local_processes", pytest.fail)
        finished = run_study(PROBLEM, analytic, tmp_path_factory.mktemp("study"), options)
    assert reports[-len(ANALYSED) :] == ANALYSED
    return finished


def test_the_document_follows_the_contract(study):
    document = json.loads((study.folder / "result.json").read_text(encoding="utf-8"))
    assert document == json.loads(json.dumps(study.result.model_dump()))
    assert StudyResult.read(study.folder / "result.json") == study.result
    assert set(document["outputs"]) == set(OUTPUTS)
    assert document["seconds"] > 0.0
    for output in document["outputs"].values():
        assert output["surrogate"] in {"svr", "krg", "prs"}
        assert output["r2_test"] > 0.99
        assert output["r2_cv"] > 0.99
        assert output["r2_cv"] == max(score["r2_cv"] for score in output["scores"].values())
        for key in ("first", "total", "first_interval", "total_interval"):
            assert list(output[key]) == ["x2", "x4", "x16"]
        low, high = output["total_interval"]["x2"]
        assert 0.0 <= low <= output["total"]["x2"] <= high <= 1.0
    peak = document["outputs"]["peak"]
    assert peak["first"]["x2"] == pytest.approx(1.0, abs=0.01)
    assert peak["total"]["x16"] == pytest.approx(0.0, abs=0.01)
    assert document["settings"] == PROBLEM.settings
    assert {"python", "numpy", "scipy"} <= set(document["versions"])


def test_the_analysis_is_that_of_the_public_functions(study):
    with Store.open(study.folder / "store.sqlite") as store:
        X, Y = store.results("train")
    force = study.result.outputs["force"]
    model = fit_surrogate(force.surrogate, THREE.to_unit(X), Y[:, 0], bounds=[[0.0, 1.0]] * 3, seed=0)
    indices = sobol_closed_form(model)
    np.testing.assert_array_equal(list(force.first.values()), indices.first)
    assert force.r2_cv == model.cross_validate(10).r2


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"outputs": {"force": 3}}', "[" * 10_000])
def test_a_file_that_is_no_result_is_one_line(tmp_path, text):
    (tmp_path / "result.json").write_text(text)
    with pytest.raises(StudyError, match=r"result\.json: not the result of a study \([^\n]+\)$"):
        StudyResult.read(tmp_path / "result.json")
    with pytest.raises(StudyError, match=r"none\.json: No such file or directory, allowed: the result of a study"):
        StudyResult.read(tmp_path / "none.json")


def test_curves_follow_the_function(study):
    curve = study.fits["peak"].curves[0]
    assert curve.code == "x2"
    np.testing.assert_allclose(curve.response, (curve.values / 1000.0) ** 2, atol=0.1)


def test_the_page_holds_everything_itself(study):
    text = (study.folder / "report.html").read_text(encoding="utf-8")
    assert check_page(text).tags.count("svg") == 11
    assert "&lt;b&gt;analytic &amp; quick&lt;/b&gt;" in text
    assert "<b>analytic" not in text
    for name in OUTPUTS:
        assert name in text
    check_widths(text)


def test_a_page_with_a_gap_is_an_error():
    with pytest.raises(Exception, match="undefined"):
        render_page("gsa.html", PageHead("nothing else", "", "", "", ()), {})


def test_a_cancelled_study_resumes_to_the_same_numbers(study, tmp_path, monkeypatch):
    """In two processes, which share the analysis too."""
    seen, started, reports = [], [], []
    local_processes = workers.local_processes

    def start(count):
        started.append(count)
        return local_processes(count)

    options = StudyOptions(
        progress=lambda _, fraction: seen.append(fraction), cancelled=lambda: bool(seen) and seen[-1] >= 0.1
    )
    with pytest.raises(StudyCancelled):
        run_study(PROBLEM, analytic, tmp_path, options)
    assert not (tmp_path / "result.json").exists()
    monkeypatch.setattr(workers, "local_processes", start)
    options = StudyOptions(METHODS, workers=2, progress=lambda message, _: reports.append(message), quick=True)
    resumed = resume_study(tmp_path, lambda _: analytic, options)
    expected = {name: output.model_copy(update=QUICK) for name, output in study.result.outputs.items()}
    assert resumed.result.outputs == expected
    assert started == [2]
    assert reports[-len(OUTPUTS) - 1 :] == ANALYSED[: len(OUTPUTS) + 1]


@pytest.fixture(scope="module")
def doubted(tmp_path_factory):
    """A study in doubt: failures at one end of x2, an output that nothing explains, a constant one, no test points."""
    problem = StudyProblem(THREE, ("force", "noise", "still"), train=40, test=0, seed=0)
    options = StudyOptions(("prs",), workers=1, report=write_study_report)
    with simulations_here(), small_samplings():
        return run_study(problem, doubtful, tmp_path_factory.mktemp("doubted"), options)


def test_failures_stand_above_the_indices(doubted, capsys):
    failed, (region,) = doubted.result.failure_summary, doubted.result.failure_summary.regions
    assert (failed.failed, failed.simulations, failed.share) == (6, 40, 0.15)
    assert failed.of_reason == 6, "reasons that differ in numbers only are one"
    assert (region.input, region.half, region.failed, region.simulations) == ("x2", "upper", 6, 20)
    assert 2285.0 < region.low < region.high < 2500.0
    # Six of 40 at an end, either one, of three inputs.
    assert region.probability == pytest.approx(3 * 2 / scipy.special.comb(40, 6))
    line = "warning: 6 of 40 simulations failed (15%); 6 of them in the upper half of x2, where 6 of 20 failed (from 2"
    show_indices(doubted.result)
    shown = " ".join(capsys.readouterr().out.split())
    page = (doubted.folder / "report.html").read_text(encoding="utf-8")
    assert shown.startswith(line)
    assert 0 < page.index(line) < page.index("Strongest parameters")
    assert doubted.result.outputs["force"].r2_test is None
    assert StudyResult.read(doubted.folder / "result.json") == doubted.result


def test_indices_of_a_poor_surrogate_are_not_determined(doubted, capsys):
    document = json.loads((doubted.folder / "result.json").read_text(encoding="utf-8"))["outputs"]
    assert [document[name]["determined"] for name in ("force", "noise")] == [True, False]
    assert document["noise"]["r2_cv"] < 0.5
    assert document["noise"]["total"].keys() == {"x2", "x4", "x16"}
    show_indices(doubted.result)
    row = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("noise "))
    assert row.rstrip().endswith("not determined")
    page = (doubted.folder / "report.html").read_text(encoding="utf-8")
    assert f"not determined: R² {document['noise']['r2_cv']:.2f}" in page
    for name, numbers in (("indices", 6), ("convergence", 6), ("morris", 5)):
        rows = list(csv.reader((doubted.folder / f"tables/{name}.csv").read_text().splitlines()))
        assert {tuple(row[-numbers:]) for row in rows if row[0] == "noise"} == {("not determined",) * numbers}, name
        assert not any("not determined" in row for row in rows if row[0] == "force"), name


def test_a_constant_output_is_named_and_left_out(doubted):
    assert list(doubted.result.outputs) == ["force", "noise"]
    assert doubted.result.skipped == {"still": "the output is constant (3), allowed: one with a variance to explain"}
    assert "output still is left out: the output is constant (3)" in (doubted.folder / "report.html").read_text()


def test_a_quick_study_asks_no_other_methods(doubted, tmp_path):
    (tmp_path / "store.sqlite").write_bytes((doubted.folder / "store.sqlite").read_bytes())
    previews = []
    options = StudyOptions(("prs",), workers=1, quick=True, preview=previews.append, report=write_study_report)
    with small_samplings(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "ask_other_methods", pytest.fail)
        quick = report_study(tmp_path, options).result
    assert [preview.outputs for preview in previews] == [quick.outputs]
    assert quick.outputs["force"] == doubted.result.outputs["force"].model_copy(update=QUICK)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Strongest parameters" in page
    assert "How far the indices can be trusted" not in page
    assert (tmp_path / "tables/morris.csv").read_text().count("\n") == 1
    assert StudyResult.read(tmp_path / "result.json") == quick


def test_many_failures_are_refused_unless_allowed(tmp_path):
    problem = StudyProblem(THREE, OUTPUTS, train=40, test=0, seed=0)
    match = r"11 of 40 simulations failed \(28%\); 11 of them in the upper half of x2, .* or --allow-failures$"
    with simulations_here(), small_samplings(), pytest.raises(StudyError, match=match):
        run_study(problem, fails_above, tmp_path, StudyOptions(("prs",), workers=1))
    assert not (tmp_path / "result.json").exists()
    with small_samplings():
        study = report_study(tmp_path, StudyOptions(("prs",), workers=1, allow_failures=True))
    assert study.result.samples.failed == len(study.result.failures) == 11


def test_when_all_fail_the_reason_is_said(tmp_path):
    problem = StudyProblem(THREE, OUTPUTS, train=12, test=2, seed=0)
    match = r"all 14 simulations failed; commonest reason \(14 of 14\): KeyError: 'x1'; allowed: some that end well"
    with simulations_here(), pytest.raises(StudyError, match=match):
        run_study(problem, lambda sample: sample["x1"], tmp_path, StudyOptions(workers=1, allow_failures=True))


def test_too_few_simulations_name_the_output(tmp_path):
    problem = StudyProblem(THREE, OUTPUTS, train=5, test=0, seed=0)
    message = "output force: 5 samples for a surrogate, allowed: at least 10"
    with pytest.raises(StudyError, match=message), simulations_here():
        run_study(problem, analytic, tmp_path, StudyOptions(workers=1))


@pytest.mark.parametrize("methods", [(), ("svr", "kriging")])
def test_unknown_surrogates_are_refused_before_the_campaign(tmp_path, methods):
    with pytest.raises(StudyError, match="allowed: one or more of rbf, krg, svr, prs"):
        run_study(PROBLEM, analytic, tmp_path, StudyOptions(methods=methods))
    assert not list(tmp_path.iterdir())  # nothing half-written


def test_importing_the_package_loads_no_ros_and_nothing_heavy():
    program = (
        "import sys, tbm_gsa; assert not {'sklearn', 'SALib'} & set(sys.modules); "
        "from tbm_gsa import fit_surrogate, sobol_closed_form, sobol_monte_carlo; "
        "import tbm_gsa.sensitivity.study.run, tbm_gsa.app.report.gsa_page; "
        "assert not {'rclpy', 'tbm_msgs_py.bags'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_unknown_names_are_attribute_errors():
    import tbm_gsa

    with pytest.raises(AttributeError, match="fit_everything"):
        tbm_gsa.fit_everything  # noqa: B018


def test_a_simulation_far_from_the_others_is_named(tmp_path):
    problem = StudyProblem(THREE, OUTPUTS, train=40, test=0, seed=0)
    with Store.create_or_open(tmp_path / STORE_NAME, problem) as store:
        for row, sample in store.pending():
            outputs = analytic(sample)
            store.record(Outcome(row, outputs | {"peak": outputs["peak"] + (40.0 if row == 7 else 0.0)}, None, 0.0))
    with small_samplings():
        result = report_study(tmp_path, StudyOptions(("prs",), workers=1, quick=True)).result
    assert {name: output.outliers for name, output in result.outputs.items()} == {"force": (), "peak": (7,)}
    assert any(doubt.startswith("output peak: simulation 7 lies far from what") for doubt in result.doubts())
