"""A whole study with an analytic evaluation: result, report, resume; and what importing the package loads."""

import json
import re
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import pytest
from evaluations import OUTPUTS, analytic, fails_above

from tbm_gsa import fit_surrogate, sobol_closed_form
from tbm_gsa.report.page import render_page
from tbm_gsa.study import analysis
from tbm_gsa.study.errors import StudyCancelled, StudyError
from tbm_gsa.study.inputs import PAPER_INPUTS, InputSet
from tbm_gsa.study.problem import Problem
from tbm_gsa.study.run import StudyOptions, report_study, resume_study, run_study
from tbm_gsa.study.store import Store

THREE = InputSet(tuple(PAPER_INPUTS[code] for code in ("x2", "x4", "x16")))
PROBLEM = Problem(THREE, OUTPUTS, train=40, test=8, seed=0, settings={"machine": "<b>analytic & quick</b>"})


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return run_study(PROBLEM, analytic, tmp_path_factory.mktemp("study"), StudyOptions(methods=("svr", "krg", "prs")))


def test_the_document_follows_the_contract(study):
    document = json.loads((study.folder / "result.json").read_text(encoding="utf-8"))
    assert document == json.loads(json.dumps(study.document))
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
    chosen = study.document["outputs"]["force"]["surrogate"]
    model = fit_surrogate(chosen, THREE.to_unit(X), Y[:, 0], bounds=[[0.0, 1.0]] * 3, seed=0)
    indices = sobol_closed_form(model)
    np.testing.assert_array_equal(list(study.document["outputs"]["force"]["first"].values()), indices.first)
    assert study.document["outputs"]["force"]["r2_cv"] == model.cross_validate(10).r2


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
    text = study.report.read_text(encoding="utf-8")
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


def test_reporting_again_gives_the_same_numbers(study, tmp_path):
    (tmp_path / "store.sqlite").write_bytes((study.folder / "store.sqlite").read_bytes())
    again = report_study(tmp_path, StudyOptions(methods=("svr", "krg", "prs")))
    assert again.document["outputs"] == study.document["outputs"]


@pytest.mark.parametrize("workers", [1, 2])
def test_workers_and_progress_hold_for_the_analysis_too(study, tmp_path, monkeypatch, workers):
    started, seen = [], []
    local_processes = analysis.local_processes

    def start(count):
        started.append(count)
        return local_processes(count)

    monkeypatch.setattr(analysis, "local_processes", start)
    (tmp_path / "store.sqlite").write_bytes((study.folder / "store.sqlite").read_bytes())
    options = StudyOptions(("prs",), workers=workers, analysis_progress=lambda *counts: seen.append(counts))
    report_study(tmp_path, options)
    assert started == [workers][: workers - 1]  # one works here, in this process
    assert seen == [(done, len(OUTPUTS)) for done in range(len(OUTPUTS) + 1)]


def test_a_cancelled_study_resumes_to_the_same_numbers(study, tmp_path):
    seen = []
    options = StudyOptions(
        progress=lambda done, total, failed: seen.append(done), cancelled=lambda: bool(seen) and seen[-1] >= 5
    )
    with pytest.raises(StudyCancelled):
        run_study(PROBLEM, analytic, tmp_path, options)
    assert not (tmp_path / "result.json").exists()
    resumed = resume_study(tmp_path, lambda _: analytic, StudyOptions(methods=("svr", "krg", "prs")))
    assert resumed.document["outputs"] == study.document["outputs"]


def test_failures_are_reported(tmp_path):
    result = run_study(PROBLEM, fails_above, tmp_path, StudyOptions(methods=("prs",)))
    failed = result.document["samples"]["failed"]
    assert failed == len(result.document["failures"]) > 0
    text = result.report.read_text(encoding="utf-8")
    assert f"{failed} of 48 simulations failed" in text


def test_too_few_simulations_name_the_output(tmp_path):
    problem = Problem(THREE, OUTPUTS, train=5, test=0, seed=0)
    with pytest.raises(StudyError, match="output force: 5 samples for a surrogate, allowed: at least 10"):
        run_study(problem, analytic, tmp_path)


def test_a_study_without_test_points(tmp_path):
    problem = Problem(THREE, OUTPUTS, train=20, test=0, seed=0)
    result = run_study(problem, analytic, tmp_path, StudyOptions(methods=("prs",)))
    assert result.document["outputs"]["force"]["r2_test"] is None


@pytest.mark.parametrize("methods", [(), ("svr", "kriging")])
def test_unknown_surrogates_are_refused_before_the_campaign(tmp_path, methods):
    with pytest.raises(StudyError, match="allowed: one or more of rbf, krg, svr, prs"):
        run_study(PROBLEM, analytic, tmp_path, StudyOptions(methods=methods))
    assert not list(tmp_path.iterdir())  # nothing half-written


def test_importing_the_package_loads_no_ros_and_nothing_heavy():
    program = (
        "import sys, tbm_gsa; assert not {'sklearn', 'SALib'} & set(sys.modules); "
        "from tbm_gsa import fit_surrogate, sobol_closed_form, sobol_monte_carlo; "
        "import tbm_gsa.study.run, tbm_gsa.report.gsa_page; "
        "assert not [name for name in sys.modules if name.split('.')[0] in ('rclpy', 'tbm_msgs_py')]"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_unknown_names_are_attribute_errors():
    import tbm_gsa

    with pytest.raises(AttributeError, match="fit_everything"):
        tbm_gsa.fit_everything  # noqa: B018
