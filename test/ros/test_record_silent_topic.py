"""`tbm-monitor bag record` of a topic that nobody publishes says so at its end."""

import json
import subprocess
import sys

import pytest


@pytest.mark.ros
def test_a_silent_topic_is_named(tmp_path):
    pytest.importorskip("rclpy")
    command = [sys.executable, "-m", "tbm_gsa.app.cli.main", "bag", "record"]
    done = subprocess.run(
        [*command, "--out", "new", "--topics", "nobody/here,/other", "--duration", "0.5", "--json"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["messages"] == 0
    assert "warning: no message on /tbm/nobody/here, /other" in done.stderr.splitlines()
