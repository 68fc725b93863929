"""`tbm-monitor demo`: everything from the playback to the report, and nothing left behind.

On the first 14 s of the shipped recording and two outputs; `make demo` plays the whole and asks for all.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

rclpy = pytest.importorskip("rclpy")

from peer import alive, children  # noqa: E402

from tbm_gsa.app.cli.shipped import shipped_bag  # noqa: E402
from tbm_msgs_py import Bag, BagWriter  # noqa: E402
from tbm_msgs_py.topics import TEST_POINTS  # noqa: E402

# `.ci/run` runs the whole demo by itself.
pytestmark = [pytest.mark.ros, pytest.mark.verify]


# Three windows of 2 s, one that is not whole at either end, and one for the filters to settle.
LENGTH_NS = 14_000_000_000


@pytest.fixture
def bag(tmp_path):
    shipped, start = Bag(shipped_bag()), None
    with BagWriter(tmp_path / "bag") as writer:
        for message in shipped.messages():
            start = start or message.log_ns
            if message.log_ns < start + LENGTH_NS:
                writer.write(message.topic.name, message.topic.type, message.log_ns, message.data)
    return tmp_path / "bag"


def test_the_demo_ends_by_itself_with_a_result(bag, tmp_path):
    command = [sys.executable, "-m", "tbm_gsa.app.cli.main", "demo", "--bag", bag]
    command += ["--samples", "15", "--test", "3", "--outputs", "RDef_A,MF_M", "--json"]
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
    assert set(document["outputs"]) == {"RDef_A", "MF_M"}
    (finding,) = document["findings"]  # 14 s are too few for more
    assert finding["verdict"] is None
    assert "a verdict needs 15 s" in finding["sentence"]
    assert len(document["blocks"]) == 7
    for name, count in document["blocks"].items():
        assert count["received"] > 0, name  # whether any is lost is a matter of the computer: `make verify`
    assert Path(document["report"]).is_file()
    assert len(seen) >= 4
    assert not any(map(alive, seen))
    for log in (tmp_path / "tbm_demo" / "logs").iterdir():
        assert "Traceback" not in log.read_text(), log.name
