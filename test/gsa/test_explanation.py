"""Explanation of a recording: evidence against exact integrals, the four words, the file written after.

Sources: integrals by scipy, a linear Gaussian model whose posterior is known in closed form; band powers of varied
machines and sensors (the planted truth); a recording of a simulated machine; PyYAML on the written file.

What the command computes takes half a minute with its own numbers; here two inputs are looked at, at few values.
"""

import json
import signal
import sys

import numpy as np
import pytest
import scipy.integrate
import yaml
from compare_bags import model_values, write_bag
from here import pictures_without_layout, simulations_here
from pydantic import TypeAdapter
from report_pages import check_page, check_widths
from scipy.stats import multivariate_normal, norm

from tbm_dynamics import load_machine, simulate
from tbm_dynamics.loads.description import LOAD_GROUPS, LoadFactors
from tbm_dynamics.machine.inputs import LOAD_INPUTS, input_values
from tbm_dynamics.machine.writing import updated_text
from tbm_gsa.app.cli.main import main
from tbm_gsa.app.report.explanation_page import joint_intervals
from tbm_gsa.comparison.results import ComparisonResult
from tbm_gsa.comparison.workflow import compare_recording
from tbm_gsa.explanation import cause_curves, curve_cache
from tbm_gsa.explanation.band_reading import BandReading, Sensor
from tbm_gsa.explanation.evidence import QUANTILES, integrated, refined
from tbm_gsa.explanation.hypotheses import gain_at, with_gain
from tbm_gsa.explanation.joint import sampled
from tbm_gsa.explanation.judgement import judge
from tbm_gsa.explanation.observed import Observed, observed
from tbm_gsa.explanation.parts import ExplanationParts
from tbm_gsa.explanation.ranges import explaining_inputs
from tbm_gsa.explanation.result import Joint, JointInput, read_explanation
from tbm_gsa.explanation.workflow import explain
from tbm_gsa.reading import validated
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_msgs_py.base.operating_point import OperatingPoint

NOISE = (100e-6 * 9.81) ** 2  # m²/s⁴/Hz
SECONDS = 60.0


@pytest.mark.parametrize(("centre", "size"), [(0.4, 0.2), (0.731, 0.004), (0.0, 0.05), (1.0, 3.0)])
def test_evidence_and_interval_are_those_of_the_integral(centre, size):
    def log_likelihood(place):
        return float(norm.logpdf(place, centre, size))

    places = refined(log_likelihood)
    evidence, shares, quantiles = integrated(places, np.array([log_likelihood(place) for place in places]))
    law = norm(centre, size)
    exact = law.cdf(1.0) - law.cdf(0.0)
    assert np.exp(evidence) == pytest.approx(exact, rel=0.03)
    np.testing.assert_allclose(quantiles, law.ppf(law.cdf(0.0) + exact * np.array(QUANTILES)), atol=0.12 * size)
    assert shares.sum() == pytest.approx(1.0)
    assert len(places) < 61


def test_evidence_of_two_states_is_bayes_rule():
    # Two statistics of a Gaussian; one place moves the first of them along a line.
    covariance = np.array([[4e-3, 1e-3], [1e-3, 9e-3]])
    seen, slope = np.array([0.21, -0.03]), np.array([0.5, 0.1])

    def log_likelihood(place):
        return float(multivariate_normal.logpdf(seen, (place - 0.2) * slope, covariance))

    places = refined(log_likelihood)
    moved, _, _ = integrated(places, np.array([log_likelihood(place) for place in places]))
    still, _, _ = integrated(np.array([0.5]), np.array([log_likelihood(0.2)]))
    exact = scipy.integrate.quad(lambda place: np.exp(log_likelihood(place)), 0.0, 1.0)[0] / np.exp(log_likelihood(0.2))
    assert np.exp(moved - still) == pytest.approx(exact, rel=0.02)


def test_walkers_sample_a_normal_distribution():
    size = np.array([0.5, 2.0])
    start = np.random.default_rng(0).standard_normal((12, 2))
    samples, logs, _ = sampled(lambda points: -0.5 * np.square(points / size).sum(axis=1), start, 900, 1)
    np.testing.assert_allclose(samples.std(axis=0), size, rtol=0.15)
    assert np.abs(samples[np.argmax(logs)] / size).max() < 0.2


READING = BandReading({point: Sensor() for point in ("cutterhead", "girder")}, bands=((0.5, 20.0), (125.0, 135.0)))
QUIET = np.full(len(READING.statistics), NOISE)
UNSTATED = np.full(len(READING.statistics), np.nan)
LOOKED = ("x6", "x16")


@pytest.fixture(scope="module")
def few():
    """Two inputs, one of which nothing feels, at few values."""
    with pytest.MonkeyPatch.context() as patch:
        inputs = lambda machine: InputSet(  # noqa: E731
            tuple(one for one in explaining_inputs(machine).inputs if one.code in LOOKED)
        )
        for module in (cause_curves, curve_cache):
            patch.setattr(module, "explaining_inputs", inputs)
        patch.setattr(cause_curves, "CELLS", dict.fromkeys(cause_curves.CELLS, 2))
        yield


@pytest.fixture(scope="module")
def curves(machine, few):
    return cause_curves.cause_curves(machine, READING, workers=1)


def powers(scatter, factors=None, seed=0):
    """Band powers that a recording of a machine may have."""
    factors = np.ones(6) if factors is None else factors
    logs = np.random.default_rng(seed).multivariate_normal(
        np.zeros(len(QUIET)), scatter.covariance(factors, QUIET, SECONDS), method="cholesky"
    )
    return scatter.expected(factors, QUIET) * np.exp(logs)


def judged(curves, values, floor=QUIET, stated=UNSTATED):
    return judge(Observed.of(READING, values, floor, stated, SECONDS), curves, LoadFactors())


ROCK = np.array([2.0, 0.6, 1.0, 1.0, 0.6, 1.5])
CHANNEL = np.array([one.point == "girder" and one.axis == "y" for one in READING.statistics])


def test_an_axis_that_is_not_measured_is_no_dead_channel(curves):
    """Neither judged nor listed, where a channel of no power is found dead."""
    values = powers(curves.nominal, ROCK)
    dead = judged(curves, np.where(CHANNEL, 0.0, values))
    found = judged(curves, np.where(CHANNEL, np.nan, values), np.where(CHANNEL, np.nan, QUIET))
    assert (dead.verdict, found.verdict) == ("sensor", "rock")
    assert not np.isin(np.flatnonzero(CHANNEL), found.used).any()
    assert "girder_y" not in ExplanationParts(found, None, None, SECONDS).sensors()
    reasons = found.observed.weightless(found.used, curves.nominal)
    assert {reason for name, reason in reasons.items() if name.endswith("girder_y")} == {"not measured"}


def test_the_rock_is_found_and_the_machine_left_alone(curves):
    found = judged(curves, powers(curves.nominal, ROCK))
    assert found.verdict == "rock"
    assert found.words["rock"] > 0.5
    assert found.blind == ("x6",)
    low, high = found.chosen.factors()[1].T
    for group in ("axial_low", "axial_high", "lateral"):
        place = LOAD_GROUPS.index(group)
        assert low[place] < ROCK[place] < high[place]
    assert sum(found.words.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("factors", [np.ones(6), 2.0 * ROCK])
def test_a_changed_input_is_found_at_any_level_of_loads(curves, factors):
    found = judged(curves, powers(curves.at("x16", 0.6), factors))
    assert (found.verdict, found.chosen.hypothesis.name) == ("machine", "x16")
    assert found.words["machine"] > 0.9
    low, value, high = curves.inputs["x16"].distribution.from_unit(found.chosen.quantiles)
    assert low < 0.6 < high
    assert high - low < 0.4
    assert value == pytest.approx(0.6, rel=0.2)


def test_a_sensor_that_reads_wrong_is_named(curves):
    gain = 1.4
    found = judged(curves, powers(with_gain(curves.nominal, CHANNEL, gain)))
    assert (found.verdict, found.fault, found.chosen.hypothesis.name) == ("sensor", "gain", "girder_y")
    low, _, high = map(gain_at, found.chosen.quantiles)
    assert low < gain < high


def test_a_gain_scales_the_powers_of_its_channel_only(curves):
    off = with_gain(curves.nominal, CHANNEL, 0.5)
    one, other = (each.transfer.predict(ROCK) for each in (off, curves.nominal))
    np.testing.assert_allclose(one / other, np.where(CHANNEL, 0.25, 1.0))
    still = np.zeros(len(QUIET))
    one, other = (each.covariance(ROCK, still, SECONDS) for each in (off, curves.nominal))
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-15)


def test_a_dead_sensor_is_named(curves):
    found = judged(curves, np.where(CHANNEL, 0.0, powers(curves.nominal)), np.where(CHANNEL, 0.0, QUIET))
    assert (found.verdict, found.fault, found.chosen.hypothesis.name) == ("sensor", "dead", "girder_y")


def test_a_sensor_with_too_much_noise_is_named(curves):
    values = powers(curves.nominal) + np.where(CHANNEL, 300.0 * QUIET * curves.nominal.width, 0.0)
    for stated in (UNSTATED, QUIET):
        found = judged(curves, values, np.where(CHANNEL, 301.0 * QUIET, QUIET), stated)
        assert (found.verdict, found.fault, found.chosen.hypothesis.name) == ("sensor", "noise", "girder_y")


def test_what_nobody_has_named_is_not_explained(curves):
    # Every second band power is off by a factor of its own.
    odd = np.exp(0.6 * np.random.default_rng(4).standard_normal(len(QUIET)))
    found = judged(curves, powers(curves.nominal) * odd)
    assert found.verdict == "not explained"


def test_a_recording_of_nothing_but_noise_has_no_verdict(curves):
    with pytest.raises(StudyError, match="a verdict needs 4 band powers above the sensors' noise, the recording has 0"):
        judged(curves, curves.nominal.width * QUIET)


def form(document):
    return validated(TypeAdapter(ComparisonResult), json.dumps(document), "document", StudyError)


POINT = OperatingPoint(speed=5.6 * 2.0 * np.pi / 60.0, torque=3.04e6, thrust=12e6)


def recorded(folder, machine=None):
    """Document of a recording of a machine, by default dz101."""
    values = model_values(77, 10.0, machine)
    bag = write_bag(
        folder / "bag",
        {point: values[point] for point in READING.sensors},
        rate=10_000,
        operating=[(0.0, POINT)],
    )
    return compare_recording(bag, "dz101", model_duration=2.0).result.model_dump()


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Document of a recording of a machine in a rock of half the stiffness."""
    return recorded(tmp_path_factory.mktemp("planted"), load_machine("dz101").with_inputs(x16=0.5))


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """Folder of the curves of this module."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def command(tmp_path, monkeypatch, capsys, few, cache):
    """Run a command line in a folder: its exit code, what it printed, what it complained of."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    monkeypatch.setattr("tbm_gsa.explanation.observed.SHORTEST_S", 8.0)
    monkeypatch.setattr(signal, "signal", lambda *_: None)

    def run(line):
        monkeypatch.setattr(sys, "argv", ["tbm-monitor", *line.split()])
        with pytest.raises(SystemExit) as end, simulations_here(), pictures_without_layout():
            main()
        return end.value.code, *capsys.readouterr()

    return run


def test_a_band_that_a_sensor_does_not_cover_is_not_measured(compared, monkeypatch):
    monkeypatch.setattr("tbm_gsa.explanation.observed.SHORTEST_S", 8.0)
    document = json.loads(json.dumps(compared))
    document["recording"]["points"]["girder"]["band_hz"] = [30.0, 450.0]
    seen = observed(form(document), load_machine("dz101"))
    missing = {one.name for one, floor in zip(seen.reading.statistics, seen.floor, strict=True) if np.isnan(floor)}
    assert missing == {f"rms_0.5-20_hz_girder_{axis}" for axis in "xyz"}


EXPLAIN = "gsa explain compared.json --out found --samples 60 --duration 4 --workers 1"


def test_explained_and_written_as_a_machine(compared, command, tmp_path):
    (tmp_path / "compared.json").write_text(json.dumps(compared), "utf-8")
    code, out, err = command(EXPLAIN + " --json")
    assert (code, err) == (0, "page: found/explanation.html\n")
    document = json.loads(out, parse_constant=pytest.fail)  # which JSON does not have
    assert document == json.loads((tmp_path / "found" / "explanation.json").read_text("utf-8"))
    assert json.loads(read_explanation(tmp_path / "found").model_dump_json()) == document
    first = document["causes"][0]
    assert (document["verdict"], first["input"], document["explained"]) == ("machine", "x16", True)
    assert first["interval"][0] <= 0.5 <= first["interval"][1]
    assert document["misfit"]["predicted"] < document["misfit"]["model"]
    assert document["misfit"]["checked"] < document["misfit"]["model"]
    assert document["cannot_be_told"] == ["x6"]
    assert set(document["loads"]) == set(LOAD_GROUPS)
    assert set(document["sensors"]) == {f"{point}_{axis}" for point in READING.sensors for axis in "xyz"}
    assert set(document["joint"]["inputs"]) == set(LOOKED)
    for row in document["joint"]["inputs"].values():
        assert row["lower"] <= row["interval"][0] <= row["interval"][1] <= row["upper"]
    seen = document["observable"]
    assert seen["inputs"]["x6"]["decrease"] is seen["inputs"]["x6"]["increase"] is None  # nothing feels it
    assert 0.0 < seen["inputs"]["x16"]["decrease"] < 0.5  # which was found
    assert seen["loads"]["torsion_low"]["decrease"] is None  # from sensors on the axis
    assert 0.0 < seen["loads"]["axial_low"]["increase"] < 1.0
    page = (tmp_path / "found" / "explanation.html").read_text("utf-8")
    check_page(page)
    check_widths(page)
    assert "What this recording could show" in page
    assert "machine: x16 (Stiffness of cutterhead–rock) 1 to 0." in page
    assert "cannot be told from this recording: x6" in page
    code, out, err = command("machine update --from found --out mine.yaml")
    assert (code, err) == (0, "")
    assert out.startswith("mine.yaml: x16 (Stiffness of cutterhead–rock) 1 to 0.")
    mine = load_machine(tmp_path / "mine.yaml")
    before, after = (one.assemble().natural_frequencies(40) for one in (load_machine("dz101"), mine))
    assert np.abs(after / before - 1.0).max() > 0.01
    for line, message in (
        ("gsa explain nowhere.json", "nowhere.json: No such file or directory, allowed: what `tbm-monitor compare"),
        ("gsa explain mine.yaml", "mine.yaml: not what `tbm-monitor compare BAG --json` prints (no JSON"),
        ("machine update --from found --out mine.yaml", "mine.yaml: exists already, allowed: a new file"),
        (
            "machine update --machine open380 --from found --out new.yaml",
            "found: explains another machine than open380",
        ),
        ("machine update --from found --out new.yaml --input x2", "--input x2: not among the causes"),
        (
            "machine update --from found --out new.yaml --input x16 --input x16",
            "--input x16: given twice, allowed: once",
        ),
        ("machine update --from mine.yaml --out new.yaml", "mine.yaml: not the explanation.json"),
    ):
        code, out, err = command(line)
        assert (code, out, len(err.splitlines())) == (2, "", 1), err
        assert err.startswith(f"tbm-monitor: {message}")


def amplified(compared, factor):
    """The same recording with other sensors: factors on the amplitude by point and axis."""
    document = json.loads(json.dumps(compared))
    for point, axes in document["spectra"].items():
        for axis, sides in axes.items():
            field = sides["field"]
            field["density"] = [value * factor(point, axis) ** 2 for value in field["density"]]
    return document


def test_other_words_are_said_and_write_no_machine(command, tmp_path):
    own = recorded(tmp_path)
    louder = amplified(own, lambda *_: 2.0)
    dead = amplified(own, lambda point, axis: 0.0 if (point, axis) == ("girder", "z") else 1.0)
    odd = amplified(own, lambda point, axis: 9.0 if axis == "y" else 0.2 if point == "girder" else 1.0)
    for document, verdict in ((louder, "rock"), (dead, "sensor"), (odd, "not explained")):
        (tmp_path / "compared.json").write_text(json.dumps(document), "utf-8")
        code, out, err = command(EXPLAIN)
        assert (code, err) == (0, "page: found/explanation.html\n")
        found = read_explanation(tmp_path / "found")
        assert found.verdict == verdict
        assert " ".join(out.split()).startswith(found.sentence())
        code, out, err = command("machine update --from found --out refused.yaml")
        assert (code, out, len(err.splitlines())) == (2, "", 1)
        assert err.startswith(f"tbm-monitor: {found.sentence()}")
        assert not (tmp_path / "refused.yaml").exists()
    first = next(iter(found.inputs))
    assert command(f"machine update --from found --out taken.yaml --input {first}")[0] == 0


LACKING = {
    "the operating point": lambda d: d["operating_point"].update(source="machine"),
    "2 test points, for of one nothing tells": lambda d: [
        d[part].pop("girder") for part in ("points", "spectra", "nodes", "bands")
    ],
    "15 s without a gap at one level, the recording has 10 s": lambda d: None,
    "4 s without a gap at one level at every test point": lambda d: [
        axis["field"].update(resolution_hz=1.0) for axes in d["spectra"].values() for axis in axes.values()
    ],
    "a band below 50 Hz": lambda d: [
        d["bands"]["girder"].update(high_hz=50.0),
        [axis.update(field_band_rms={}, model_band_rms={}) for axes in d["points"].values() for axis in axes.values()],
        [
            axis["intervals"].update(field_band_rms={}, model_band_rms={})
            for axes in d["points"].values()
            for axis in axes.values()
        ],
    ],
}


@pytest.mark.parametrize("lacking", LACKING)
def test_what_a_verdict_needs_is_said(compared, lacking):
    document = json.loads(json.dumps(compared))
    LACKING[lacking](document)
    with pytest.raises(StudyError, match=f"^a verdict needs {lacking}"):
        observed(form(document), load_machine("dz101"))


@pytest.mark.parametrize(
    "change", [lambda d: d.pop("bands"), lambda d: d["points"].clear(), lambda d: d.update(points=3)]
)
def test_documents_that_are_none(compared, change):
    broken = json.loads(json.dumps(compared))
    change(broken)
    with pytest.raises(StudyError, match=r"bands: missing|bands: other test points|points: 3, allowed"):
        observed(form(broken), load_machine("dz101"))


def test_a_machine_that_has_changed_since(compared, tmp_path, monkeypatch):
    monkeypatch.setattr("tbm_gsa.explanation.observed.SHORTEST_S", 8.0)
    other = {**compared, "machine_file": {**compared["machine_file"], "sha256": "0"}}
    with pytest.raises(StudyError, match="machine dz101 has changed since the comparison: compare again"):
        explain(form(other), tmp_path)


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
@pytest.mark.parametrize("planted", ["x16", "x17", "x18", "x19", "x20", "x21", "x22", "x25"])
def test_a_halved_stiffness_is_found(tmp_path_factory, planted):
    folder = tmp_path_factory.getbasetemp() / "explained"
    folder.mkdir(exist_ok=True)
    machine = load_machine("dz101").with_inputs(**{planted: 0.5})
    bag = write_bag(folder / f"{planted}.bag", model_values(77, 60.0, machine), rate=10_000, operating=[(0.0, POINT)])
    found = explain(form(compare_recording(bag, "dz101").result.model_dump()), folder)
    first = found.causes[0]
    assert (found.verdict, first.input) == ("machine", planted)
    assert first.interval[0] <= 0.5 <= first.interval[1]
    assert found.misfit.checked < found.misfit.model
