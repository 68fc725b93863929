"""What the page is told: verdicts, expected levels, spectra, the machine's picture, the pages of a folder."""

import base64
import math
from threading import Lock
from xml.etree import ElementTree

import numpy as np
import pytest
import scipy.signal
from matplotlib.figure import Figure

from tbm_dynamics import load_machine
from tbm_gsa.app.nodes.settings import WebViewSettings
from tbm_gsa.app.web.expected import alarm_limits, usual_limits
from tbm_gsa.app.web.gathering import LOST_S, QUIET_S, Gathering
from tbm_gsa.app.web.pages import PageFolder
from tbm_gsa.app.web.picture import machine_picture
from tbm_gsa.app.web.site import MachineSite
from tbm_gsa.app.web.spectra import LOWEST_DB, STEP_DB, LiveSpectra, told_apart
from tbm_gsa.app.web.state import Acknowledgement, NodeState, Operation
from tbm_gsa.app.web.verdict import Situation, judge
from tbm_gsa.comparison import AlarmRule, UsualRatio, WindowResult
from tbm_gsa.comparison.expected import expected_lines
from tbm_gsa.history import Event, StoredEvent, WindowSource
from tbm_gsa.history.event_list import ListedEvent
from tbm_gsa.history.trends import TrendRow
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.nodes.parameters import ParameterError, read_settings

NOW, BEFORE = "2026-01-02T03:04:05.000Z", "2026-01-02T03:00:00.000Z"
SOURCE = WindowSource("live", "node", "", "dz101", "ab" * 32)


def event(kind, verdict="", point="", end_ns=None, text="what"):
    severity = "info" if kind == "rock" else "warning"
    made = Event(1_700_000_000 * 10**9, kind, point, severity, verdict, text, end_ns=end_ns)
    return ListedEvent.of(StoredEvent(1, SOURCE, made))


GONE = NodeState(name="load_node", condition="missing", text="says nothing any more", heard=BEFORE)
HERE = NodeState(name="load_node", condition="active", text="active", heard=NOW)
ALL = (
    event("rock", "rock"),
    event("machine", "machine"),
    event("dead", "sensor", "girder"),
    event("level", "", "shield"),
)


@pytest.mark.parametrize(
    ("situation", "kind", "title"),
    [
        (Situation(NOW), "well", "All well"),
        (Situation(NOW, [HERE], learning="12 of 240 minutes"), "learning", "No alarm, still learning"),
        (Situation(NOW, events=ALL[:1]), "rock", "Rock changed"),
        (Situation(NOW, events=ALL[:1], still=BEFORE), "still", "Not boring"),
        (Situation(NOW, events=ALL[3:], still=BEFORE), "level", "Level not as expected: shield"),
        (Situation(NOW, events=ALL[2:]), "sensor", "Sensor: girder"),
        (Situation(NOW, events=ALL), "machine", "Machine changed"),
        (Situation(NOW, events=[event("machine", "not explained")]), "machine", "Something changed, not explained"),
        (Situation(NOW, events=[event("rock", "rock", end_ns=10**18)]), "well", "All well"),
        (Situation(NOW, events=ALL, unseen=BEFORE), "no_data", "No data: no sensor is heard"),
        (Situation(NOW, [GONE, HERE], ALL, BEFORE), "no_data", "No data: load_node is missing"),
    ],
)
def test_the_gravest_is_said_first(situation, kind, title):
    found = judge(situation)
    assert (found.kind, found.title) == (kind, title)
    assert len(found.also) == sum(one.end is None for one in situation.events) + bool(situation.still) - (
        kind not in ("no_data", "well", "learning")
    )


def test_a_node_with_an_error_is_named_beside_the_verdict():
    faulty = NodeState(name="load_node", condition="faulty", text="active; unexpected error", heard=NOW)
    found = judge(Situation(NOW, [faulty], ALL[:1]))
    assert (found.kind, found.also) == ("rock", ("load_node: active; unexpected error",))


def test_a_verdict_stands_since_its_cause_began():
    assert judge(Situation(NOW, events=ALL)).since == ALL[0].begin
    assert judge(Situation(NOW, [GONE])).since == BEFORE
    ended = event("lost", "sensor", end_ns=1_700_000_100 * 10**9)
    assert judge(Situation(NOW, events=[ended])).since == ended.end
    first = judge(Situation(BEFORE, learning="1 of 240"))
    assert (first.since, judge(Situation(NOW, learning="2 of 240"), first).since) == (BEFORE, BEFORE)
    assert judge(Situation(NOW), first).since == NOW


def test_limits_are_those_at_which_the_alarm_counts():
    usual = {"girder": UsualRatio(np.array([0.4, 0.0, 0.0]), np.array([0.15, 0.1, 0.1]))}
    found = alarm_limits(["girder", "shield"], 0.3, "commissioning", usual)
    for point in ("girder", "shield"):
        band = found.band(point, 2.0)
        for level, over in (
            (band.low * 0.999, 1),
            (band.low * 1.001, 0),
            (band.high * 0.999, 0),
            (band.high * 1.001, 1),
        ):
            rule = AlarmRule(0.3, 1, usual, (0,))
            measured, computed, none = np.full(3, level), np.full(3, 2.0), np.zeros(3)
            rule.update(WindowResult(point, 0, 1, computed, measured, none, 1.0, 1.0, none, none))
            assert (point in rule.raised) == bool(over)
            assert (found.condition(point, level, 2.0) != "within") == bool(over)


def test_what_is_usual_needs_windows_enough():
    rows = [TrendRow("girder", place, 100, 0.9, 1.0, 1.1 + place, 1.0) for place in range(3)]
    few = [TrendRow("shield", 0, 29, 0.9, 1.0, 1.1, 1.0)]
    limits = usual_limits([*rows, *few]).limits
    assert {point: (one.low, one.high) for point, one in limits.items()} == {"girder": (0.9, 2.1)}
    assert usual_limits(few).condition("shield", 1.0, 1.0) == "unknown"


def signals(rate, seconds):
    t = np.arange(round(rate * seconds)) / rate
    x = np.sin(2 * np.pi * 14.2 * t) + 0.01 * np.random.default_rng(0).standard_normal(len(t))
    return t, np.column_stack([x, 2.0 * x, 3.0 * x])


def test_spectra_are_those_of_scipy_once_a_row():
    """Two points; the field of one never comes: rows are closed without it."""
    spectra, rate = LiveSpectra(["girder", "shield"]), 1000.0
    offsets, values = signals(rate, 13.0)
    values[7000] = math.nan  # as if that sample had been lost
    turned = np.roll(values, 1, axis=1) / 9.80665, np.roll(np.eye(3), 1, axis=1) * 9.80665
    rows = []
    for begin in range(0, len(offsets), 250):
        part = slice(begin, begin + 250)
        for point, side in (("girder", "model"), ("girder", "field"), ("shield", "model")):
            seen, matrix = turned if side == "field" else (values, np.eye(3))
            rows += spectra.add(
                point, side, round(begin / rate * 1e9), offsets[part] - offsets[begin], seen[part], matrix
            )
    assert [row.time[17:] for row in rows] == ["00.000Z"]  # the next ones wait for the shield
    frequency, density = scipy.signal.welch(values[:4000, 0], rate, nperseg=2000, detrend=False)
    code = np.frombuffer(base64.b64decode(rows[0].points["girder"]["field"]), np.uint8)
    assert len(code) == 801 and frequency[800] == 400.0
    level = 10 * np.log10(density[:801])
    assert np.abs(LOWEST_DB + STEP_DB * code - level).max() <= STEP_DB / 2 + 1e-9
    assert set(rows[0].points["shield"]) == {"model"}
    assert spectra.waterfall("girder").rows[0].points.keys() == {"girder"}
    assert not spectra.add("nowhere", "model", 0, offsets, values, np.eye(3))
    again = [row for _ in range(2) for row in spectra.add("girder", "model", 0, offsets, values, np.eye(3))]
    assert [row.time[17:] for row in again] == ["00.000Z", "00.000Z"]  # a recording that loops


def test_only_lines_that_a_row_tells_apart_are_marks(machine):
    lines = expected_lines(machine, 400.0)
    left_out = {line.name for line in lines} - {line.name for line in told_apart(lines)}
    near = {
        f"{mesh} {sign} {gear}"
        for mesh, gear in (("mesh frequency", "pinion"), ("stage 1 mesh frequency", "ring"))
        for sign in "−+"
    }
    assert left_out == near


class Clock:
    """Time of the test."""

    def __init__(self):
        self.seconds = 1_700_000_000.0

    def ns(self):
        return round(self.seconds * 1e9)

    def steady(self):
        return self.seconds


def test_nodes_and_sensors_that_go_silent_are_missed():
    clock = Clock()
    found = Gathering(["girder"], ["load_node", "analysis_node"], True, clock.ns, clock.steady)
    assert found.look().verdict.kind == "learning"
    found.learning = ""
    for _ in range(30):
        clock.seconds += 1.0
        found.hear("load_node", "active", "active")
        found.hear("analysis_node", "active", "active")
        found.hear("elsewhere", "active", "active")
        found.add_window("girder", "field", 1.0, 2.0)
        found.add_window("girder", "model", 0.5, 2.0)
        now = found.look()
    assert (now.verdict.kind, now.points[0].measured, now.points[0].computed) == ("well", 1.0, 0.5)
    for _ in range(round(QUIET_S) + 7):
        clock.seconds += 1.0
        found.hear("load_node", "active", "active")
        found.hear("analysis_node", "active", "active")
    assert found.look().verdict.title == "No data: no sensor is heard"
    found.hear("analysis_node", "inactive", "inactive")
    assert found.look().verdict.title == "No data: analysis_node is not active"
    clock.seconds += LOST_S + 1.0
    found.operation = Operation(speed_r_min=0.0, torque_kn_m=0.0, thrust_kn=0.0)
    now = found.look()
    assert now.verdict.title == "No data: no node is heard"
    assert math.isnan(now.points[0].measured)
    assert any("does not turn" in text for text in now.verdict.also)


def test_shares_are_over_the_mean_of_the_drives_that_run():
    clock = Clock()
    found = Gathering([], [], False, clock.ns, clock.steady)
    found.add_torques("model", [1.0, 3.0])
    found.add_torques("model", [1.0, 1.0])
    found.add_torques("field", [2.0, math.nan, 6.0])
    found.add_forces(np.array([1e3, 5e3]))
    found.add_forces(np.array([2e3, 4e3]))
    drives = found.look().drives
    assert [one.drive for one in drives] == ["drive_1", "drive_2", "drive_3"]
    assert [one.computed for one in drives[:2]] == pytest.approx([2.0 / 3.0, 4.0 / 3.0])
    assert [one.measured for one in drives] == pytest.approx([0.5, math.nan, 1.5], nan_ok=True)
    assert [one.tooth_force_kn for one in drives[:2]] == [2.0, 5.0]
    for _ in range(6):
        found.look()
    assert found.look().drives == ()


@pytest.mark.parametrize("name", ["dz101", "open380"])
def test_the_picture_holds_every_point_and_drive(name):
    description = load_machine(name).description
    picture = machine_picture(description)
    assert [place.point for place in picture.places] == list(description.test_points)
    kinds = [shape.kind for shape in picture.shapes]
    assert (kinds.count("head"), kinds.count("drive")) == (1, description.driveshaft.count)
    left = min(shape.x for shape in picture.shapes)
    right = max(shape.x + shape.width for shape in picture.shapes)
    assert all(left <= place.x <= right for place in picture.places)


def test_pages_are_found_by_key_and_not_by_path(tmp_path):
    folder = tmp_path / "run"
    deep = folder / "a" / "b" / "c" / "d"
    deep.mkdir(parents=True)
    (tmp_path / "secret.html").write_text("no")
    (folder / "a" / "study.html").write_text("<title>\n A &lt; B </title>")
    (deep / "deep.html").write_text("too deep")
    (folder / "link.html").symlink_to(tmp_path / "secret.html")
    (folder / "a" / "notes.txt").write_text("no page")
    pages = PageFolder(folder)
    (found,) = pages.find().pages
    assert (found.title, found.file) == ("A < B", "a/study.html")
    assert pages.read(found.key).startswith("<title>")
    assert pages.read("../secret.html") is None
    assert PageFolder(tmp_path / "nowhere").find().pages == ()


def test_a_host_that_would_be_all_is_refused():
    with pytest.raises(ParameterError, match=r"parameter host: ' ', allowed: an address or name of this computer"):
        read_settings(WebViewSettings, {"host": " "})


def test_the_drawing_is_an_svg_and_nobody_acknowledges_without_a_history(machine, tmp_path, monkeypatch):
    site = MachineSite(machine, LiveSpectra([]), tmp_path, None, Lock())
    monkeypatch.setattr("tbm_gsa.app.report.machine_drawing.draw_machine", lambda _: Figure())
    assert ElementTree.fromstring(site.drawing()).tag == "{http://www.w3.org/2000/svg}svg"
    with pytest.raises(InputError, match="allowed: `tbm-monitor events ack`"):
        site.acknowledge(Acknowledgement(id=1, by="Anna"))
    with pytest.raises(InputError, match="no such history"):
        MachineSite(machine, LiveSpectra([]), tmp_path, tmp_path / "h", Lock()).acknowledge(
            Acknowledgement(id=1, by="Anna")
        )
