"""`tbm-monitor demo` on the shipped recording: everything from the playback to the report, and nothing left behind."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

rclpy = pytest.importorskip("rclpy")

from peer import alive, children  # noqa: E402

from tbm_msgs_py.topics import TEST_POINTS  # noqa: E402

pytestmark = pytest.mark.ros


def test_demo(tmp_path):
    command = [sys.executable, "-m", "tbm_gsa.cli.main", "demo", "--samples", "15", "--test", "3", "--json"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    seen: set[int] = set()
    try:
        while True:
            try:
                out, err = process.communicate(timeout=1.0)
                break
            except subprocess.TimeoutExpired:
                seen.update(children(process.pid))
    finally:
        if process.poll() is None:
            process.kill()
    assert process.returncode == 0, err
    document = json.loads(out)
    assert set(document["points"]) == set(TEST_POINTS)
    for point in document["points"].values():
        assert point["windows"] >= 3
        assert point["predicted_g"] > 0
        assert point["measured_g"] > 0
    assert set(document["outputs"]) == {"RDef_A", "RDef_L", "RDef_R", "PAcc_A", "PAcc_L", "PAcc_R", "MF_M", "MF_Se"}
    assert len(document["blocks"]) == 7
    for name, count in document["blocks"].items():
        assert count["received"] > 100, name
        assert count["lost"] == 0, name
    assert Path(document["report"]).is_file()
    assert len(seen) >= 4
    assert not any(map(alive, seen))
    for log in (tmp_path / "tbm_demo" / "logs").iterdir():
        assert "Traceback" not in log.read_text(), log.name
