"""Sensitivity of whole spectra: bands of the standard, components, exact indices by band, what is left out, a study."""

import csv
import json

import numpy as np
import pytest
import scipy.signal
import scipy.stats
from here import pictures_without_layout, simulations_here
from SALib.analyze import sobol as salib_sobol
from SALib.sample import sobol as salib_sample
from SALib.test_functions import Ishigami
from scipy.stats import qmc
from sklearn.decomposition import PCA

from tbm_gsa.app.report.gsa_spectrum_map import spectrum_maps
from tbm_gsa.comparison.results import ExpectedLine
from tbm_gsa.sensitivity.results import SpectrumBand, SpectrumResult, StudyResult
from tbm_gsa.sensitivity.sobol.closed_form import expansion_indices
from tbm_gsa.sensitivity.study import spectra
from tbm_gsa.sensitivity.study.candidates import Data
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS
from tbm_gsa.sensitivity.study.outputs import (
    expanded_outputs,
    gathered_outputs,
    spectrum_bands,
    third_octaves,
)
from tbm_gsa.sensitivity.study.spectra import analyse_spectrum
from tbm_gsa.sensitivity.surrogates.vector import Components, VectorSurrogate
from tbm_gsa.signals.band_weights import leakage
from tbm_msgs_py.base.errors import InputError

NAMES = ("spectrum_gripper_x", "MF_M")
# Of Ishigami's function in each of five bands: the two gains.
A, B = np.array([0.2, 1.0, 5.0, 0.0, 0.2]), np.array([-0.02, 0.01, -0.02, -0.05, -0.01])
BANDS = ((5.0, 10.0), (10.0, 20.0), (20.0, 40.0), (80.0, 160.0), (160.0, 320.0))


def _ishigami(unit):
    """Levels (n, 5), whose inputs act with gains that depend on the band."""
    return np.column_stack([Ishigami.evaluate(np.pi * (2.0 * unit - 1.0), a, b) for a, b in zip(A, B, strict=True)])


def _exact():
    """Partial variances (5,): all, and of the first and total indices by input (T. Ishigami, T. Homma, 1990)."""
    first = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2, A**2 / 8.0, 0.0 * A
    both = B**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    return sum(first) + both, np.array(first).T, np.array([first[0] + both, first[1], both]).T


@pytest.fixture(scope="module")
def data():
    unit = qmc.LatinHypercube(3, seed=1).random(120)
    tested = qmc.LatinHypercube(3, seed=2).random(20)
    return Data(unit, 10.0 ** (_ishigami(unit) / 20.0), tested, 10.0 ** (_ishigami(tested) / 20.0))


@pytest.fixture(scope="module")
def analysis(data):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(spectra, "FOLDS", 4)
        return analyse_spectrum(BANDS, data, seed=0)


def test_bands_are_the_third_octaves_of_the_standard():
    bands = third_octaves()
    nominal = [5, 6.3, 8, 10, 12.5, 16, 20, 25, 31.5, 40, 50, 63, 80, 100, 125, 160, 200, 250, 315, 400, 500, 630, 800]
    np.testing.assert_allclose([np.sqrt(low * high) for low, high in bands], nominal, rtol=0.015)
    assert {(8.913, 11.22), (89.13, 112.2), (707.9, 891.3)} < set(bands)  # IEC 61260-1, to four digits
    assert [low for low, _ in bands[1:]] == [high for _, high in bands[:-1]]
    assert bands[0][1] - bands[0][0] > 1.0 > 4.467 - 3.548, "the next one down is narrower"
    assert third_octaves(2000.0)[-1][1] == 1778.0


def test_a_spectrum_stands_for_its_bands():
    names = expanded_outputs(("MF_M", "spectrum_left_x_y", "rms_shield_x"))
    assert (names[0], names[1], names[-1]) == ("MF_M", "spectrum_4.467-5.623_hz_left_x_y", "rms_shield_x")
    assert expanded_outputs(names) == names
    assert gathered_outputs(names) == ("MF_M", "spectrum_left_x_y", "rms_shield_x")
    assert spectrum_bands(names) == {"spectrum_left_x_y": dict(zip(names[1:-1], third_octaves(), strict=True))}


@pytest.mark.parametrize(
    ("names", "high_hz", "message"),
    [
        (
            ["spectrum_nose_x"],
            None,
            "unknown output 'spectrum_nose_x', allowed: .*spectrum_POINT_AXIS with POINT one of",
        ),
        (["spectrum_12th_gripper_x"], None, "unknown output 'spectrum_12th_gripper_x'"),
        (["spectrum_gripper_q"], None, "unknown output 'spectrum_gripper_q'"),
        (
            ["spectrum_5-7_hz_gripper_x"],
            None,
            "'spectrum_5-7_hz_gripper_x': its band, allowed: a third octave of 1 Hz or",
        ),
        (["spectrum_gripper_x"], 5.0, "'spectrum_gripper_x': no third octave below 5 Hz, allowed: 5.623 Hz or more"),
        (["spectrum_gripper_x"], np.inf, "upper limit of the band inf Hz, allowed: 1 to below 5000 Hz"),
        (["spectrum_gripper_x", "spectrum_gripper_x"], None, "output spectrum_gripper_x: given twice, allowed: once"),
    ],
)
def test_a_spectrum_that_cannot_be_is_refused(names, high_hz, message):
    with pytest.raises(StudyError, match=message) as caught:
        MachineEvaluation.of("dz101", 3.0, 0, tuple(names), high_hz)
    assert "\n" not in str(caught.value)


def test_one_run_gives_all_bands_of_a_spectrum():
    rms = ("rms_8.913-11.22_hz_gripper_x", "rms_112.2-141.3_hz_gripper_x")
    found = MachineEvaluation.of("dz101", 1.0, 0, ("spectrum_gripper_x", "rms_0.5-1000_hz_gripper_x", *rms))({})
    bands = spectrum_bands(tuple(found))["spectrum_gripper_x"]
    assert len(bands) == 23
    for name in rms:
        assert found[name.replace("rms", "spectrum")] == found[name]
    assert 0.5 < sum(found[name] ** 2 for name in bands) / found["rms_0.5-1000_hz_gripper_x"] ** 2 < 1.0


def test_leakage_is_that_of_scipy_s_welch():
    bands, rate = ((5.0, 9.0), (9.0, 12.0), (12.0, 15.0), (40.0, 60.0)), 256.0
    frequency = np.arange(9.0, 12.0, 0.125) + 0.0625
    lines = np.sqrt(2.0) * np.cos(2.0 * np.pi * np.outer(frequency, np.arange(40 * rate) / rate) + 0.3)
    bins, density = scipy.signal.welch(lines, rate, nperseg=int(rate), detrend=False)
    shown = [density[:, (bins >= low) & (bins < high)].sum(axis=1).mean() for low, high in bands]
    found = leakage(bands, 1.0)
    assert not found.diagonal().any()
    np.testing.assert_allclose(np.delete(found[:, 1], 1), np.delete(shown, 1), rtol=0.06)


def test_components_are_those_of_scikit_learn(data):
    level = _ishigami(data.unit) + np.random.default_rng(0).normal(size=(120, 5))
    found, reference = Components.of(level, 0.9), PCA(n_components=0.9, svd_solver="full")
    scores = reference.fit_transform(level)
    np.testing.assert_allclose(found.shares, reference.explained_variance_ratio_)
    np.testing.assert_allclose(np.abs(found.scores), np.abs(scores), atol=1e-9)
    np.testing.assert_allclose(np.abs(found.shapes.T), np.abs(reference.components_), atol=1e-9)
    np.testing.assert_allclose(found.mean + found.scores @ found.shapes.T, reference.inverse_transform(scores))


def test_indices_of_every_band_are_the_exact_ones(analysis):
    variance, first, total = _exact()
    assert len(analysis.components.shares) == 3, "three functions of the inputs"
    for part, whole, firsts, totals in zip(analysis.by_band, variance, first, total, strict=True):
        np.testing.assert_allclose(part.indices.first, firsts / whole, atol=0.02)
        np.testing.assert_allclose(part.indices.total, totals / whole, atol=0.02)
        assert part.r2_cv > 0.95
    # Of the whole spectrum: Lamboni, Monod, Makowski 2011, the bands' partial variances added up.
    np.testing.assert_allclose(analysis.whole.indices.first, first.sum(axis=0) / variance.sum(), atol=0.02)
    np.testing.assert_allclose(analysis.whole.indices.total, total.sum(axis=0) / variance.sum(), atol=0.02)
    assert analysis.whole.indices.variance == pytest.approx(variance.sum(), rel=0.05)
    assert analysis.r2_test > 0.95
    for part in (*analysis.by_band, *analysis.by_component, analysis.whole):
        for value, (low, high) in zip(part.indices.total, part.indices.total_interval, strict=True):
            assert 0.0 <= low <= value + 1e-12
            assert value - 1e-12 <= high <= 1.0 + 1e-12


def test_realisations_of_the_loads_are_taken_off(monkeypatch):
    """Terms of variance 1 with gains by band, and a realisation's effect of half their variance: squares are exact."""
    monkeypatch.setattr(spectra, "FOLDS", 4)
    generator = np.random.default_rng(5)
    gains = np.array([[2.0, 1.0, 0.5, 1.0, 3.0], [0.5, 1.0, 2.0, 1.0, 0.0], [0.0, 1.0, 0.0, 2.0, 1.0]])
    variance = np.square(gains).sum(axis=0)
    effects = generator.normal(size=(12, 5)) * np.sqrt(0.5 * variance)

    def simulated(count):
        unit, labels = qmc.LatinHypercube(3, seed=count).random(count), generator.permutation(np.arange(count) % 12)
        centred = 2.0 * unit - 1.0
        terms = np.sqrt(3.0) * centred[:, 0], np.sqrt(3.0) * centred[:, 1], 3.0 * centred[:, 0] * centred[:, 2]
        return unit, 10.0 ** ((np.array(terms).T @ gains + effects[labels]) / 20.0), labels

    (unit, rms, labels), (tested, test_rms, test_labels) = simulated(120), simulated(24)
    data = Data(unit, rms, tested, test_rms)
    told, untold = (analyse_spectrum(BANDS, data, 0, known) for known in ((labels, test_labels), None))
    shares = np.square(gains) / variance
    for part, (first, second, both) in zip(told.by_band, shares.T, strict=True):
        np.testing.assert_allclose(part.indices.first, [first, second, 0.0], atol=0.03)
        np.testing.assert_allclose(part.indices.total, [first + both, second, both], atol=0.03)
    assert min(told.whole.r2_cv, told.r2_test) > 0.95
    assert max(untold.whole.r2_cv, untold.r2_test) < 0.75


def test_effects_are_shrunk_as_an_analysis_of_variance_has_it():
    generator = np.random.default_rng(5)
    labels = np.arange(120) % 12
    residuals = generator.normal(size=(12, 3))[labels] + generator.normal(size=(120, 3))
    found = spectra.realisation_effects(residuals, labels)
    groups = np.array([residuals[labels == label] for label in range(12)])
    means = groups.mean(axis=1) - groups.mean(axis=(0, 1))
    ratio = scipy.stats.f_oneway(*groups).statistic  # of groups of one size: the shrinkage is 1 − 1 / F
    np.testing.assert_allclose(found, (1.0 - 1.0 / ratio) * means)


def test_salib_finds_the_same_on_the_rebuilt_bands(data):
    level = _ishigami(data.unit)
    surrogate = VectorSurrogate.fit(data.unit, level, 0)
    problem = {"num_vars": 3, "names": ["a", "b", "c"], "bounds": [[0.0, 1.0]] * 3}
    values = surrogate.evaluate(salib_sample.sample(problem, 2048, calc_second_order=False, seed=1))
    shape = Components.of(level).shapes[:, 0]
    for direction in (*np.eye(5), shape):
        found = expansion_indices(surrogate.along(direction))
        sampled = salib_sobol.analyze(problem, values @ direction, calc_second_order=False, num_resamples=2, seed=1)
        np.testing.assert_allclose(found.first, sampled["S1"], atol=0.01)
        np.testing.assert_allclose(found.total, sampled["ST"], atol=0.01)


def test_bands_with_nothing_of_their_own_are_named():
    unit = qmc.LatinHypercube(2, seed=1).random(30)
    loud = np.exp(unit[:, 0])
    shares = leakage(BANDS, 1.0)
    rms = np.column_stack([loud, loud * np.sqrt(0.5 * shares[1, 0]), np.full(30, 0.1), 1e-5 * loud, 0.1 * loud])
    rms[3, 4] = 0.0
    found = analyse_spectrum(BANDS, Data(unit, rms, unit[:0], rms[:0]), seed=0)
    assert (found.bands, found.r2_test) == (BANDS[:1], None)
    never, *left_out = found.left_out
    assert never.startswith("below 5, above 320 Hz: ")
    assert left_out == [
        "10–20, 80–160 Hz: quiet (80 dB below the loudest, or masked by leakage)",
        "20–40 Hz: constant",
        "160–320 Hz: no motion in some simulation",
    ]
    with pytest.raises(InputError, match=r"^5–40, 80–320 Hz: constant$"):
        analyse_spectrum(BANDS, Data(unit, np.ones((30, 5)), unit[:0], rms[:0]), seed=0)
    with pytest.raises(InputError, match="9 samples for a surrogate, allowed: at least 10"):
        analyse_spectrum(BANDS, Data(unit[:9], rms[:9], unit[:0], rms[:0]), seed=0)


def test_text_and_map_say_which_input_leads_where():
    def band(k, total, r2):
        low, high = third_octaves()[k]
        return SpectrumBand.model_construct(low=low, high=high, total=total, r2_cv=r2)

    x2, x16 = {"x2": 0.91, "x16": 0.001}, {"x2": 0.02, "x16": 0.85}
    bands = (band(0, x2, 0.9), band(1, x2, 0.8), band(2, x16, 0.7), band(3, x2, 0.1), band(5, x2, 0.9))
    result = SpectrumResult.model_construct(bands=bands, components=(None,) * 2, held=0.9912, total=x2)
    assert result.text() == (
        "x2 leads in 4.467–7.079, 14.13–17.78 Hz, x16 leads in 7.079–8.913 Hz, not determined in 8.913–11.22 Hz; "
        "2 components hold 99.1% of the variance"
    )
    lines = [ExpectedLine(name=str(hz), frequency_hz=hz, kind="mesh") for hz in (3.0, 5.0, 18.0)]
    (panel,) = spectrum_maps({"s": result}, PAPER_INPUTS, lines).axes
    assert [text.get_text() for text in panel.texts] == ["0.91", "0.91", "0.85", "0.91"], "none where it is unknown"
    assert [text.get_text() for text in panel.get_xticklabels()] == ["5", "6.3", "8", "10", "16"]
    cells, ticks = panel.collections
    assert (len(cells.get_paths()), len(ticks.get_segments())) == (5, 1)


def _analytic(self, sample, realisation=None):
    """Every band from 10 to 100 Hz is a product of powers of two inputs, the others lie far below; a constant MF_M."""
    levels = {}
    for name, (low, _) in spectrum_bands(self.outputs)["spectrum_gripper_x"].items():
        share = np.clip(np.log10(low / 8.9), 0.0, 1.0)
        x2, x16 = sample["x2"] / 1000.0, sample["x16"]
        levels[name] = x2 ** (1.0 - share) * x16**share if 8.0 < low < 100.0 else 1e-6
    return {name: 1.0 if name == "MF_M" else levels[name] for name in self.outputs}


def test_a_study_of_a_spectrum_from_command_to_report(tmp_path, typed, monkeypatch):
    monkeypatch.setattr(MachineEvaluation, "__call__", _analytic)
    monkeypatch.setattr(spectra, "FOLDS", 4)
    inputs = tmp_path / "study.yaml"
    inputs.write_text(f"inputs: {{x2, x16}}\noutputs: [{', '.join(NAMES)}]\n")
    out = tmp_path / "study"
    sizes = ("--samples", "24", "--test", "4", "--workers", "1")
    with simulations_here(), pictures_without_layout():
        code, shown, _ = typed("gsa", "run", *sizes, "--inputs", str(inputs), "--out", str(out))
    assert code == 0
    shown = " ".join(shown.split())
    assert "output MF_M is left out: the output is constant (1)" in shown
    assert "spectrum_gripper_x: x2 leads in 8.913–" in shown
    assert "left out: below 4.467, above 891.3 Hz: no third octave of 1 Hz or more" in shown
    result = json.loads((out / "result.json").read_text())
    assert (result["outputs"], list(result["spectra"])) == ({}, ["spectrum_gripper_x"])
    found = result["spectra"]["spectrum_gripper_x"]
    assert [found["bands"][0]["low"], found["bands"][-1]["high"]] == [8.913, 112.2]
    assert [max(band["total"], key=band["total"].get) for band in (found["bands"][0], found["bands"][-1])] == [
        "x2",
        "x16",
    ]
    assert min(found["r2_cv"], found["r2_test"]) > 0.99
    assert StudyResult.read(out / "result.json").spectra["spectrum_gripper_x"].held == found["held"]
    rows = list(csv.DictReader((out / "tables/spectra.csv").read_text().splitlines()))
    assert {row["part"] for row in rows} >= {"whole", "component 1", "band"}
    (row,) = (row for row in rows if row["low_hz"] == "8.913" and row["input"] == "x2")
    assert float(row["ST"]) == found["bands"][0]["total"]["x2"]
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 2, "the map and the machine"
    assert "Strongest parameters" not in page
    assert "x2 leads in 8.913–" in page
