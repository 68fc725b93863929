"""A signal while a node executes text, as the import of a library does that makes classes of it: an end with code 0."""

import os
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")

pytestmark = pytest.mark.ros

IMPORTING = """
import signal
from tbm_msgs_py.nodes.managed import ManagedNode
from tbm_msgs_py.nodes.running import run_node

class Importing(ManagedNode):
    def __init__(self):
        super().__init__("importing")

    def configure(self):
        exec("signal.raise_signal(signal.SIGINT)")

def main():
    return run_node(Importing)
"""


def test_a_signal_in_executed_text_ends_a_node_well(tmp_path):
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
