"""Import: several files become one recording, and an operating point may be a constant."""

import json
import math
import sys
import wave

import numpy as np
import pytest
from import_files import POINT, START, START_NS, refused

from tbm_gsa.app.cli.main import main
from tbm_msgs_py import Bag, RecordingError, read_recording
from tbm_msgs_py.importing import describe, import_recording

CONSTANT = {
    "speed": {"value": 5.6, "unit": "r/min"},
    "torque": {"value": 3040, "unit": "kN.m"},
    "thrust": {"value": 12.0, "unit": "MN"},
}
LATER = "2026-03-01T08:00:02+01:00"


def write_wav(path, values, rate=1000):
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(rate)
        file.writeframes(np.asarray(values, "<i2").tobytes())
    return path


@pytest.fixture
def files(tmp_path):
    """One file an axis, one of another rate, one of the operating point."""
    (tmp_path / "plc.csv").write_text("t;rpm\n0;5\n1;6\n")
    return {
        "x": write_wav(tmp_path / "x.wav", [1, 2, 3]),
        "y": write_wav(tmp_path / "y.wav", [4, 5, 6]),
        "short": write_wav(tmp_path / "short.wav", [4, 5]),
        "slow": write_wav(tmp_path / "slow.wav", [7, 8, 9], 500),
        "plc": tmp_path / "plc.csv",
    }


def stated(*columns, **changes):
    point = POINT | {"columns": [*columns, None, None][:3], "full_scale": 32768}
    return describe(None, {"points": {"shield": point}, "time": "file", "start": START} | changes)


def test_one_file_an_axis(files, tmp_path):
    imported = import_recording([files["x"], files["y"]], stated("x.wav:1", "y.wav:1"), tmp_path / "bag")
    assert imported.streams["shield"].samples == 3
    values = read_recording(tmp_path / "bag").points["shield"].values
    assert values.tolist() == [[1, 4, 0], [2, 5, 0], [3, 6, 0]]


def test_one_file_a_point_and_one_of_the_machine(files, tmp_path):
    slow = POINT | {"columns": ["slow.wav:1", None, None], "full_scale": 32768}
    first = POINT | {"columns": ["x.wav:1", None, None], "full_scale": 32768}
    described = stated(
        points={"shield": first, "girder": slow},
        files={
            "slow.wav": {"start": LATER},
            "plc.csv": {"time": {"column": "t", "unit": "s"}, "csv": {"delimiter": ";"}},
        },
        operating_point=CONSTANT | {"speed": {"column": "plc.csv:rpm", "unit": "r/min"}},
    )
    import_recording([files["x"], files["slow"], files["plc"]], described, tmp_path / "bag")
    recording = read_recording(tmp_path / "bag")
    starts = {name: point.start_ns for name, point in recording.points.items()}
    assert starts == {"shield": START_NS, "girder": START_NS + 2 * 10**9}
    assert recording.points["girder"].time.tolist() == [0, 0.002, 0.004]
    rpm = 2 * math.pi / 60
    found = [(point.speed, point.torque, point.thrust) for point in recording.operating_point.points]
    assert found == [pytest.approx((speed * rpm, 3.04e6, 12e6), rel=1e-15) for speed in (5, 6)]
    stamps = [message.log_ns for message in Bag(tmp_path / "bag").messages()]
    assert stamps == sorted(stamps)


@pytest.mark.parametrize(
    ("names", "columns", "changes", "message"),
    [
        (["x", "slow"], ["x.wav:1", "slow.wav:1"], {}, "slow.wav: its samples are not at the times of those of x.wav"),
        (["x", "short"], ["x.wav:1", "short.wav:1"], {}, "short.wav: its samples are not at the times of"),
        (["short", "x"], ["short.wav:1", "x.wav:1"], {}, "x.wav: its samples are not at the times of"),
        (["x", "y"], ["x.wav:1", "y.wav:1"], {"files": {"y.wav": {"start": LATER}}}, "y.wav: its samples are not"),
        (["x", "y"], ["x.wav:1", "y.wav:1"], {"files": {"z.wav": {"start": LATER}}}, "files.z.wav: no such file"),
        (["x", "y"], ["x.wav:1"], {}, "y.wav: no column of it is asked for"),
        (["x", "y"], ["1"], {}, "column 1: of none of the files, allowed: x.wav:COLUMN, y.wav:COLUMN"),
        (["x", "x"], ["x.wav:1"], {}, "x.wav: given 2 times"),
        (["x"], ["1"], {"csv": {"decimal": ",", "delimiter": ";"}}, "x.wav: csv is stated, allowed: for CSV files"),
        (["x"], ["1"], {"files": {"y.wav": {"start": LATER}}}, "files.y.wav: no such file is given"),
        (["x", "plc"], ["x.wav:1", "plc.csv:rpm"], {}, "plc.csv: time: file: a CSV file states no time"),
    ],
)
def test_files_that_do_not_fit_are_refused_by_name(files, tmp_path, names, columns, changes, message):
    described = stated(*columns, **changes)
    assert message in refused([files[name] for name in names], described, tmp_path / "bag")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"files": {"x.wav": {"rate": 5, "time": "file"}}}, "files.x.wav: time or rate: both stated"),
        ({"files": {"x.wav": {"start": "2026-03-01T08:00:00"}}}, "files.x.wav: start: '2026-03-01T08:00:00'"),
        ({"files": {"x.wav": {"begin": START}}}, "files.x.wav.begin: unknown key"),
        ({"operating_point": CONSTANT, "points": {}}, "operating_point: constant, and no points"),
        ({"operating_point": CONSTANT | {"speed": {"unit": "r/min"}}}, "speed: column or value: missing"),
        ({"operating_point": CONSTANT | {"speed": {"unit": "r/min", "value": True}}}, "speed.value: True"),
        ({"operating_point": CONSTANT | {"speed": {"unit": "r/min", "value": "5"}}}, "speed.value: '5'"),
        ({"operating_point": CONSTANT | {"thrust": {"unit": "MN", "value": 1e308}}}, "value: 1e+308 MN"),
        (
            {"operating_point": CONSTANT | {"thrust": {"unit": "MN", "value": 1.0, "column": "a"}}},
            "thrust: column or value: both stated",
        ),
    ],
)
def test_wrong_files_and_constants_are_one_line(changes, message):
    with pytest.raises(RecordingError) as caught:
        stated("1", **changes)
    assert message in str(caught.value)
    assert "allowed: " in str(caught.value)


def test_a_constant_operating_point_by_options(files, tmp_path, monkeypatch, capsys):
    sensor = ["--units", "m/s2", "--gravity", "removed", "--frame", "fixed", "--full-scale", "32768"]
    times = ["--time", "file", "--start", "2026-03-01 08:00:00", "--timezone", "Europe/Berlin"]
    constant = ["--speed", "=5.6:r/min", "--torque", "=3040:kN.m", "--thrust", "=12:MN"]
    out = tmp_path / "bag"
    given = [str(files["x"]), str(files["y"]), "--out", str(out), "--map", "shield=x.wav:1,,y.wav:1"]
    monkeypatch.setattr(sys, "argv", ["tbm-monitor", "bag", "import", *given, *sensor, *times, *constant, "--json"])
    with pytest.raises(SystemExit) as end:
        main()
    streams = json.loads(capsys.readouterr().out)["streams"]
    assert (end.value.code, streams["operating_point"]["samples"], streams["shield"]["samples"]) == (0, 1, 3)
    recording = read_recording(out)
    assert recording.points["shield"].start_ns == START_NS
    (point,) = recording.operating_point.points
    assert (point.speed, point.torque, point.thrust) == pytest.approx((5.6 * math.pi / 30, 3.04e6, 12e6), rel=1e-15)
