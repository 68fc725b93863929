"""`tbm-monitor bag import`: options and description together, one document, one line for what is wrong."""

import json
import os
import signal
import sys

import numpy as np
import pytest
import scipy.io

from tbm_gsa.app.cli.main import main
from tbm_msgs_py import BagWriter, RecordingError, read_recording
from tbm_msgs_py.base.units import STANDARD_GRAVITY
from tbm_msgs_py.importing import apart, describe, import_recording
from tbm_msgs_py.importing.apart import _import as import_apart_as_it_is

START = "2026-03-01T08:00:00+01:00"
POINT = {"columns": ["a", "b", "c"], "units": "g", "gravity": "removed", "frame": "fixed"}
SENSOR = ["--units", "g", "--gravity", "removed", "--frame", "fixed"]


@pytest.fixture
def command(tmp_path, monkeypatch, capsys):
    """Run `bag import` on a small CSV file: exit code, stdout, stderr."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    rows = "".join(f"{k},{k},{-k},{k + 0.5},6,{10 * k},900\n" for k in range(10))
    (tmp_path / "a.csv").write_text("ms,a,b,c,rpm,torque,thrust\n" + rows)
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["tbm-monitor", "bag", "import", "a.csv", "--out", "bag", *arguments])
        with pytest.raises(SystemExit) as end:
            main()
        return end.value.code, *capsys.readouterr()

    yield run
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


def test_options_alone_describe_a_file(command, tmp_path):
    operating = ["--speed", "rpm:r/min", "--torque", "torque:kN.m", "--thrust", "thrust:kN"]
    code, out, err = command("--map", "girder=a,,c", *SENSOR, "--time", "ms:ms", "--start", START, *operating, "--json")
    assert (code, err) == (0, "")
    document = json.loads(out)
    assert document["path"] == "bag"
    assert document["warnings"] == []
    assert document["streams"]["girder"] == {
        "topic": "/tbm/field/girder/block",
        "samples": 10,
        "rate_hz": 1000.0,
        "jitter": 0.0,
        "gaps": 0,
        "restarts": 0,
        "unmeasured": ["y"],
    }
    recording = read_recording(tmp_path / "bag")
    k = np.arange(10)
    expected = np.column_stack([k, 0 * k, k + 0.5]) * STANDARD_GRAVITY
    np.testing.assert_allclose(recording.points["girder"].values, expected, rtol=1e-7)
    assert [point.torque for point in recording.operating_point.points] == [1e4 * i for i in range(10)]


def test_options_go_over_the_description(command, tmp_path):
    (tmp_path / "a.yaml").write_text("rate: 5\nstart: 2026-03-01T08:00:00Z\n")
    code, out, err = command("--map", "a.yaml", "--map", "girder=a,b,c", *SENSOR, "--rate", "50")
    assert (code, err) == (0, "")
    assert "girder" in out
    assert read_recording(tmp_path / "bag").points["girder"].rate_hz == pytest.approx(50)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ([], "points, operating_point or drives"),
        (["--map", "girder=a,b"], "girder=a,b: 2 columns"),
        (["--map", "girder=a(:,1),b(2,:)"], "b(2,:): 2 columns"),
        (["--map", "girder=a(:,1),,", *SENSOR, "--rate", "50", "--start", START], "column a(:,1) is not there"),
        (["--map", "girder=a,b,c", "--rate", "50", "--start", START], "points.girder.units"),
        (["--map", "girder=a,b,q", *SENSOR, "--rate", "50", "--start", START], "column q is not there"),
        (["--map", "girder=a,b,c", *SENSOR, "--rate", "50"], "start"),
        (["--map", "girder=a,b,c", *SENSOR, "--time", "ms", "--start", START], "--time ms: no unit"),
        (["--map", "nowhere.yaml"], "nowhere.yaml: cannot be read (No such file"),
        (["--map", "one.yaml", "--map", "two.yaml"], "one import description"),
        (["--map", "girder=a,b,c", "--map", "girder=a,b,", *SENSOR], "point girder a second time"),
        (["--map", "a.yaml", "--units", "g", "--full-scale", "5"], "--units, --full-scale: for no POINT=X,Y,Z"),
        (["--map", "girder=a,b,c", *SENSOR, "--speed", "=fast:r/min"], "--speed =fast:r/min: no number"),
        (["--map", "girder=a,b,c", *SENSOR, "--rate", "50", "--start", "2026-03-01T08:00:00"], "without its zone"),
        (["--map", "girder=a,b,c", *SENSOR, "--rate", "nan", "--start", START], "rate: nan"),
        (["--speed", "rpm:r/min", "--rate", "1", "--start", START], "operating_point.torque"),
    ],
)
def test_bad_input_is_one_line(command, tmp_path, arguments, named):
    code, out, err = command(*arguments)
    assert (code, out) == (2, "")
    assert named in err
    assert len(err.strip().splitlines()) == 1
    assert not (tmp_path / "bag").exists()


def crash(answer, path, description, out):
    """Stands for a library that ends with a segmentation fault when the output has been begun."""
    BagWriter(out).open()
    os.kill(os.getpid(), signal.SIGKILL)


def go_on(answer, path, description, out):
    """Stands for a library that finds no end."""
    BagWriter(out).open()
    apart.CPU_S = 0.0
    apart.import_recording = lambda *_: list(iter(int, 1))
    import_apart_as_it_is(answer, path, description, out)


@pytest.mark.parametrize(
    ("name", "instead", "said"),
    [("bag", crash, "crashed, allowed"), ("bag.mcap", go_on, "gave nothing in 120 s of CPU time")],
)
def test_a_library_that_fails_is_one_line_and_leaves_nothing(tmp_path, monkeypatch, name, instead, said):
    monkeypatch.setattr(apart, "_import", instead)
    described = describe(None, {"points": {"girder": POINT}, "rate": 50, "start": START})
    with pytest.raises(RecordingError, match=f"the library that reads it {said}"):
        apart.import_apart(tmp_path / "a.mat", described, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def overtaken(answer, path, description, out):
    """Another import into the same folder was faster."""
    out.mkdir()
    (out / "theirs").touch()
    import_apart_as_it_is(answer, path, description, out)


def test_an_import_that_is_refused_removes_nothing_of_another(tmp_path, monkeypatch):
    monkeypatch.setattr(apart, "_import", overtaken)
    described = describe(None, {"points": {"girder": POINT}, "rate": 50, "start": START})
    scipy.io.savemat(tmp_path / "a.mat", {name: np.arange(9.0) for name in "abc"})
    with pytest.raises(RecordingError, match="exists already"):
        apart.import_apart(tmp_path / "a.mat", described, tmp_path / "bag")
    assert [path.name for path in (tmp_path / "bag").iterdir()] == ["theirs"]


def test_import_apart_gives_what_the_import_gives(tmp_path):
    described = describe(None, {"points": {"girder": POINT}, "rate": 50, "start": START})
    scipy.io.savemat(tmp_path / "a.mat", {name: np.arange(9.0) for name in "abc"})
    imported = apart.import_apart(tmp_path / "a.mat", described, tmp_path / "bag")
    assert imported == import_recording(tmp_path / "a.mat", described, tmp_path / "again")
    with pytest.raises(RecordingError, match="no such file"):
        apart.import_apart(tmp_path / "b.mat", described, tmp_path / "other")
