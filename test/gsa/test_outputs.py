"""Outputs of a study by name: against a comparison of the same run, and unknown names."""

import numpy as np
import pytest
from compared_signals import compared as compare

from tbm_dynamics import load_machine, simulate
from tbm_dynamics.indicators import INDICATORS
from tbm_dynamics.machine.loading import machine_text
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_gsa.sensitivity.study.outputs import parse_outputs
from tbm_gsa.signals.settings import Settings

DURATION, HIGH_HZ = 1.5, 600.0
SAMPLE = {"x2": 1800.0, "x16": 1.4}


@pytest.fixture(scope="module")
def response():
    return simulate(load_machine("dz101").with_inputs(**SAMPLE), duration=DURATION, seed=3)


@pytest.fixture(scope="module")
def compared(response):
    """A comparison's own statistics of the run, at a sensor that is fixed and one that turns."""
    signals = {
        point: (response.time, response.acceleration(node)[:, :3])
        for point, node in load_machine("dz101").description.test_points.items()
    }
    settings = Settings(high_hz=HIGH_HZ, bands=load_machine("dz101").driven_loads.bands)
    return {
        frame: {point: compare(signal, signal, frame, settings) for point, signal in signals.items()}
        for frame in ("fixed", "rotating")
    }


def test_statistics_are_those_of_a_comparison(compared):
    points = ("cutterhead", "gripper")
    names = {}
    for frame, axes in (("fixed", "xyz"), ("rotating", ("x", "yz"))):
        for point in points:
            for axis in axes:
                found = compared[frame][point].axes[axis]
                statistics = ("rms", "peak", "kurtosis")
                names |= {f"{name}_{point}_{axis}": getattr(found, f"model_{name}") for name in statistics}
                names |= {f"rms_{band}_{point}_{axis}": value for band, value in found.model_band_rms.items()}
    assert len(names) == 2 * (3 + 1) * (3 + 4)
    evaluate = MachineEvaluation.of("dz101", DURATION, 3, tuple(names), HIGH_HZ)
    found = evaluate(SAMPLE)
    assert list(found) == list(names)
    for name, value in names.items():
        assert found[name] == pytest.approx(value, rel=1e-6), name


def test_a_sensor_off_its_node_is_simulated_there(response, tmp_path):
    file = tmp_path / "machine.yaml"
    file.write_text(machine_text("dz101").replace("girder: 47", "girder: {node: 47, offset: [0, 1.2, 0]}"))
    (found,) = MachineEvaluation.of(str(file), DURATION, 3, ("rms_girder_x",), HIGH_HZ)(SAMPLE).values()
    motion = response.acceleration(47)
    signal = response.time, np.column_stack([motion[:, 0] - 1.2 * motion[:, 5], motion[:, 1:3]])
    expected = compare(signal, signal, "fixed", Settings(high_hz=HIGH_HZ)).axes["x"].model_rms
    assert found == pytest.approx(expected, rel=1e-6)


def test_indicators_are_those_of_the_run(response):
    found = MachineEvaluation.of("dz101", DURATION, 3, ("MF_M", "rms_shield_x", "RDef_A"))(SAMPLE)
    assert list(found) == ["MF_M", "rms_shield_x", "RDef_A"]
    expected = response.indicators()
    assert found["MF_M"] == pytest.approx(expected["MF_M"], rel=1e-9)
    assert found["RDef_A"] == pytest.approx(expected["RDef_A"], rel=1e-9)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "rms_cutterhead_q",
            "unknown output 'rms_cutterhead_q', allowed: RDef_A, .* and AXIS one of x, y, z, yz",
        ),
        ("rms_nose_x", "unknown output 'rms_nose_x'.* POINT one of cutterhead, shield, walkway, girder, gripper"),
        ("mean_cutterhead_x", "unknown output 'mean_cutterhead_x'"),
        ("RDef", "unknown output 'RDef'"),
        ("peak_1-2_hz_shield_x", "its band, allowed: of rms only"),
        ("rms_20-10_hz_shield_x", "allowed: of rms only, the lower limit below the upper"),
        ("rms_2000-3000_hz_shield_x", "its band, allowed: inside the compared one, 0.5 to 1000 Hz"),
        ("rms_900-1001_hz_shield_x", "its band, allowed: inside the compared one, 0.5 to 1000 Hz"),
        ("rms_0.1-0.4_hz_shield_x", "its band, allowed: inside the compared one, 0.5 to 1000 Hz"),
        ("rms_100.3-100.9_hz_shield_x", "its band, allowed: 1 Hz wide or more"),
    ],
)
def test_unknown_names_are_refused_in_one_line(name, message):
    with pytest.raises(StudyError, match=message) as caught:
        MachineEvaluation.of("dz101", 3.0, 0, (name,))
    assert "\n" not in str(caught.value)


def test_the_band_that_is_compared_can_be_moved():
    name = ("rms_2000-3000_hz_shield_x",)
    assert MachineEvaluation.of("dz101", 3.0, 0, name, 3000.0).outputs == name
    with pytest.raises(StudyError, match=r"inside the compared one, 0\.5 to 600 Hz"):
        MachineEvaluation.of("dz101", 3.0, 0, name, HIGH_HZ)


def test_names_with_underscores_and_fractions():
    (output,) = parse_outputs((*INDICATORS, "rms_0.5-20_hz_front_panel_yz"), ["front_panel"])
    assert (output.point, output.axis, output.band, output.statistic) == ("front_panel", "yz", (0.5, 20.0), "rms")


def test_a_run_that_is_too_short_for_statistics():
    with pytest.raises(StudyError, match=r"duration 0\.5 s, allowed: 1 s or more for accelerations"):
        MachineEvaluation.of("dz101", 0.5, 0, ("rms_shield_x",))
    assert MachineEvaluation.of("dz101", 0.5, 0).outputs == INDICATORS


@pytest.mark.parametrize("high_hz", [0.5, 5000.0, float("nan")])
def test_a_band_that_the_model_does_not_carry(high_hz):
    with pytest.raises(StudyError, match=r"upper limit of the band .* Hz, allowed: 1 to below 5000 Hz"):
        MachineEvaluation.of("dz101", 3.0, 0, ("rms_shield_x",), high_hz)


def test_settings_make_the_evaluation_again():
    evaluate = MachineEvaluation.of("dz101", DURATION, 3, ("MF_M",), HIGH_HZ)
    assert MachineEvaluation.from_settings(evaluate.settings, ("MF_M",)) == evaluate
    plain = MachineEvaluation.of("dz101", DURATION, 3)
    assert MachineEvaluation.from_settings(plain.settings, INDICATORS) == plain


def test_a_machine_that_has_changed_is_refused():
    evaluate = MachineEvaluation.of("dz101", DURATION, 3)
    with pytest.raises(StudyError, match="machine dz101 has changed since the study was begun"):
        MachineEvaluation.from_settings({**evaluate.settings, "machine_sha256": "0"}, INDICATORS)


def test_values_no_machine_can_have_are_refused_at_once():
    evaluate = MachineEvaluation.of("dz101", DURATION, 3)
    evaluate.check({"x16": (0.5, 2.0), "x6": (0.29, 0.31)})
    with pytest.raises(StudyError, match=r"input x6 at 0\.6: .*poisson"):
        evaluate.check({"x6": (0.29, 0.6)})
    with pytest.raises(StudyError, match=r"input x16 at 0: .*multiplier must be positive"):
        evaluate.check({"x16": (0.0, 2.0)})
