"""What `run` says while it goes on, on a clock of the test, and where it refuses to begin."""

import io
import re
from pathlib import Path

import pytest
from rich.console import Console

from tbm_gsa.app.cli import status_line
from tbm_gsa.app.cli.processes import settle_ros_environment
from tbm_gsa.app.cli.status_line import StatusLine
from tbm_msgs_py.base.errors import InputError


def comparison(error, alarm=0):
    return (0, "compared", {"relative_error_x": str(error), "alarm": str(alarm)})


POINTS = {"tbm: comparison girder": comparison(0.1), "tbm: comparison shield": comparison(0.25)}
SILENT = {"tbm: comparison girder": comparison("nan"), "tbm: loads": (0, "streaming", {})}
ALARM = POINTS | {"tbm: comparison shield": comparison(0.4, alarm=1)}


@pytest.mark.parametrize(
    ("statuses", "text"),
    [
        ({}, "7 of 40 s: 0 points, 0 compared; no alarm; logs in out/logs"),
        (SILENT, "7 of 40 s: 1 points, 0 compared; no alarm; logs in out/logs"),
        (POINTS, "7 of 40 s: 2 points, 2 compared, axial error 0.10 to 0.25; no alarm; logs in out/logs"),
        (ALARM, "7 of 40 s: 2 points, 2 compared, axial error 0.10 to 0.40; alarm at shield; logs in out/logs"),
        (
            POINTS | {"tbm: machine": (1, "x22", {"alarm": "1"})},
            "7 of 40 s: 2 points, 2 compared, axial error 0.10 to 0.25; alarm at the machine; logs in out/logs",
        ),
        ({"tbm: comparison x": comparison("a lot")}, "7 of 40 s: 1 points, 0 compared; no alarm; logs in out/logs"),
    ],
)
def test_the_status_line_says_how_it_goes(capsys, statuses, text):
    with StatusLine(Path("out/logs"), 40.0) as line:
        line.update(statuses, 7.3)
    assert capsys.readouterr().err.splitlines() == [text]


def test_in_a_pipe_there_is_a_line_a_minute_and_at_alarms(capsys):
    now = 0.0
    with StatusLine(Path("logs"), None, lambda: now) as line:
        for tick in range(5 * 150):
            now = 0.2 * tick
            line.update(ALARM if 70.0 <= now < 71.0 or now >= 100.0 else POINTS, now)
    times = [float(text.partition(" ")[0]) for text in capsys.readouterr().err.splitlines()]
    assert times == [0.0, 60.0, 70.0, 75.0, 100.0]


def test_in_a_pipe_the_last_line_is_of_the_end(capsys):
    with StatusLine(Path("logs"), 40.0, lambda: 0.0) as line:
        line.finish(POINTS, 1.0)  # broken off before it had begun
        for seconds in (2.0, 39.8):
            line.update(POINTS, seconds)
        for _ in range(2):
            line.finish(ALARM, 40.0)
    lines = capsys.readouterr().err.splitlines()
    assert [text.partition(" s:")[0] for text in lines] == ["2 of 40", "40 of 40"]
    assert "alarm at shield" in lines[-1]


def test_on_a_terminal_line_and_table_are_kept_up_to_date(monkeypatch):
    output = io.StringIO()
    monkeypatch.setattr(status_line, "notes", Console(file=output, force_terminal=True, width=200))
    monkeypatch.setattr(status_line.time, "strftime", lambda _: f"at {now}")
    with StatusLine(Path("logs"), None, lambda: 0.0) as line:
        for now in range(3):
            line.update(POINTS | {"tbm: machine": (int(now > 0), "x22 [red]" * 20, {})}, float(now))
    shown = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", output.getvalue())
    assert re.findall(r"(\d+) s: 2 points", shown)[-1] == "2"
    last = shown[shown.rindex("2 s: 2 points") :].splitlines()
    rows = [text.split() for text in last[2:] if text.strip()]
    assert [row[:5] for row in rows[1:3]] == [["girder", "ok", "0.10", "at", "0"], ["shield", "ok", "0.25", "at", "0"]]
    assert rows[3][:6] == ["machine", "warning", "–", "at", "1", "x22"]
    assert rows[3][-1].endswith("…")


@pytest.mark.parametrize(("given", "named"), [("OFF", "no node finds another"), ("LOCAL", "allowed: LOCALHOST")])
def test_a_range_without_discovery_is_refused(monkeypatch, given, named):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", given)
    with pytest.raises(InputError, match=f"ROS_AUTOMATIC_DISCOVERY_RANGE: '{given}'.*{named}"):
        settle_ros_environment()
