"""The live watch for a change of the machine: levels, training, restarts; minutes are drawn from a law, no signals."""

import sqlite3
import sys
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from watched_spans import MINUTE, READING, SENSORS, START, AtOnce, Minutes, curves

from tbm_dynamics import load_machine
from tbm_gsa.app.nodes import alarm_explanation, history_writer, level_watch
from tbm_gsa.app.nodes.history_writer import HistoryWriter
from tbm_gsa.app.nodes.live_watch import LiveWatch
from tbm_gsa.app.nodes.settings import WatchSettings
from tbm_gsa.app.nodes.span_gatherer import SpanGatherer
from tbm_gsa.app.nodes.watch_store import WatchStore
from tbm_gsa.explanation import training
from tbm_gsa.explanation.live_observation import FILE_NAME
from tbm_gsa.explanation.training import CurveJob
from tbm_gsa.history import History, WindowSource
from tbm_gsa.provenance import machine_sha256

COMMISSIONING = 30
DRIVEN = np.array([0.7, 4.0e6, 9.0e6])
SETTINGS = WatchSettings(commissioning=0.5, false_alarm=30.0)
LOUD = {"shield": 1.5}


@pytest.fixture(scope="module")
def machine():
    return load_machine("dz101")


class Site:
    """A node's watch with a history, at an operating point."""

    def __init__(self, machine, file):
        self.point, self.said = DRIVEN, []
        source = WindowSource("live", "/tbm/analysis_node", "", machine.name, machine_sha256(machine))
        self.history = HistoryWriter(str(file), source, self.said.append)
        store = WatchStore(self.history)
        self.watch = LiveWatch(machine, SENSORS, SETTINGS, store, lambda *_: self.point, AtOnce())

    def add(self, minute):
        """Updates after a minute."""
        self.watch.add(minute, None)
        return self.watch.poll()

    def learn(self, minute, count=COMMISSIONING):
        return [update for _ in range(count) for update in self.add(minute())]

    def close(self):
        self.watch.close()
        self.history.close()


@pytest.fixture
def kept(monkeypatch):
    """Curves are on the disk."""
    monkeypatch.setattr(level_watch, "kept_curves", lambda _, reading: curves(reading))


@pytest.fixture
def file(tmp_path):
    return tmp_path / "h.sqlite"


@pytest.fixture
def site(machine, file):
    made = Site(machine, file)
    yield made
    made.close()


def test_a_watch_learns_alarms_and_survives_a_restart(machine, kept, site, file):
    minute = Minutes()
    learnt = site.learn(minute)
    assert [update.state.commissioned for update in learnt] == [*range(1, COMMISSIONING + 1)]
    assert site.watch.doing == ""
    loud = [update for _ in range(3) for update in site.add(minute(LOUD))]
    (alarm,) = [update.raised for update in loud if update.raised]
    assert loud[-1].state.alarm.text.startswith("sensor: gain at shield x, y, z, factor 1.5")
    assert abs(alarm.since_ns - START - COMMISSIONING * MINUTE) <= 2 * MINUTE
    site.close()

    again = Site(machine, file)
    again.add(minute(LOUD))
    updates = again.add(minute(LOUD))
    again.close()
    assert {update.state.commissioned for update in updates} == {COMMISSIONING}
    assert updates[-1].state.alarm.since_ns == alarm.since_ns
    assert not any(update.raised for update in updates)
    with History(file) as history:
        assert len(history.watches()) == 1
        (stored,) = [one.entry for one in history.states() if one.entry.part == "alarm"]
    assert (stored.name, stored.since_ns) == ("sensor", alarm.since_ns)
    assert stored.value == pytest.approx(1.5, rel=0.1)


def test_a_baseline_has_a_name_and_another_one_is_learnt(kept, site):
    minute = Minutes()
    site.learn(minute)
    site.watch.set_options(SETTINGS.model_copy(update={"baseline": "repaired"}))
    assert site.watch.doing == "no minute of steady boring yet"
    assert site.learn(minute, 2)[-1].state.commissioned == 2
    assert site.watch.doing.endswith("commissioning: 2 of 30 min")
    site.watch.set_options(SETTINGS)
    assert site.learn(minute, 1)[-1].state.commissioned == COMMISSIONING


class Training:
    """A process that computes nothing."""

    code: int | None = None
    said = "12 of 126 machines"
    jobs: ClassVar[list] = []

    def __init__(self, job, folder):
        self.jobs.append(job)

    def poll(self):
        return self.code

    def progress(self):
        return self.said

    def end(self):
        self.code = 0


@pytest.fixture
def trained(monkeypatch):
    """Curves come from a process, which ends when the test says so."""
    monkeypatch.setattr(level_watch, "CurveTraining", Training)
    monkeypatch.setattr(level_watch, "kept_curves", lambda _, reading: curves(reading) if Training.code == 0 else None)
    monkeypatch.setattr(Training, "code", None)
    monkeypatch.setattr(Training, "jobs", [])
    return Training


def test_a_new_level_is_trained_and_nothing_waits_for_it(trained, site):
    minute = Minutes()
    assert site.learn(minute, 3) == []
    assert site.watch.doing == "6.68 r/min, 4e+03 kN·m, 9e+03 kN: computes the machine: 12 of 126 machines"
    trained.code = 0
    assert [update.state.commissioned for update in site.watch.poll()] == [1, 2, 3]
    trained.code = None
    site.point = 0.8 * DRIVEN
    assert site.learn(minute, 1) == []
    site.point = 1.02 * DRIVEN  # within the tolerance of the first
    assert site.learn(minute, 1)[0].state.commissioned == 4
    assert [job.torque_kn_m for job in trained.jobs] == [4000.0, 3200.0]
    trained.code = 0
    assert [update.level.level for update in site.watch.poll()] == ["5.35 r/min, 3.2e+03 kN·m, 7.2e+03 kN"]


def test_why_a_level_is_not_watched_is_said(machine, trained, site):
    minute = Minutes()
    site.point = None
    site.learn(minute, 2)
    assert "operating point is not known, or did not stay" in site.watch.doing
    site.point, trained.code, trained.said = DRIVEN, 2, "no space left"
    site.learn(minute, 2)
    assert site.watch.doing.endswith("the machine could not be computed: no space left")
    site.point = 100.0 * DRIVEN
    site.learn(minute, 2)
    assert "operating_limits" in site.watch.doing
    silent = Site(machine.with_inputs(**{"loads.moments": 0.0}), "none")
    silent.learn(minute, 2)
    assert silent.watch.doing.endswith("loads.factors: one is 0, allowed: positive ones, to be found again")
    silent.close()


def test_a_locked_history_is_waited_for_before_one_learns_anew(machine, kept, site, file, monkeypatch):
    for name in ("WAIT_S", "RETRY_S"):
        monkeypatch.setattr(history_writer, name, 0.0)
    minute = Minutes()
    site.learn(minute, 4)
    site.close()
    with sqlite3.connect(file, isolation_level=None) as other:
        other.execute("BEGIN EXCLUSIVE")
        again = Site(machine, file)
        again.learn(minute, 2)
        assert "the history cannot be read now" in again.watch.doing
        other.execute("ROLLBACK")
    assert [update.state.commissioned for update in again.learn(minute, 1)] == [5]
    again.close()


@pytest.mark.parametrize(
    ("late", "kind"), [(-50, "live"), (0, "live"), (110, "live"), (200, "replay"), (-100, "replay"), (None, "replay")]
)
def test_live_minutes_are_kept_apart_from_a_replay(kept, site, late, kind):
    minute = Minutes()
    for _ in range(2):  # the second ends then
        site.watch.add(minute(), None if late is None else START + 2 * MINUTE + late * 10**9)
    assert site.watch.current.stored.source.kind == kind


def each(points, *numbers):
    return [(point, number) for number in numbers for point in points]


@pytest.mark.parametrize(
    ("came", "over"),
    [
        (each("ab", 0, 1), [(0, "ab"), (1, "ab")]),
        (each("a", 0, 1, 2), [(0, "a"), (1, "a"), (2, "a")]),
        # b is silent from 2 on, and comes again
        (
            [*each("ab", 0, 1), *each("a", 2, 3, 4), *each("ab", 5, 6)],
            [(0, "ab"), (1, "ab"), *((now, "a") for now in range(2, 6)), (6, "ab")],
        ),
        # b comes later
        ([*each("a", 0, 1), ("b", 1), *each("ab", 2)], [(0, "a"), (1, "a"), (2, "ab")]),
        # beside three clocks that are right one is two minutes ahead, one is behind, one a year ahead
        (
            [
                pair
                for now in range(6)
                for pair in [*each("abc", now), ("d", now + 2), ("e", now - 2), ("f", now + 525_600)]
            ],
            [(0, "abc"), (1, "abc"), *((now, "abcd") for now in range(2, 6))],
        ),
        # the clock is set back
        ([*each("ab", 5, 6), *each("ab", 1, 2)], [(5, "ab"), (6, "ab"), (1, "ab"), (2, "ab")]),
    ],
)
def test_minutes_of_all_points_come_together(came, over):
    gatherer, found, spectrum = SpanGatherer(), [], Minutes()()["shield"][0]
    for point, number in came:
        found += gatherer.add({point: [replace(spectrum, start_ns=START + number * MINUTE)]})
    gathered = [((next(iter(one.values())).start_ns - START) // MINUTE, "".join(sorted(one))) for one in found]
    assert gathered == over


def test_an_alarm_is_explained_from_what_was_measured_since(machine, kept, site, tmp_path, monkeypatch, capsys):
    minute = Minutes()
    site.learn(minute)
    since = START + COMMISSIONING * MINUTE
    assert site.watch.current.observation(since) is None
    site.learn(minute, 2)
    observation = site.watch.current.observation(since)
    (tmp_path / FILE_NAME).write_text(observation.model_dump_json())
    source = alarm_explanation.observed_source(tmp_path / FILE_NAME)
    # The offset of the commissioned machine from its model is taken out: what is left is the level of the loads.
    expected = curves(READING).nominal.expected(np.ones(6), np.zeros(27))
    assert np.median(source.observed.bands.powers / expected) == pytest.approx(1.0, abs=0.2)
    assert source.observed.bands.duration_s == 120.0
    assert source.machine.description.operating_point.torque_kn_m == 4000.0

    monkeypatch.setattr(sys, "argv", ["", str(tmp_path), "1"])
    changed = observation.model_copy(
        update={"machine_file": observation.machine_file.model_copy(update={"sha256": "0"})}
    )
    (tmp_path / FILE_NAME).write_text(changed.model_dump_json())
    assert alarm_explanation.main() == 2
    assert capsys.readouterr().err == "machine dz101 has changed since the alarm\n"


def test_the_training_keeps_its_curves_or_says_why_not(monkeypatch, capsys):
    job, made = CurveJob.at("dz101", DRIVEN, READING, 1), []
    monkeypatch.setattr(sys, "argv", ["", job.model_dump_json()])
    monkeypatch.setattr(
        training, "cached_curves", lambda machine, reading, workers, say: say(1, 2) or made.append(machine)
    )
    monkeypatch.setattr(training, "kept_curves", lambda machine, reading: made[0] if reading == READING else None)
    assert training.main() == 0
    assert made[0].description.operating_point.speed_r_min == pytest.approx(6.68)
    monkeypatch.setattr(training, "kept_curves", lambda *_: None)
    assert training.main() == 2
    far = CurveJob.at("dz101", 100.0 * DRIVEN, READING, 1)
    monkeypatch.setattr(sys, "argv", ["", far.model_dump_json()])
    assert training.main() == 2
    progress, *_, unkept, limits = capsys.readouterr().err.splitlines()
    assert (progress, unkept) == (
        "1 of 2 machines",
        "the curves could not be kept, allowed: a cache folder that can be written",
    )
    assert "operating_limits" in limits
