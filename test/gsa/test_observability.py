"""What sensors can see: torsion off the axis only, more in a longer recording, and bad input in one line."""

import json
import math
import sys
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import numpy as np
import pytest

from tbm_dynamics import Machine, load_machine, simulate
from tbm_dynamics.loads.description import LOAD_GROUPS
from tbm_gsa.app.cli.main import main
from tbm_gsa.explanation.band_reading import BandReading, Sensor
from tbm_gsa.explanation.detection import Detection
from tbm_gsa.explanation.load_posterior import BandObservation, load_posterior
from tbm_gsa.explanation.load_scatter import load_scatter
from tbm_gsa.explanation.load_transfer import load_transfer, machine_motion
from tbm_gsa.explanation.observability import ObservationSettings, SensorChoice, observability
from tbm_gsa.explanation.observability_result import Observability
from tbm_gsa.sensitivity.study.workers import WorkerPool, mapped
from tbm_gsa.signals.reduction import SignalReducer
from tbm_gsa.signals.settings import Settings
from tbm_msgs_py.base.errors import InputError

CHANGED = ("x16", "x21")
ASIDE = SensorChoice("cutterhead", (0.0, 1.0, 0.0))


class FewMachines:
    """Computes the machines with two of the inputs changed once; the others are taken as the machine itself."""

    def __init__(self):
        self.known = {}

    def __call__(self, function, machines):
        return [self.powers(function, machine) for machine in machines]

    def powers(self, function, machine):
        ((code, value),) = machine.inputs.items()
        key = (code, value) if code in CHANGED else None
        if key not in self.known:
            self.known[key] = function(machine if key else Machine(machine.base))
        return self.known[key]


@pytest.fixture(scope="module")
def seen():
    """By length of the recording: sensors at cutterhead and gripper, and one more that sits off the axis."""
    run, sensors = FewMachines(), [SensorChoice("cutterhead"), SensorChoice("gripper")]
    machine = load_machine("dz101")
    return {
        duration: observability(machine, sensors, [*sensors, ASIDE], ObservationSettings(duration_s=duration), run)
        for duration in (15.0, 60.0)
    }


def test_only_what_changes_the_vibration_is_seen(seen):
    found = seen[60.0]
    assert {code for code, one in found.inputs.items() if one.found} == set(CHANGED)
    assert math.isnan(found.inputs["x17"].hidden_by_loads)
    for code in CHANGED:
        assert 0.02 < found.inputs[code].decrease < 0.5
        assert (1.0 - found.inputs[code].decrease) * (1.0 + found.inputs[code].increase) == pytest.approx(1.0)
        assert 0.0 < found.inputs[code].hidden_by_loads < 1.0
    assert not set(found.statistics) & set(found.unused)
    assert len(found.statistics) + len(found.unused) == 2 * 3 * 4


def test_a_longer_recording_shows_smaller_changes(seen):
    for code in CHANGED:
        assert seen[60.0].inputs[code].decrease < seen[15.0].inputs[code].decrease
    assert seen[60.0].loads["lateral"].decrease < seen[15.0].loads["lateral"].decrease


def test_torsion_is_seen_off_the_axis_only(seen):
    found = seen[60.0]
    assert not found.loads["torsion_low"].found
    (more,) = found.candidates  # where a sensor is already is no place for another
    assert more.name == "cutterhead at (0, 1, 0)"
    assert "torsion_low" in more.loads
    assert more.bits > 0.0
    assert all(factor > 0.99 for factor in more.smaller.values())


def test_what_is_seen_is_printed_and_read_back(seen, monkeypatch, capsys):
    monkeypatch.setattr("tbm_gsa.explanation.observability.observability", lambda *_: seen[60.0])
    monkeypatch.setattr("signal.signal", lambda *_: None)
    texts = []
    for options in ([], ["--json"]):
        monkeypatch.setattr(sys, "argv", ["tbm-monitor", "machine", "observe", "dz101", "--workers", "1", *options])
        with pytest.raises(SystemExit) as end:
            main()
        assert not end.value.code
        texts.append(capsys.readouterr().out)
    assert Observability.model_validate_json(json.dumps(json.loads(texts[1])), strict=False) == seen[60.0]
    shown = texts[0]
    for text in ("x16", "not seen within their range: x4", *LOAD_GROUPS, "cutterhead at (0, 1, 0)", "100 µg/√Hz"):
        assert text in shown


@pytest.mark.parametrize(
    ("sensors", "settings", "line"),
    [
        ([], {}, "no sensor, allowed: at least one test point"),
        ([SensorChoice("roof")], {}, "test point 'roof': machine dz101 has cutterhead"),
        ([SensorChoice("girder"), SensorChoice("girder", (0.0, 0.0, 0.0))], {}, "sensor girder: given twice"),
        ([ASIDE], {"duration_s": 3.0}, "recording of 3 s, allowed: at least a segment of 4 s"),
        ([ASIDE], {"duration_s": math.nan}, "recording of nan s"),
        ([ASIDE], {"noise_density": -1.0}, "noise density -1"),
        ([ASIDE], {"model_error": 0.0}, "model error 0"),
    ],
)
def test_what_cannot_be_observed_is_one_line(sensors, settings, line):
    with pytest.raises(InputError, match=line):
        observability(load_machine("dz101"), sensors, (), ObservationSettings(**settings))


def test_noise_over_everything_is_said():
    with pytest.raises(InputError, match="no band power above the sensors' noise"):
        observability(
            load_machine("dz101"),
            [SensorChoice("gripper")],
            (),
            ObservationSettings(noise_density=10.0),
            lambda function, machines: [np.ones(12) for _ in machines],
        )


def test_results_of_processes_are_in_order():
    with ThreadPoolExecutor(2) as executor:
        pool = WorkerPool(executor, 2, (BrokenProcessPool,), 0)
        assert mapped(pool, str, range(5)) == list("01234")
        assert mapped(pool, str, []) == []


@pytest.mark.verify
@pytest.mark.parametrize("code", ["x16", "x21"])
def test_the_smallest_change_is_found_in_recordings(code):
    """Eight recordings of 60 s with the change, eight without, other rock in each; matched filter on their bands."""
    machine, noise_density, runs = load_machine("dz101"), 100e-6 * 9.80665, 8
    points, settings = ("cutterhead", "shield", "walkway", "girder", "gripper"), ObservationSettings()
    told = observability(machine, [SensorChoice(point) for point in points])
    reading = BandReading({point: Sensor() for point in points}, machine.description.loads.bands)
    scatter, prior = load_scatter(machine_motion(machine, reading)), machine.description.loads.factors
    noise = np.full(len(reading.statistics), noise_density**2)
    expected = scatter.expected(prior.values, noise)
    found = load_posterior(BandObservation(expected, noise, 60.0), scatter, prior)
    used, step = found.used, 1.1
    less, more = (
        load_transfer(machine.with_inputs(**{code: value}), reading).predict(prior.values) + scatter.width * noise
        for value in (1.0 / step, step)
    )
    slope = (np.log(more / less) / (2.0 * np.log(step)))[used]
    loads = 2.0 * scatter.transfer.gain[:, used] / expected[used]

    def recorded(value, seed):
        rng = np.random.default_rng(seed)
        rock = {f"loads.{group}": float(np.exp(0.15 * rng.standard_normal())) for group in LOAD_GROUPS}
        varied = machine.with_inputs(**{code: value}, **rock)
        response = simulate(varied, 62.0, seed, outputs=varied.description.test_points.values())
        signals = {}
        for point, node in varied.description.test_points.items():
            values = response.acceleration(node)[20_000:, :3]
            values = values + noise_density * np.sqrt(5e3) * rng.standard_normal(values.shape)
            reducer = SignalReducer(1e4, reading.band, "fixed", Settings())
            reducer.feed(np.arange(len(values)) * 1e-4, values)
            signals[point] = reducer.finish()
        return np.log(reading.of(signals)[used] / expected[used])

    decrease = told.inputs[code].decrease
    rows = [recorded(value, seed) for value in (1.0, 1.0 - decrease) for seed in range(100, 100 + runs)]
    moves = Detection.of(np.vstack([slope, *rows]), found.scatter, loads, prior.log_sigma).moves
    size = np.linalg.norm(moves[0])
    same, changed = np.split(moves[1:] @ moves[0] / size, 2)
    estimate, spread = (changed - same).mean() / size, 1.0 / (size * np.sqrt(runs))
    assert estimate == pytest.approx(np.log1p(-decrease), abs=3.0 * spread)
    assert same.std() < 1.3
    assert settings.probability - 0.25 < np.mean(np.abs(changed) > 2.9)
