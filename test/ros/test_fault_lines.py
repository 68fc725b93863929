"""What is wrong is said once a minute, whatever numbers are in the line, and where."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from tbm_gsa.app.nodes import stream_health
from tbm_gsa.app.nodes.stream_health import StreamHealth
from tbm_gsa.comparison import StreamCounters
from tbm_msgs_py.nodes.fault_log import MOST_LINES, REPEAT_S, FaultLog

pytestmark = pytest.mark.ros


def test_a_line_comes_once_a_minute_whatever_its_numbers():
    clock, said = [0.0], []
    faults = FaultLog(said.append, lambda: clock[0])
    for k in range(400):
        faults.report("units", f"fx is about {1e-6 * (0.96 + 0.01 * (k % 9)):.2g} of the thrust: values in MN?")
        clock[0] += 0.05
    assert len(said) == 1
    clock[0] = REPEAT_S + 1.0
    faults.report("units", "fx is about 1e-06 of the thrust: values in MN?")
    assert len(said) == 2


def test_two_faults_in_turn_are_two_lines_a_minute():
    clock, said = [0.0], []
    faults = FaultLog(said.append, lambda: clock[0])
    for _ in range(1000):
        for text in ("block frame_id a, allowed: cutterhead", "loads hold a value that is not finite"):
            faults.report("loads", text)
        clock[0] += 0.1
        assert faults.show() == {"loads": text}
    assert len(said) == 4
    faults.clear("loads")
    assert faults.show() == {"loads": text}
    assert faults.show() == {}


def test_a_fault_that_is_never_the_same_is_no_flood():
    clock, said = [0.0], []
    faults = FaultLog(said.append, lambda: clock[0])
    for k in range(1000):
        faults.report("loads", "block fields: " + "".join(chr(97 + k // 26**place % 26) for place in range(3)))
        clock[0] += 0.01
    assert len(said) == MOST_LINES
    faults.report("clock", "the clock jumped")
    assert said[-1] == "the clock jumped"
    clock[0] += REPEAT_S
    faults.report("loads", "block fields: none")
    assert said[-1] == "block fields: none"


def test_every_line_about_a_signal_names_its_point():
    said = []
    condition = StreamHealth(said.append)
    for source in ("model", "field"):
        condition.add_samples("girder", source, 250)
    counters = {"girder": {"field": StreamCounters()}}
    condition.conditions(counters, False, {"girder": 10**18})
    counters["girder"]["field"] = StreamCounters(
        rejected=1, late=2, gaps=3, restarts=4, rate_changes=5, declared_hz=100.0, came_hz=50.0, block_gaps=6
    )
    condition.fail("girder", "/rig/imu", "/rig/imu: type a, allowed: b; not used")
    apart = condition.conditions(counters, False, {"girder": 10**18})["girder"]
    condition.refuse("girder", "field", "block fields: none")
    counters["girder"]["field"].late += 1
    beside = condition.conditions(counters, False, {})["girder"]
    told = {*apart.refused, *apart.doubts, *beside.refused, *beside.doubts}
    assert len(said) == len(told) == 8
    assert all("girder" in line for line in said), said
    assert {line.removeprefix("girder: ") for line in said} == told  # of the status, which is that of the point
    assert "stamps of the field are 11574 d behind the model's" in apart.refused[1]
    assert not [line for line in apart.doubts if "late or twice" in line]
    assert [line for line in beside.doubts if "late or twice" in line]


def test_what_was_refused_is_over_when_nothing_of_the_kind_comes(monkeypatch):
    clock = SimpleNamespace(monotonic=lambda: clock.now, now=0.0)
    monkeypatch.setattr(stream_health, "time", clock)
    condition = StreamHealth(lambda _: None)

    def refused():
        return [found.refused for found in condition.conditions({}, False, {}).values()]

    condition.refuse("girder", "field", "block fields: none")
    assert refused() == refused() == [["field girder: block fields: none; not used"]]
    clock.now = 1.1 * stream_health.SILENCE_S
    assert len(refused()) == 1  # once more, that none comes and goes unseen
    assert refused() == []
