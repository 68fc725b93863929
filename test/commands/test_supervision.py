"""What `run` says of its nodes, on a clock of the test."""

import pytest

from tbm_gsa.app.cli.processes import NodeCommand
from tbm_gsa.app.cli.supervision import Supervision


class _Processes:
    """Processes that go on."""

    def start(self, command):
        pass

    def check(self):
        pass


class _Run:
    """A node that says once a second how it is, looked at five times a second."""

    def __init__(self, capsys):
        self.now, self.diagnostics, self._capsys = 0.0, {}, capsys
        self.nodes = Supervision(_Processes(), self.diagnostics, lambda: self.now)
        self.nodes.start(NodeCommand("load_node"))

    def go_on(self, seconds, text=None):
        """Lines of so many seconds; without a text the node is silent."""
        for tick in range(5 * seconds):
            if text is not None and tick % 5 == 0:
                self.diagnostics["tbm: load_node"] = (0, str(text), {})
            self.nodes.check()
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
