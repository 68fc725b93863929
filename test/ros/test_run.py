"""`tbm-monitor run` as a user starts it: nothing lost, options and files, signals, a node that ends by itself."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

rclpy = pytest.importorskip("rclpy")

from peer import Peer, alive, children  # noqa: E402
from processes import DEADLINE, wait_for  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402

from tbm_dynamics import load_machine  # noqa: E402
from tbm_gsa.app.cli.processes import NodeCommand, NodeProcesses  # noqa: E402
from tbm_gsa.app.cli.shipped import shipped_bag  # noqa: E402
from tbm_msgs_py.nodes import qos  # noqa: E402
from tbm_msgs_py.nodes.bag_player import BagPlayer  # noqa: E402
from tbm_msgs_py.nodes.registry import MACHINE_NODES  # noqa: E402

pytestmark = pytest.mark.ros

COMMAND = [sys.executable, "-m", "tbm_gsa.app.cli.main"]
NODES_YAML = Path(__file__).parents[2] / "config" / "nodes.yaml"


def test_run_takes_a_file_and_options(command, tmp_path):
    """The file alone names the machine; the options drive it."""
    (tmp_path / "site.yaml").write_text("/**:\n  ros__parameters: {machine: open380, seed: 3}\n")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    driven = ("--speed", "1.5", "--thrust", "9000")
    code, out, err = command("run", "--duration", "2", "--params", "site.yaml", *driven, "--web", str(port), "--json")
    assert code == 0, err
    assert f"page to watch: http://127.0.0.1:{port}/" in err
    document = json.loads(out)
    assert document["first_block_seconds"] > 0.0
    lines = err.splitlines()
    ready = [lines.index(f"{name}: active") for name in MACHINE_NODES]
    statuses = [k for k, line in enumerate(lines) if "points, 0 compared; no alarm; logs in tbm_run/logs" in line]
    assert max(ready) < min(statuses), err
    assert float(lines[statuses[-1]].partition(" of 2 s:")[0]) >= 2.0
    points = load_machine("open380").description.test_points
    assert set(document["topics"]) == {
        "/tbm/loads/block",
        "/tbm/model/mesh_forces",
        *(f"/tbm/model/{point}/block" for point in points),
    }
    for name, topic in document["topics"].items():
        assert topic["stream_time"] >= 2.0, name
    diagnostics = document["diagnostics"]
    assert diagnostics["tbm: dynamics"]["message"] == "integrating"
    own = load_machine("open380").operating_point
    values = diagnostics["tbm: loads"]["values"]
    assert float(values["speed_r_min"]) == pytest.approx(1.5)
    assert float(values["thrust_kn"]) == pytest.approx(9000.0)
    assert float(values["torque_kn_m"]) == pytest.approx(own.torque / 1e3)


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.verify), signal.SIGKILL]
)
def test_signals_end_run_and_its_nodes(tmp_path, number):
    with (tmp_path / "out").open("wb") as out, (tmp_path / "err").open("wb") as err, Peer() as peer:
        command = [*COMMAND, "run", "--json", "--params", NODES_YAML]
        process = subprocess.Popen(command, cwd=tmp_path, stdout=out, stderr=err)
        try:
            blocks = peer.listen(PointCloud2, "/tbm/model/girder/block", qos.BLOCK)
            peer.wait_for(lambda: len(blocks) > 10)
            nodes = children(process.pid)
            assert len(nodes) == 3
            process.send_signal(number)
            process.send_signal(number)  # an impatient user
            code = process.wait(DEADLINE)
        finally:
            if process.poll() is None:
                left = children(process.pid)
                process.kill()
                for node in left:  # or they would disturb the tests after this one
                    os.kill(node, signal.SIGKILL)
        wait_for(lambda: not any(map(alive, nodes)))
    assert "Traceback" not in (tmp_path / "err").read_text()
    for log in (tmp_path / "tbm_run" / "logs").iterdir():
        assert "Traceback" not in log.read_text(), log.name
    assert code == (-signal.SIGKILL if number == signal.SIGKILL else 0)
    if code == 0:
        assert json.loads((tmp_path / "out").read_text())["topics"]["/tbm/loads/block"]["blocks"] > 5


def test_run_follows_a_recording_and_says_what_its_nodes_do(tmp_path, peer):
    """Beside a recording on its own clock it compares; a node that somebody deactivates is a line, and its return."""
    errors = tmp_path / "err"
    (tmp_path / "site.yaml").write_text("/**:\n  ros__parameters: {gsa.on_threshold: false, history: none}\n")
    command = [*COMMAND, "run", "--json", "--sim-time", "--params", "site.yaml"]
    with (tmp_path / "out").open("wb") as out, errors.open("wb") as err:
        process = subprocess.Popen(command, cwd=tmp_path, stdout=out, stderr=err)
    try:
        peer.wait_for(lambda: all(peer.text(f"tbm: {name}") == "active" for name in MACHINE_NODES))
        peer.host(BagPlayer, bag=shipped_bag(), loop=True, rate=2.0)
        compared = "tbm: comparison cutterhead"
        peer.wait_for(lambda: float(peer.value(compared, "relative_error_x") or "nan") >= 0.0)
        expected = ["dynamics_node: active"]  # it said so when it was ready
        for change, state in (("deactivate", "inactive"), ("activate", "active")):
            assert peer.transition("/tbm/dynamics_node", change)
            expected.append(f"dynamics_node: {state}")
            peer.wait_for(
                lambda: [line for line in errors.read_text().splitlines() if "dynamics_node: " in line] == expected
            )
        process.send_signal(signal.SIGTERM)
        assert process.wait(DEADLINE) == 0
    finally:
        process.kill()
        process.wait()
    diagnostics = json.loads((tmp_path / "out").read_text())["diagnostics"]
    assert diagnostics["tbm: dynamics_node"]["message"] == "active"


@pytest.mark.verify  # a busy computer may lose a block
def test_run_loses_no_block(command):
    code, out, err = command("run", "--duration", "3", "--json")
    assert code == 0, err
    assert {name: topic["lost"] for name, topic in json.loads(out)["topics"].items() if topic["lost"]} == {}


@pytest.mark.verify  # 3 s are the promise of a quiet computer
def test_run_and_its_nodes_end_within_three_seconds(tmp_path, peer):
    process = subprocess.Popen([*COMMAND, "run", "--json"], cwd=tmp_path, stdout=subprocess.DEVNULL)
    blocks = peer.listen(PointCloud2, "/tbm/model/girder/block", qos.BLOCK)
    peer.wait_for(lambda: len(blocks) > 10)
    asked = time.monotonic()
    process.send_signal(signal.SIGTERM)
    assert process.wait(DEADLINE) == 0
    assert time.monotonic() - asked < 3.0


def test_a_node_that_ends_by_itself_is_noticed(tmp_path):
    with NodeProcesses(tmp_path) as nodes:
        nodes.start(NodeCommand("one", module="timeit"))  # its main just returns
        wait_for(lambda: not nodes.running("one"))
        nodes.check(ending="one")
        with pytest.raises(RuntimeError, match="one was ended"):
            nodes.check()


def test_nodes_are_ended_before_and_after_they_can_hear_of_it(tmp_path, monkeypatch):
    """One that still starts, without a complaint; one that does not end is killed."""
    deaf = "signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True)"
    for name, does in {"deaf": deaf, "hears": "pass"}.items():
        (tmp_path / f"{name}.py").write_text(f"import signal, time\ndef main():\n    {does}\n    time.sleep(60)\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with NodeProcesses(tmp_path) as nodes:
        nodes.start(NodeCommand("deaf", module="deaf"))
        wait_for(lambda: (tmp_path / "deaf.log").read_text() == "deaf\n")
        nodes.start(NodeCommand("early", module="hears"))
    assert not nodes.running("early")
    assert (tmp_path / "early.log").read_text() == ""
    with pytest.raises(RuntimeError, match="deaf ended with exit code -9"):
        nodes.running("deaf")
