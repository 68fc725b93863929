"""Parts of the analysis node, without ROS: the live comparison, the alarm, the study process."""

import json
import sys

import numpy as np
import pytest

from tbm_gsa.app.nodes import gsa_process
from tbm_gsa.app.nodes.error_alarm import ErrorAlarm
from tbm_gsa.app.nodes.frame_choice import FrameChoice
from tbm_gsa.app.nodes.gsa_process import GsaProcess
from tbm_gsa.app.nodes.live_comparison import LiveComparison, field_sensors
from tbm_gsa.app.nodes.settings import GsaSettings
from tbm_gsa.app.nodes.stream_health import Condition
from tbm_gsa.comparison import dead_axes
from tbm_gsa.explanation.live_observation import LiveObservation
from tbm_gsa.history import live_entries
from tbm_msgs_py import topics

RATE, SECOND = 1000, 10**9
OFFSETS = np.arange(RATE) / RATE
SINE = np.sin(2.0 * np.pi * 50.0 * OFFSETS)[:, None] * np.ones(3)


@pytest.fixture
def compare():
    """Windows of half a second of sines of known amplitudes, the first ones left out while filters settle."""

    def run(point="girder", operating=((1.0, 1.0, 1.0),), **sensor):
        sensors, _ = field_sensors("", ["girder"])
        sensors = {name: one.model_copy(update=sensor) for name, one in sensors.items()}
        comparison = LiveComparison(["girder"], sensors.values(), 0.5, lambda _: None)
        for k, driven in enumerate(operating):
            comparison.add_operating_point(topics.OPERATING_POINT, k * SECOND, driven, 0)
        sensor = sensors["field/girder/block"].model_copy(update={"point": point})
        for k in range(10):
            comparison.add(sensor, "model", k * SECOND, OFFSETS, 3.0 * SINE)
            comparison.add(sensor, "field", k * SECOND, OFFSETS, 2.0 * SINE)
        return comparison

    return run


def test_sines_have_the_error_of_their_amplitudes(compare):
    latest = compare().latest["girder"]
    np.testing.assert_allclose(latest.relative_error, 0.5, rtol=1e-2)
    assert latest.operation == "steady"


def test_a_machine_that_stands_still_has_no_error(compare):
    latest = compare(operating=[(0.0, 0.0, 0.0)]).latest["girder"]
    assert latest.operation == "standstill"
    assert np.isnan(latest.relative_error).all()


@pytest.mark.parametrize(
    ("sensor", "measured"),
    [
        ({"axes": ("x", None, "z")}, [True, False, True]),
        ({"axes": (None, "-x", None)}, [False, True, False]),
        ({"axes": ("x", "y", None), "frame": "rotating"}, [True, False, False]),
        ({"axes": ("x", None, "z"), "rotation": (90.0, 0.0, 0.0)}, [True, True, False]),
        ({"axes": ("x", None, "z"), "rotation": (45.0, 0.0, 0.0)}, [True, False, False]),
    ],
)
def test_an_axis_that_the_sensor_lacks_is_not_dead(compare, sensor, measured):
    latest = compare(**sensor).latest["girder"]
    for figure in (latest.field_rms, latest.relative_error, latest.field_peak, latest.field_kurtosis):
        assert np.isfinite(figure).tolist() == measured
    assert not dead_axes(latest).any()
    comparison_status = pytest.importorskip("tbm_gsa.app.nodes.statuses").comparison_status
    text = comparison_status("girder", "girder", latest, None, False, Condition()).message
    assert text == "compared", text
    kept = {entry.axis for entry in live_entries(latest, rotating="frame" in sensor)}
    assert kept == {axis for axis, there in zip("xyz", measured, strict=True) if there}


def test_points_that_the_machine_has_not_are_left_out(compare):
    assert compare("nowhere").latest == {}


@pytest.mark.parametrize(
    ("stamp", "named"),
    [
        (0, "the stamp is 0"),
        (25_230 * SECOND, "25200.001 s ahead of the signals"),
        (30 * SECOND, ""),
    ],
)
def test_operating_points_off_the_clock_hold_from_now(compare, stamp, named):
    """One comes 30 s after the begin of the signals, and the machine stands still from then on."""
    comparison = compare(operating=())
    for k in range(10, 30):
        comparison.add(field_sensors("", ["girder"])[0]["field/girder/block"], "field", k * SECOND, OFFSETS, SINE)
    comparison.add_operating_point(topics.OPERATING_POINT, SECOND, (1.0, 1.0, 1.0), 0)
    said = comparison.add_operating_point(topics.OPERATING_POINT, stamp, (0.0, 0.0, 0.0), 0)
    assert named in said
    operation = comparison._operation[topics.OPERATING_POINT]
    assert [operation.kind(k * SECOND, (k + 1) * SECOND) for k in (28, 40)] == ["steady", "standstill"]


def test_before_any_clock_a_stamp_is_taken_as_it_is():
    """The first message of a recording may come before its first clock."""
    sensors, stamp = field_sensors("", ["girder"])[0].values(), 1_767_225_600 * SECOND
    comparison = LiveComparison(["girder"], sensors, 0.5, lambda _: None)
    assert comparison.add_operating_point(topics.OPERATING_POINT, stamp, (1.0, 1.0, 1.0), 0) == ""
    assert comparison.add_operating_point(topics.OPERATING_POINT, stamp + SECOND, (0.0, 0.0, 0.0), 0) == ""
    operation = comparison._operation[topics.OPERATING_POINT]
    kinds = [operation.kind(stamp + k * SECOND, stamp + (k + 1) * SECOND) for k in (0, 1)]
    assert kinds == ["steady", "standstill"]


def test_what_of_a_mapping_is_not_used_live_is_said(tmp_path):
    file = tmp_path / "mapping.yaml"
    sensor = "{point: belt, units: g, gravity: removed, frame: fixed}"
    file.write_text(f"topics:\n  /a: {sensor}\noperating_point: /plc\n")
    sensors, unused = field_sensors(str(file), ["girder"])
    assert set(sensors) == {"/a"}
    assert [line.removeprefix(f"{file}: ") for line in unused] == [
        "topic /a: test point 'belt' is none of the machine's: not compared, allowed: girder",
        "operating_point /plc: live the nodes follow /tbm/operating_point; not used",
    ]


def test_one_frame_of_a_topic_is_used_until_it_is_silent():
    now = [0.0]
    choice = FrameChoice(None, lambda: now[0])
    assert [choice.takes(frame) for frame in "abab"] == [True, False, True, False]
    assert choice.problem().startswith("frame_id 'b' beside 'a', which alone is used")
    now[0] = 2.5
    assert [choice.takes(frame) for frame in "bab"] == [True, False, True]
    now[0] = 9.0
    assert (choice.takes("b"), choice.problem()) == (True, "")
    stated = FrameChoice("b", lambda: now[0])
    assert [stated.takes(frame) for frame in ("a", "b", *map(str, range(1000)))].count(True) == 1
    assert len(stated._seen) <= 20


def test_the_alarm_says_what_raised_it(compare):
    latest, alarm = compare().latest["girder"], ErrorAlarm(0.3, 2, ["x"], "", {})
    assert [alarm.update(latest) for _ in range(3)] == [
        "",
        "girder: measured and computed differ by more than 0.3 for 2 windows",
        "",
    ]
    assert alarm.raised == {"girder"}


def test_a_study_says_why_it_does_not_start(tmp_path, monkeypatch):
    sleeps = [sys.executable, "-c", "import sys; sys.stdin.read()"]
    monkeypatch.setattr(gsa_process, "child_command", lambda *_: sleeps)
    options = GsaSettings(samples=10, test=2, duration=0.1, workers=1, folder=str(tmp_path / "studies"))
    study = GsaProcess("dz101", options)
    assert study.start("alarm", pause=60.0) == ""
    assert study.start("alarm", pause=60.0) == "the last one began 0 min ago, gsa.pause is 60 min"
    assert study.start("service") == "one is running already"
    assert study.cancel("over")
    (tmp_path / "file").write_text("")
    study.options = options.model_copy(update={"folder": str(tmp_path / "file")})
    assert "Not a directory" in study.start("service")


@pytest.mark.parametrize(("code", "explanation"), [(0, "rock: all as it was"), (2, "failed: rock: all as it was")])
def test_an_alarm_is_explained_before_its_study(tmp_path, monkeypatch, code, explanation):
    started = []

    def command(module, *arguments):
        started.append(module.rpartition(".")[2])
        return ["sh", "-c", f"echo rock: all as it was >&2; exit {code}"]

    def ended():
        study._process._process.wait()
        study.poll()
        return study.status

    monkeypatch.setattr(gsa_process, "child_command", command)
    study = GsaProcess("dz101", GsaSettings(folder=str(tmp_path)))
    observed = LiveObservation.model_construct(powers=(1.0,))
    assert study.start("alarm", observed=observed) == ""
    assert (study.status.state, study.status.step, started) == ("running", "explanation", ["alarm_explanation"])
    assert json.loads((study.status.folder / "observed.json").read_text())["powers"] == [1.0]
    status = ended()
    assert (status.state, status.step, status.explanation) == ("running", "study", explanation)
    assert started == ["alarm_explanation", "main"]
    assert ended().state == "failed"  # it wrote no result
