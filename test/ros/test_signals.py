"""SIGINT and SIGTERM at any moment of a node's life, its start included: an end without a word, code 0."""

import signal
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from processes import NodeProcess, wait_for
from rclpy.executors import SingleThreadedExecutor

from tbm_gsa.nodes.watch import Watch

pytestmark = pytest.mark.ros

END_S = 3.0
NODES = {"dynamics_node": "tbm_dynamics.nodes.dynamics_node", "analysis_node": "tbm_gsa.nodes.analysis_node"}


def listens(node):
    """Whether the process handles SIGTERM: Python itself is up, which no code of ours can hasten."""
    try:
        status = Path(f"/proc/{node.process.pid}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1)


@pytest.mark.parametrize("name", NODES)
def test_a_signal_during_the_start(tmp_path, monkeypatch, name):
    # Nothing is compiled yet: configuring takes long, too.
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    moments = (0.0, 0.2, 0.6, 1.5, 3.0)  # s after the start
    faults = []
    for place, moment in enumerate(moments):
        node = NodeProcess(tmp_path / f"{place}.log", NODES[name], [])
        wait_for(lambda node=node: listens(node))
        started = time.monotonic()
        wait_for(lambda started=started, moment=moment: time.monotonic() >= started + moment)
        node.send((signal.SIGINT, signal.SIGTERM)[place % 2])
        fault = node.fault_at_end(END_S) or node.output
        faults += [f"{moment} s: {fault}"] if fault else []
    assert not faults, "\n".join(faults)


def test_a_signal_waits_until_rclpy_is_done(monkeypatch):
    """Raised inside rclpy it would leave half-made objects that complain when they go."""
    turns = []

    def turn(*_, **__):
        signal.raise_signal(signal.SIGINT)
        turns.append("done")

    with Watch(["girder"]) as watching:
        monkeypatch.setattr(SingleThreadedExecutor, "spin_once", turn)
        with pytest.raises(KeyboardInterrupt):
            watching.spin(5.0)
    assert turns == ["done"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
