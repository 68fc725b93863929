"""What commands say of their nodes, on a clock of the test, and which end of a node ends them how."""

from pathlib import Path

import pytest

from tbm_gsa.app.cli import main as command_line
from tbm_gsa.app.cli import processes
from tbm_gsa.app.cli.bag.node import run_to_end
from tbm_gsa.app.cli.bag.play import PlayedMessages
from tbm_gsa.app.cli.processes import NodeCommand, NodeProcesses
from tbm_gsa.app.cli.supervision import Supervision
from tbm_msgs_py.base.errors import NodeFailure, RunError
from tbm_msgs_py.nodes.processes import ChildProcess, LogLines


class _Processes:
    """Processes that go on, but for those that have ended as they may."""

    def __init__(self):
        self.ended = set()

    def running(self, name):
        return name not in self.ended

    def start(self, command):
        pass

    def check(self, ending):
        pass

    def log(self, name):
        return f"logs/{name}.log"


class _Run:
    """A node that says once a second how it is, looked at five times a second."""

    def __init__(self, capsys):
        self.now, self.diagnostics, self._capsys = 0.0, {}, capsys
        self.processes = _Processes()
        self.nodes = Supervision(self.processes, self.diagnostics, lambda: self.now)
        self.nodes.start(NodeCommand("load_node"))

    def go_on(self, seconds, text=None, progress=lambda now: 0.0):
        """Lines of so many seconds; without a text the node is silent."""
        for tick in range(5 * seconds):
            if text is not None and tick % 5 == 0:
                self.diagnostics["tbm: load_node"] = (0, str(text), {})
            self.nodes.check(progress(self.now), "load_node")
            self.now += 0.2
        return self._capsys.readouterr().err.splitlines()


@pytest.fixture
def run(capsys):
    return _Run(capsys)


def test_a_node_that_is_ready_is_one_line(run):
    assert run.go_on(60, "active") == ["load_node: active"]


def test_a_node_that_falls_silent_is_a_line_and_its_return(run):
    run.go_on(3, "active")
    assert run.go_on(9) == []
    assert run.go_on(30) == ["load_node: has said nothing for 10 s"]
    assert run.go_on(30, "active") == ["load_node: active"]


def test_a_node_that_has_ended_as_it_may_is_no_line(run):
    run.go_on(3, "active")
    run.processes.ended.add("load_node")
    assert run.go_on(60) == []


def test_a_node_that_is_not_yet_heard_is_no_line(run):
    assert run.go_on(60) == []


def test_a_node_that_returns_in_another_state_says_which(run):
    run.go_on(3, "active")
    run.go_on(12)
    assert run.go_on(3, "inactive") == ["load_node: inactive"]


def test_after_a_stop_of_the_command_itself_no_node_was_silent(run):
    run.go_on(3, "active")
    run.now += 3600.0  # Ctrl-Z, fg
    assert run.go_on(9) == []
    assert run.go_on(3, "active") == []


FAILS = "active; unexpected error in on_loads: KeyError: 'fx'"


def test_a_node_that_fails_while_nothing_goes_on_ends_the_wait(run):
    run.go_on(60, FAILS, progress=lambda now: now)  # messages of others may be at fault
    with pytest.raises(NodeFailure, match=r"load_node: active; unexpected error in .*; its log: logs/load_node.log"):
        run.go_on(60, FAILS)


def test_an_error_now_and_then_ends_no_wait(run):
    for _ in range(20):
        run.go_on(8, FAILS)
        run.go_on(2, "active")


class _Child(ChildProcess):
    """Process that has ended with a code, or goes on, and left a log."""

    code, text = None, ""

    def __init__(self, _command, log):
        self._log = log
        log.write_text(self.text)

    def poll(self):
        return self.code

    def request_end(self):
        pass

    def end(self, seconds):
        pass


HEAD = "[FATAL] [1772348400.0] [tbm.load_node]: "
TICK = "unexpected error in tick: KeyError: 'x'; it fails every time"


@pytest.mark.parametrize(
    ("code", "text", "kind", "said"),
    [
        (
            2,
            f"{HEAD}parameter load_rate: allowed: 1",
            RunError,
            "exit code 2: site.yaml: parameter load_rate: allowed: 1",
        ),
        (2, f"{HEAD}parameter seed: allowed: 1", RunError, "exit code 2: parameter seed: allowed: 1"),
        (2, f"{HEAD}no such machine", RunError, "exit code 2: no such machine"),
        (1, f"{HEAD}KeyError: 1", NodeFailure, "exit code 1: KeyError: 1; its log: {log}"),
        (None, f"going\n{HEAD}{TICK}\n", NodeFailure, "load_node: " + TICK + "; its log: {log}"),
    ],
)
def test_what_ends_a_node_is_one_line_with_its_file(tmp_path, monkeypatch, code, text, kind, said):
    monkeypatch.setattr(processes, "ChildProcess", type("Child", (_Child,), {"code": code, "text": text}))
    with NodeProcesses(tmp_path) as nodes, pytest.raises(RunError) as caught:
        nodes.start(NodeCommand("load_node", {"seed": 1}, Path("site.yaml")))
        nodes.check()
    assert type(caught.value) is kind
    assert str(caught.value).endswith(said.format(log=tmp_path / "load_node.log"))
    assert "FATAL" not in str(caught.value)


def test_a_player_that_fails_every_time_ends_with_code_1(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(processes, "ChildProcess", type("Child", (_Child,), {"text": f"{HEAD}{TICK}\n"}))
    monkeypatch.setattr(command_line, "app", lambda **_: run_to_end(NodeCommand("bag_player"), PlayedMessages))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("tbm_gsa.app.cli.bag.node.record_signals", lambda: lambda: False)
    assert command_line._run() == 1
    said = capsys.readouterr().err
    (log,) = tmp_path.glob("*/bag_player.log")
    assert said == f"tbm-monitor: bag_player: {TICK}; its log: {log}\n"


def test_lines_of_a_log_are_read_once_and_whole(tmp_path):
    path = tmp_path / "a.log"
    lines = LogLines(path)
    assert lines.new() == []
    for written, new in ((b"one\ntw", ["one"]), (b"o\n\xff\n", ["two", "\ufffd"]), (b"", [])):
        with path.open("ab") as file:
            file.write(written)
        assert lines.new() == new
