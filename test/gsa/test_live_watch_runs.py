"""The live path on runs of a machine, with its curves from a process: noise, loads, and a worn bearing explained.

Truths are those put in: sensors of 100 µg/√Hz, loads as in the machine file, the main bearing at 0.6 of its stiffness.
"""

import sys
import time

import numpy as np
import pytest
from watched_spans import AtOnce

from tbm_dynamics import Simulator, load_machine
from tbm_gsa.app.nodes import alarm_explanation
from tbm_gsa.app.nodes.history_writer import HistoryWriter
from tbm_gsa.app.nodes.level_watch import SPAN_S
from tbm_gsa.app.nodes.live_watch import LiveWatch
from tbm_gsa.app.nodes.settings import WatchSettings
from tbm_gsa.app.nodes.watch_store import WatchStore
from tbm_gsa.comparison import WindowedComparison
from tbm_gsa.explanation.live_observation import FILE_NAME, LiveObservation
from tbm_gsa.explanation.result import PAGE_NAME, read_explanation
from tbm_gsa.explanation.training import CurveJob
from tbm_gsa.history import WindowSource
from tbm_msgs_py.recordings.mapping import contract_sensor

SECOND = 10**9
NOISE = 1e-4 * 9.81  # m/s²/√Hz
STRIDE, RATE = 4, 2500.0


def minutes(machine, seed, count):
    """Spectra of whole minutes of all test points."""
    places = machine.description.sensor_places
    simulator, loads = Simulator(machine.assemble(), [one.node for one in places.values()]), machine.loads(seed)
    comparison, random = WindowedComparison(2.0), np.random.default_rng(seed)
    for second in range(round(SPAN_S) * count + 12):
        motion = simulator.step(loads.evaluate(second + np.arange(10_000) * 1e-4)).acceleration[::STRIDE, :, :3]
        motion = motion + NOISE * np.sqrt(0.5 * RATE) * random.standard_normal(motion.shape)
        for number, point in enumerate(places):
            stamp = (60_000_048 + second) * SECOND  # what is left out of the start ends with a minute
            comparison.feed(point, "field", stamp, np.arange(len(motion)) / RATE, motion[:, number])
    found = {}
    for point, spans in comparison.pop_spans().items():
        for one in spans:
            found.setdefault(one.start_ns, {})[point] = one
    return [spectra for spectra in found.values() if all(one.enough for one in spectra.values())]


@pytest.mark.verify
def test_a_worn_bearing_is_told_from_live_minutes(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    machine = load_machine("dz101")
    own = machine.operating_point
    history = HistoryWriter("none", WindowSource("live", "", "", "", ""), print)
    sensors = {point: contract_sensor(point) for point in machine.description.test_points}
    level = np.array([own.speed, own.torque, own.thrust])
    watch = LiveWatch(machine, sensors, WatchSettings(), WatchStore(history), lambda *_: level, AtOnce())
    for spectra in minutes(machine, 7, 3):
        watch.add({point: [one] for point, one in spectra.items()}, None)
    updates = []
    for _ in range(6000):  # until the process has computed the curves
        updates = watch.poll()
        if updates or watch.current.problem:
            break
        time.sleep(0.1)
    live, loads = watch.current.stored.live, {one.name: one.value for one in updates[-1].state.loads}
    watch.close()
    np.testing.assert_allclose(np.sqrt(live.noise), NOISE, rtol=0.05)
    assert [loads[name] for name in ("axial_high", "lateral")] == pytest.approx([1.0, 1.0], abs=0.15)

    worn = minutes(machine.with_inputs(x22=0.6), 8, 3)
    job = CurveJob.at("dz101", level, live.reading, 2)
    rows = [live.log_powers(one) for one in worn]
    observed = LiveObservation.of(machine, job, live, rows, live.floor(worn[-1]), SPAN_S, 1_700_000_000 * 10**9)
    (tmp_path / FILE_NAME).write_text(observed.model_dump_json())
    monkeypatch.setattr(sys, "argv", ["", str(tmp_path), "2"])
    assert alarm_explanation.main() == 0
    found = read_explanation(tmp_path)
    assert (found.verdict, found.causes[0].input) == ("machine", "x22")
    low, high = found.causes[0].interval
    assert low < 0.6 < high
    assert "recorded from 2023-11-14T22:13:20.000Z" in (tmp_path / PAGE_NAME).read_text("utf-8")
