"""SIGINT and SIGTERM at any moment of a node's life, its start included: an end without a word, code 0."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from processes import DEADLINE, NodeProcess, wait_for
from rclpy.executors import SingleThreadedExecutor

from tbm_gsa.app.nodes.watch import Watch
from tbm_msgs_py.nodes import registry

pytestmark = pytest.mark.ros

BAGS = Path(__file__).parents[2] / "bags"
SLOWEST = ("dynamics_node", "analysis_node")  # to start; the others take minutes together
NODES = [pytest.param(name, marks=() if name in SLOWEST else pytest.mark.verify) for name in registry.NODES]


def listens(process):
    """Whether a process handles SIGTERM: Python itself is up, which no code of ours can hasten."""
    try:
        status = Path(f"/proc/{process.pid}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1)


def needed(name, folder):
    """Parameters without which a node does not start."""
    return {
        "bag_player": {"bag": BAGS / "field_dz101"},
        "bag_recorder": {"output": folder, "topics": "[nothing]"},
        "live_view": {"port": 0},
        "web_view": {"port": 0, "history": "none"},
    }.get(name, {})


@pytest.mark.parametrize("name", NODES)
def test_a_signal_during_the_start(tmp_path, monkeypatch, name):
    # Nothing is compiled yet: configuring takes long, too.
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    moments = (0.0, 0.2, 0.6, 1.5, 3.0)  # s after the start
    faults = []
    for place, moment in enumerate(moments):
        given = [f"{key}:={value}" for key, value in needed(name, tmp_path / f"{place}").items()]
        arguments = ["--ros-args", *(part for one in given for part in ("-p", one))] if given else []
        node = NodeProcess(tmp_path / f"{place}.log", name, arguments)
        wait_for(lambda node=node: listens(node.process))
        started = time.monotonic()
        wait_for(lambda started=started, moment=moment: time.monotonic() >= started + moment)
        node.send((signal.SIGINT, signal.SIGTERM)[place % 2])
        fault = node.fault_at_end() or (
            "" if name in ("live_view", "web_view") else node.output
        )  # they say where they listen
        faults += [f"{moment} s: {fault}"] if fault else []
    assert not faults, "\n".join(faults)


SWALLOWING = """
import ctypes, os, signal, sys, time
from tbm_msgs_py.nodes.managed import ManagedNode
from tbm_msgs_py.nodes.parameters import NodeSettings
from tbm_msgs_py.nodes.running import run_node

class Compiling(ManagedNode):
    def __init__(self):
        super().__init__("compiling", NodeSettings)

    def configure(self):
        ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT) or time.sleep(0.1))()
        time.sleep(60.0)

sys.exit(run_node(Compiling))
"""


def test_a_signal_that_a_library_swallows_comes_again():
    """As the callbacks of a compiler do: what is raised in them goes no further."""
    process = subprocess.Popen(
        [sys.executable, "-c", SWALLOWING], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        out, err = process.communicate(timeout=DEADLINE)
    finally:
        process.kill()
    assert (process.returncode, out, err) == (0, "", "")


IMPORTING = """
import signal
from tbm_msgs_py.nodes.managed import ManagedNode
from tbm_msgs_py.nodes.parameters import NodeSettings
from tbm_msgs_py.nodes.running import run_node

class Importing(ManagedNode):
    def __init__(self):
        super().__init__("importing", NodeSettings)

    def configure(self):
        exec("signal.raise_signal(signal.SIGINT)")

def main():
    return run_node(Importing)
"""


def test_a_signal_in_executed_text_ends_a_node_well(tmp_path):
    """As in the import of a library that makes classes of text."""
    (tmp_path / "importing.py").write_text(IMPORTING)
    paths = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, "-m", "tbm_gsa.app.nodes.start", "importing"],
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


BROKEN = """
import signal, sys
from tbm_msgs_py.nodes.running import run_node

def broken():
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        raise RuntimeError("rcl node's context is invalid") from None

sys.exit(run_node(broken))
"""


def test_a_signal_that_breaks_what_a_start_is_at_is_no_fault():
    """It ends the context under a node that is being made: rclpy's error may come before the interruption."""
    done = subprocess.run([sys.executable, "-c", BROKEN], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


# Those that go on until they are told to end have ended well.
COMMANDS = [(["run"], 0), (["bag", "record"], 0), (["bag", "play"], 0), (["bag", "info"], 130), (["demo"], 130)]


@pytest.mark.parametrize(("arguments", "code"), COMMANDS)
def test_ctrl_c_while_the_command_line_is_imported(arguments, code):
    script = Path(sys.executable).with_name("tbm-monitor")
    process = subprocess.Popen([script, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_for(lambda: listens(process))
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=DEADLINE)
    assert (process.returncode, out, err) == (code, "", "")


INTERRUPTED_IMPORT = """
import signal
from tbm_gsa.app.cli import commands, main
commands.load = lambda name: signal.raise_signal(signal.SIGTERM)
main.main()
"""


@pytest.mark.parametrize(("arguments", "code"), COMMANDS)
def test_a_signal_while_a_command_is_imported(arguments, code):
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED_IMPORT, *arguments], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "")


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
