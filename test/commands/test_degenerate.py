"""Degenerate input of the command line: two ends only, a result or one line with exit code 2.

Options and files are drawn by hypothesis; names of test points are held against rclpy; streams and folders are those of
the operating system.
"""

import os
import subprocess
import sys
from importlib import resources

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from tbm_dynamics import MachineError
from tbm_dynamics.machine.description import PointName
from tbm_dynamics.machine.loading import described_by
from tbm_gsa.app.cli.main import main
from tbm_gsa.history import History, HistoryEntry, WindowSource
from tbm_msgs_py.base.files import read_text

TEXT = resources.files("tbm_dynamics").joinpath("machines/open380.yaml").read_text("utf-8")
NUMBERS = ("nan", "inf", "-inf", "-1", "0", "1e-300", "1e308", "1e400", "9223372036854775808", "", "x", "٣")
FILES = (
    "empty",
    "folder",
    "bytes",
    "pipe",
    "loop",
    "nowhere",
    "/dev/null",
    "/dev/full",
    "machine.yaml",
    "h.sqlite",
    "a\nb",
)
TIMES = ("999999d", "0001-01-01", "9999-12-31T23:59:59", "nan", "2024-02-30", "0s", "-1d")
# Each command with options and what they are drawn from; a command with all of them left out does little.
OPTIONS = {
    "simulate": {"--duration": (*NUMBERS[:7], "1e-3"), "--seed": NUMBERS, "--machine": FILES, "--schedule": FILES},
    "machine list": {"--machine": FILES},
    "machine check": {"--machine": FILES},
    "machine show": {"--machine": FILES, "--count": NUMBERS, "--out": FILES},
    "machine loads": {"--duration": NUMBERS, "--machine": FILES, "--out": FILES},
    "machine observe --points nowhere": {
        "--points": ("girder=0,1", "girder=0,x,1", "girder=0,nan,1", ",", "girder"),
        "--rotating": ("nowhere", "cutterhead"),
        "--candidates": ("", "girder=1"),
        "--duration": NUMBERS,
        "--noise-density": NUMBERS,
        "--model-error": NUMBERS,
        "--machine": FILES,
    },
    "machine update": {"--from": FILES, "--out": FILES, "--machine": FILES},
    "history --history h.sqlite": {
        "--limit": NUMBERS,
        "--since": TIMES,
        "--until": TIMES,
        "--html": FILES,
        "--png": FILES,
    },
    "history": {"--history": FILES, "--machine": FILES, "--source": FILES},
    "history baseline set usual": {"--history": FILES, "--since": TIMES, "--machine": FILES},
    "bag info": {"": FILES, "--mapping": FILES},
    "bag info --scan": {"": FILES, "--mapping": FILES},
    "bag recover": {"": FILES, "--out": FILES},
    "bag play": {"": FILES, "--rate": NUMBERS, "--start": NUMBERS, "--duration": NUMBERS},
    "bag record --topics ,": {"--out": FILES, "--duration": NUMBERS, "--quota": NUMBERS, "--split-size": NUMBERS},
    "demo --outputs ,": {"--samples": NUMBERS, "--bag": FILES, "--machine": FILES, "--seed": NUMBERS},
}


@st.composite
def lines(draw):
    name = draw(st.sampled_from(list(OPTIONS)))
    chosen = draw(st.lists(st.sampled_from(list(OPTIONS[name])), min_size=1, max_size=2, unique=True))
    parts = [(option, draw(st.sampled_from(OPTIONS[name][option]))) for option in chosen]
    return [*name.split(), *(part for pair in parts for part in pair if part or pair[0])]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "empty").touch()
    (tmp_path / "folder").mkdir()
    (tmp_path / "bytes").write_bytes(bytes(range(256)))
    (tmp_path / "loop").symlink_to("loop")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "machine.yaml").write_text(TEXT, "utf-8")
    with History(tmp_path / "h.sqlite") as history:
        history.add(
            WindowSource("offline", "r", "", "dz101", "ab" * 32),
            [HistoryEntry("head", "x", 1_700_000_000_000_000_000, 2_000_000_000, 1.0, 1.0, 0.1, 1.0)],
        )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setattr("signal.signal", lambda *_: None)  # handlers stay those of the test process


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)
@given(line=lines())
@example(line=["machine", "update", "--from", "pipe", "--out", "new"])
@example(line=["history", "--history", "h.sqlite", "--limit", "9223372036854775808"])
@example(line=["history", "--history", "h.sqlite", "--until", "9999-12-31"])
@example(line=["history", "--history", "h.sqlite", "--html", "page", "--png", "page"])
@example(line=["bag", "play", "folder", "--start", "1e308"])
@example(line=["bag", "info", "empty", "--mapping", "nowhere"])
def test_a_command_ends_with_a_result_or_one_line(line, folder, capsys):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["tbm-monitor", *line])
        with pytest.raises(SystemExit) as end:
            main()
    out, err = capsys.readouterr()
    assert end.value.code in (0, 2), (line, err)
    if end.value.code:
        assert (out, len(err.splitlines())) == ("", 1), (line, err)
        assert err.startswith("tbm-monitor: ")


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_stream_that_takes_nothing_is_no_fault(tmp_path, unbuffered):
    cases = [
        ("machine list --json >/dev/full", 2, "tbm-monitor: <stdout>: No space left on device\n"),
        ("machine list <&- >&-", 0, ""),
        ("machine check --machine a 2>/dev/full", 2, ""),
        ("--help 2>&- >/dev/full", 2, ""),
    ]
    runs = [
        subprocess.Popen(
            ["sh", "-c", f"exec {sys.executable} -m tbm_gsa.app.cli.main {line}"],
            cwd=tmp_path,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        )
        for line, _, _ in cases
    ]
    for run, (line, code, said) in zip(runs, cases, strict=True):
        err = run.communicate()[1]
        assert (run.returncode, err) == (code, said), line


def test_a_deleted_working_folder_is_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("signal.signal", lambda *_: None)
    monkeypatch.setattr(sys, "argv", ["tbm-monitor", "machine", "list"])
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert capsys.readouterr().err.startswith("tbm-monitor: the working folder: No such file or directory, allowed: ")


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="no regular file"):
        read_text(tmp_path / "pipe")


@given(name=st.text("aZ_09- /é~{", max_size=6) | st.just("a" * 101))
@example(name="main bearing")
@example(name="1st")
@example(name="Hauptlager_ü")
def test_a_test_point_is_what_ros_can_carry(name):
    rclpy = pytest.importorskip("rclpy.validate_full_topic_name")
    try:
        carried = "/" not in name and rclpy.validate_full_topic_name(f"/a/{name}/b") and len(name) <= 100
    except rclpy.InvalidTopicNameException:
        carried = False
    if carried:
        assert TypeAdapter(PointName).validate_python(name) == name
    else:
        with pytest.raises(ValidationError, match="allowed: up to 100 letters a to z"):
            TypeAdapter(PointName).validate_python(name)


def test_a_machine_file_names_the_test_point():
    with pytest.raises(MachineError, match=r"^m.yaml: test_points.1st.*no digit first, given: '1st'$"):
        described_by(TEXT.replace("test_points: {", "test_points: {1st: 1, "), "m.yaml")
