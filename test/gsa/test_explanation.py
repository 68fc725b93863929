"""Explanation of a recording: causes and joint posterior against exact ones, planted changes, the file written after.

Sources: a linear Gaussian model, whose evidence and posterior are known in closed form (scipy's normal and truncated
normal distributions); recordings simulated with one stiffness halved (the planted truth); PyYAML on the written file.

What the command simulates takes minutes with its own numbers, which are tried under `verify`; here it hands on smaller
ones than it allows.
"""

import json
import signal
import sys
from dataclasses import replace

import numpy as np
import pytest
import scipy.integrate
import yaml
from compare_bags import model_values, write_bag
from here import simulations_here
from pydantic import TypeAdapter
from scipy.stats import multivariate_normal, truncnorm

from tbm_dynamics import load_machine, simulate
from tbm_dynamics.machine.inputs import LOAD_INPUTS, input_values
from tbm_dynamics.machine.writing import updated_text
from tbm_gsa.app.cli.main import main
from tbm_gsa.app.report.explanation_page import joint_intervals
from tbm_gsa.comparison.results import ComparisonResult
from tbm_gsa.comparison.workflow import compare_recording
from tbm_gsa.explanation import workflow
from tbm_gsa.explanation.causes import Misfit, rank_causes
from tbm_gsa.explanation.indicator_change import Lengths, load_scatter, shrunk_covariance
from tbm_gsa.explanation.joint import joint_posterior
from tbm_gsa.explanation.observed import observed
from tbm_gsa.explanation.result import Explanation, Joint, JointInput, read_explanation
from tbm_gsa.explanation.workflow import ExplainOptions, explain
from tbm_gsa.reading import validated
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.signals.settings import Settings

SLOPES = np.array([[1.0, 0.2, 0.0], [0.5, -1.0, 0.3]])  # of two statistics along three inputs
NOMINAL = np.array([0.5, 0.5, 0.5])
COVARIANCE = np.array([[4e-3, 1e-3], [1e-3, 9e-3]])


def linear(points):
    return (points - NOMINAL) @ SLOPES.T


@pytest.fixture(scope="module")
def misfit():
    return Misfit(linear(np.array([[0.85, 0.5, 0.5]]))[0] + [0.01, -0.02], COVARIANCE)


def test_evidence_and_interval_of_single_causes(misfit):
    causes = {cause.place: cause for cause in rank_causes(linear, NOMINAL, misfit)}
    for place in range(3):

        def likelihood(u, place=place):
            point = NOMINAL.copy()
            point[place] = u
            return multivariate_normal.pdf(misfit.observed, linear(point[None])[0], COVARIANCE)

        assert np.exp(causes[place].log_evidence) == pytest.approx(scipy.integrate.quad(likelihood, 0, 1)[0], rel=1e-3)
    nothing = multivariate_normal.logpdf(misfit.observed, np.zeros(2), COVARIANCE)
    assert causes[-1].log_evidence == pytest.approx(nothing)
    assert sum(cause.probability for cause in causes.values()) == pytest.approx(1.0)
    first = rank_causes(linear, NOMINAL, misfit)[0]
    assert first.place == 0
    # Along one input the posterior is a normal distribution cut off at the range.
    slope, precision = SLOPES[:, 0], np.linalg.inv(COVARIANCE)
    deviation = (slope @ precision @ slope) ** -0.5
    centre = 0.5 + deviation**2 * slope @ precision @ misfit.observed
    law = truncnorm(-centre / deviation, (1.0 - centre) / deviation, centre, deviation)
    np.testing.assert_allclose(first.quantiles, law.ppf([0.5, 0.05, 0.95]), atol=3e-3)


def test_joint_posterior_of_a_linear_model(misfit):
    found = joint_posterior(linear, NOMINAL, misfit, seed=1)
    # The third input moves the second statistic alone: by quadrature over the cube.
    grid = (np.arange(60) + 0.5) / 60
    points = np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1).reshape(-1, 3)
    weight = np.exp(misfit.log_likelihood(linear(points)))
    mean = weight @ points / weight.sum()
    deviation = np.sqrt(weight @ (points - mean) ** 2 / weight.sum())
    error = deviation / np.sqrt(found.effective)
    assert np.all(np.abs(found.samples.mean(axis=0) - mean) < 5.0 * error + 0.005)
    np.testing.assert_allclose(found.samples.std(axis=0), deviation, rtol=0.15)
    assert found.effective > 100


def test_load_scatter_is_that_of_independent_runs():
    rng = np.random.default_rng(3)
    common = rng.standard_normal((4000, 1))
    still = np.exp(0.1 * (common + rng.standard_normal((4000, 2))))
    moved = still * np.exp(0.05 * rng.standard_normal((4000, 2)))
    found = load_scatter(still, moved, Lengths(run=6.0, field=60.0, model=30.0))
    # 0.02 in each run, half of it in common; after the move 0.0025 more, and that in the shift.
    np.testing.assert_allclose(np.diag(found), 0.0225 / 10 + 0.02 / 5 + 0.0025, rtol=0.1)
    assert found[0, 1] == pytest.approx(0.01 / 10 + 0.01 / 5, rel=0.15)


def test_shrinkage_keeps_the_sizes():
    rng = np.random.default_rng(0)
    deviations = rng.standard_normal((20, 8)) * np.logspace(-3, 0, 8)
    found = shrunk_covariance(deviations)
    np.testing.assert_allclose(np.sqrt(np.diag(found)), np.sqrt(np.mean(deviations**2, axis=0)), rtol=1e-9)
    assert np.linalg.eigvalsh(found / np.sqrt(np.outer(np.diag(found), np.diag(found)))).min() > 0.05


def form(document):
    return validated(TypeAdapter(ComparisonResult), json.dumps(document), "document", StudyError)


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Document of a recording of a machine in a rock of half the stiffness."""
    machine = load_machine("dz101").with_inputs(x16=0.5)
    values = {"cutterhead": model_values(77, 10.0, machine)["cutterhead"]}
    bag = write_bag(tmp_path_factory.mktemp("planted") / "bag", values, rate=10_000)
    return compare_recording(
        bag, "dz101", model_duration=10.0, settings=Settings(bands=((0.5, 20.0),))
    ).result.model_dump()


def test_the_statistics_of_a_comparison(compared):
    facts = observed(form(compared))
    names = [statistic.name for statistic in facts.statistics]
    assert len(names) == 3 * 2
    (one,) = [statistic for statistic in facts.statistics if statistic.name == "rms_0.5-20_hz_cutterhead_x"]
    axis = compared["points"]["cutterhead"]["x"]
    assert (one.field, one.model) == (axis["field_band_rms"]["0.5-20_hz"], axis["model_band_rms"]["0.5-20_hz"])
    assert 0.0 < one.deviation < 0.5


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the explanations of a recording share one campaign."""
    return tmp_path_factory.mktemp("explained")


@pytest.fixture
def command(folder, monkeypatch, capsys):
    """Run a command line in that folder: its exit code, what it printed, what it complained of."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(signal, "signal", lambda *_: None)

    def small(comparison, folder, options):
        assert (options.samples, options.duration, options.workers) == (60, 2.0, 1)
        return explain(comparison, folder, replace(options, samples=20, duration=1.0, seeds=4))

    monkeypatch.setattr(workflow, "explain", small)

    def run(line):
        monkeypatch.setattr(sys, "argv", ["tbm-monitor", *line.split()])
        with pytest.raises(SystemExit) as end, simulations_here():
            main()
        return end.value.code, *capsys.readouterr()

    return run


def test_explained_and_written_as_a_machine(compared, folder, command):
    (folder / "compared.json").write_text(json.dumps(compared), "utf-8")
    code, out, err = command("gsa explain compared.json --out found --samples 60 --duration 2 --workers 1 --json")
    assert (code, err) == (0, "page: found/explanation.html\n")
    document = json.loads(out)
    assert document == json.loads((folder / "found" / "explanation.json").read_text("utf-8"))
    assert json.loads(read_explanation(folder / "found").model_dump_json()) == document
    first = document["causes"][0]
    assert first["input"] == "x16"
    assert first["interval"][0] <= 0.5 <= first["interval"][1]
    assert document["misfit"]["checked"] < document["misfit"]["model"]
    assert document["explained"]
    assert "x16 alone explains the recording" in (folder / "found" / "explanation.html").read_text("utf-8")
    searched = document["joint"]["inputs"]
    assert {code: (row["lower"], row["upper"], row["distribution"]) for code, row in searched.items()} == {
        **dict.fromkeys((f"x{k}" for k in range(16, 26)), (pytest.approx(1.0 / 3.0), 3.0, "log-uniform")),
        **dict.fromkeys(("x4", *(f"x{k}" for k in range(11, 16))), (2e-4, 5e-3, "log-uniform")),
        "x5": (200.0, 220.0, "uniform"),
        "x6": (0.29, 0.31, "uniform"),
        "x7": (100.0, 500.0, "uniform"),
        "x8": (0.8, 1.2, "uniform"),
        "x9": (7.5e9, 8.5e9, "uniform"),
        "x10": (0.03, 0.17, "uniform"),
    }
    for row in searched.values():
        assert row["lower"] <= row["interval"][0] <= row["interval"][1] <= row["upper"]
    code, out, err = command("machine update --from found --out mine.yaml")
    assert (code, err) == (0, "")
    assert out.startswith("mine.yaml: x16 (Stiffness of cutterhead–rock) 1 to 0.")
    mine = load_machine(folder / "mine.yaml")
    before, after = (one.assemble().natural_frequencies(40) for one in (load_machine("dz101"), mine))
    assert np.abs(after / before - 1.0).max() > 0.01
    for line, message in (
        ("gsa explain nowhere.json", "nowhere.json: No such file or directory, allowed: what `tbm-monitor compare"),
        ("gsa explain mine.yaml", "mine.yaml: not what `tbm-monitor compare BAG --json` prints (no JSON"),
        (
            "machine update --from found --out mine.yaml",
            "mine.yaml: exists already, allowed: a new file",
        ),
        (
            "machine update --machine open380 --from found --out new.yaml",
            "found: explains another machine than open380",
        ),
        ("machine update --from found --out new.yaml --input x2", "--input x2: not among the causes"),
        ("machine update --from found --out new.yaml --input x4 --input x4", "--input x4: given twice, allowed: once"),
        ("machine update --from mine.yaml --out new.yaml", "mine.yaml: not the explanation.json"),
    ):
        code, out, err = command(line)
        assert (code, out, len(err.splitlines())) == (2, "", 1), err
        assert err.startswith(f"tbm-monitor: {message}")


def test_intervals_are_drawn_over_what_was_searched():
    whole = {"lower": 1.0 / 3.0, "upper": 3.0, "distribution": "log-uniform"}
    plain = {"lower": 200.0, "upper": 220.0, "distribution": "uniform"}
    rows = {
        "x16": JointInput(**whole, value=1.0, interval=(3.0**-0.5, 3.0), machine_value=1.0, learnt=0.0),
        "x5": JointInput(**plain, value=210.0, interval=(205.0, 215.0), machine_value=210.0, learnt=0.0),
    }
    (panel,) = joint_intervals(Joint(inputs=rows, accepted=1, effective_samples=1, standardised_misfit=1)).axes
    ends = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in panel.patches]
    np.testing.assert_allclose(ends, [(0.0, 1.0), (0.25, 1.0), (0.0, 1.0), (0.25, 0.75)], atol=1e-12)
    np.testing.assert_allclose([line.get_xdata() for line in panel.lines], 0.5)
    assert panel.get_xlim() == (0.0, 1.0)
    labels = [label.get_text() for label in panel.get_yticklabels()]
    assert labels == ["x16 k_r,ct: 0.333 to 3, log", "x5 E: 200 to 220 GPa"]


def test_what_no_input_explains(compared, folder, command, monkeypatch):
    """Sensors that read nine times too much: the causes are ranked all the same, and none is taken."""
    wrong = json.loads(json.dumps(compared))
    for axis in (axis for axes in wrong["points"].values() for axis in axes.values()):
        axis["field_rms"] *= 9.0
        axis["field_band_rms"] = {band: 9.0 * value for band, value in axis["field_band_rms"].items()}
    (folder / "wrong.json").write_text(json.dumps(wrong), "utf-8")
    monkeypatch.setattr(workflow, "Explanation", lambda **given: Explanation(**given | {"seconds": float("nan")}))
    code, out, err = command("gsa explain wrong.json --out found --samples 60 --duration 2 --workers 1")
    assert (code, err) == (0, "page: found/explanation.html\n")
    text = (folder / "found" / "explanation.json").read_text("utf-8")
    document = json.loads(text, parse_constant=pytest.fail)  # which JSON does not have
    first, off = document["causes"][0]["input"], document["standardised_misfit"]["checked"]
    assert not document["explained"]
    rows = document["statistics"]
    left = [np.log(row["field"] / row["checked"]) / row["deviation"] for row in rows]
    assert off == pytest.approx(np.sqrt(np.mean(np.square(left))))
    assert document["joint"]["standardised_misfit"] < off
    said = f"{first} alone does not explain the recording: {off:.1f} standard deviations off"
    assert said in " ".join(out.split())
    assert said in (folder / "found" / "explanation.html").read_text("utf-8")
    code, out, err = command("machine update --from found --out refused.yaml")
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert err.startswith(f"tbm-monitor: {said}")
    assert not (folder / "refused.yaml").exists()
    assert command(f"machine update --from found --out taken.yaml --input {first}")[0] == 0
    head = " ".join((folder / "taken.yaml").read_text("utf-8").split("name:")[0].replace("#", "").split())
    assert said in head


@pytest.mark.parametrize(
    "change", [lambda d: d.pop("bands"), lambda d: d["points"].clear(), lambda d: d.update(points=3)]
)
def test_documents_that_are_none(compared, change):
    broken = json.loads(json.dumps(compared))
    change(broken)
    with pytest.raises(StudyError, match=r"bands: missing|bands: other test points|points: Input should be"):
        observed(form(broken))


def test_a_machine_that_has_changed_since(compared, tmp_path):
    other = {**compared, "machine_file": {**compared["machine_file"], "sha256": "0"}}
    with pytest.raises(StudyError, match="machine dz101 has changed since the comparison: compare again"):
        explain(form(other), tmp_path)


def test_a_written_machine_is_the_variant(tmp_path):
    machine = load_machine("dz101")
    changes = {"x4": 2e-3, "x16": 0.7, "x24": 1.5}
    text = updated_text(machine, changes, "dz101_new", ["why\nit was"])
    (tmp_path / "new.yaml").write_text(text, "utf-8")
    assert text.startswith("# why it was\n")
    data = yaml.safe_load(text)
    assert data["steel"]["source"] == "updated"
    assert [c["source"] for c in data["cutterhead_bearing_gear"]["connections"]] == ["updated", "table5", "table5"]
    assert data["driveshaft"]["spline"]["stiffness"][0] == pytest.approx(1.5e10)
    written, variant = load_machine(tmp_path / "new.yaml"), machine.with_inputs(**changes)
    a, b = (simulate(one, 0.05, seed=1).mesh_force for one in (written, variant))
    np.testing.assert_array_equal(a, b)
    assert written.cutter_loads().mean == pytest.approx(machine.cutter_loads().mean)


def test_values_of_a_machine_are_its_inputs():
    values = input_values(load_machine("dz101").description)
    assert {values.pop(code) for code in LOAD_INPUTS} == {1.0}
    # Table 4's initial values but the operating point, which is Table 1's.
    expected = {"x1": 5.6, "x2": 3040.0, "x3": 12000.0, "x4": 1e-3, "x5": 210.0, "x6": 0.3, "x7": 300.0, "x8": 1.0}
    assert values == pytest.approx(
        {
            **expected,
            "x9": 8.1e9,
            "x10": 0.05,
            **{f"x{i}": 1e-3 for i in range(11, 16)},
            **{f"x{i}": 1.0 for i in range(16, 26)},
        }
    )
    assert "x19" not in input_values(load_machine("open380").description)


@pytest.mark.verify
@pytest.mark.parametrize("planted", ["x16", "x17", "x18", "x21", "x22", "x25"])
def test_a_halved_stiffness_is_found(tmp_path_factory, planted):
    folder = tmp_path_factory.getbasetemp() / "explained"  # one campaign for all
    folder.mkdir(exist_ok=True)
    machine = load_machine("dz101").with_inputs(**{planted: 0.5})
    bag = write_bag(folder / f"{planted}.bag", model_values(77, 60.0, machine), rate=10_000)
    found = explain(form(compare_recording(bag, "dz101").result.model_dump()), folder, ExplainOptions(samples=250))
    first = found.causes[0]
    assert first.input == planted
    assert first.interval[0] <= 0.5 <= first.interval[1]
    assert found.misfit.checked < found.misfit.model
    assert found.explained
