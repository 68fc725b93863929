"""A whole study with an analytic evaluation: result, report, resume; and what importing the package loads.

An analysis of two outputs takes two seconds however small the study, and as much again in each process it is shared
with: what can be asked of one study is asked of one, and processes are started where the test is about them.
"""

import json
import re
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import pytest
from evaluations import OUTPUTS, analytic, fails_above
from here import simulations_here, small_samplings

from tbm_gsa import fit_surrogate, sobol_closed_form
from tbm_gsa.app.report.gsa_page import write_study_report
from tbm_gsa.app.report.page import render_page
from tbm_gsa.sensitivity.results import StudyResult
from tbm_gsa.sensitivity.study import analysis
from tbm_gsa.sensitivity.study.campaign import run_campaign
from tbm_gsa.sensitivity.study.errors import StudyCancelled, StudyError
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS, InputSet
from tbm_gsa.sensitivity.study.problem import Problem
from tbm_gsa.sensitivity.study.run import StudyOptions, report_study, resume_study, run_study
from tbm_gsa.sensitivity.study.store import Store

THREE = InputSet(tuple(PAPER_INPUTS[code] for code in ("x2", "x4", "x16")))
PROBLEM = Problem(THREE, OUTPUTS, train=40, test=8, seed=0, settings={"machine": "<b>analytic & quick</b>"})
METHODS = ("svr", "krg", "prs")
ANALYSED = [f"analysis {done} of {len(OUTPUTS)} outputs" for done in range(len(OUTPUTS) + 1)]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Finished study, worked on in this process alone."""
    reports = []
    options = StudyOptions(
        METHODS, workers=1, progress=lambda message, _: reports.append(message), report=write_study_report
    )
    with simulations_here(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(analysis, "local_processes", pytest.fail)
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
    curve = study.analyses["peak"].curves[0]
    assert curve.code == "x2"
    np.testing.assert_allclose(curve.response, (curve.values / 1000.0) ** 2, atol=0.1)


class _Page(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.links = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for name, value in attrs if name in {"src", "href", "srcset", "data"}]


def test_the_page_holds_everything_itself(study):
    text = (study.folder / "report.html").read_text(encoding="utf-8")
    page = _Page()
    page.feed(text)
    assert page.tags.count("img") == 10
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    assert all(link.startswith("data:image/svg+xml;base64,") for link in page.links)
    assert not re.search(r"url\(|@import", text)
    assert "&lt;b&gt;analytic &amp; quick&lt;/b&gt;" in text
    assert "<b>analytic" not in text
    for name in OUTPUTS:
        assert name in text


def test_a_page_with_a_gap_is_an_error():
    with pytest.raises(Exception, match="undefined"):
        render_page("gsa.html", {"title": "nothing else"})


def test_a_cancelled_study_resumes_to_the_same_numbers(study, tmp_path, monkeypatch):
    """In two processes, which share the analysis too."""
    seen, started, reports = [], [], []
    local_processes = analysis.local_processes

    def start(count):
        started.append(count)
        return local_processes(count)

    options = StudyOptions(
        progress=lambda _, fraction: seen.append(fraction), cancelled=lambda: bool(seen) and seen[-1] >= 0.1
    )
    with pytest.raises(StudyCancelled):
        run_study(PROBLEM, analytic, tmp_path, options)
    assert not (tmp_path / "result.json").exists()
    monkeypatch.setattr(analysis, "local_processes", start)
    options = StudyOptions(METHODS, workers=2, progress=lambda message, _: reports.append(message))
    resumed = resume_study(tmp_path, lambda _: analytic, options)
    assert resumed.result.outputs == study.result.outputs
    assert started == [2]
    assert reports[-len(ANALYSED) :] == ANALYSED


def test_failures_and_no_test_points_are_reported(tmp_path):
    problem = Problem(THREE, OUTPUTS, train=40, test=0, seed=0)
    with simulations_here(), Store.create_or_open(tmp_path / "store.sqlite", problem) as store:
        run_campaign(store, fails_above)
    with small_samplings():
        study = report_study(tmp_path, StudyOptions(("prs",), workers=1, report=write_study_report))
    failed = study.result.samples.failed
    assert failed == len(study.result.failures) > 0
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"{failed} of 40 simulations failed" in text
    assert study.result.outputs["force"].r2_test is None
    assert StudyResult.read(tmp_path / "result.json") == study.result


def test_too_few_simulations_name_the_output(tmp_path):
    problem = Problem(THREE, OUTPUTS, train=5, test=0, seed=0)
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
