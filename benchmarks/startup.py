"""How long one waits: `python benchmarks/startup.py [--runs 5] [--json]`.

Of `tbm-monitor --help` until its end, of every node from the start of its process until it answers that it is active
and until its first message arrives here, and of what the process had cost of a core by then: that one depends least on
what else the computer does. A first round fills the caches, numba's too, and is not counted.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import psutil
import rclpy
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2

from tbm_gsa.app.cli.processes import NodeCommand, NodeProcesses, settle_ros_environment
from tbm_msgs_py import topics
from tbm_msgs_py.nodes import qos
from tbm_msgs_py.nodes.registry import NODES
from tbm_msgs_py.nodes.running import fastest_executor

HELP_TARGET_S, NODE_TARGET_S = 0.5, 2.0
LONGEST_S = 60.0
ASKED_EVERY_S = 0.02
HELP = [sys.executable, "-c", "from tbm_gsa.app.cli.start import main; main()", "--help"]
RECORDING = Path(__file__).parents[1] / "bags" / "field_dz101"


@dataclass(frozen=True)
class Case:
    """A node, what it publishes first, and the node that has to run before it does."""

    parameters: Mapping[str, object] = field(default_factory=dict)
    first: tuple[Any, str, Any] | None = None
    after: str | None = None


def cases(folder: Path) -> dict[str, Case]:
    """Give each node what it needs to become active."""
    given = {
        "load_node": Case(first=(PointCloud2, topics.LOADS_BLOCK, qos.BLOCK)),
        "dynamics_node": Case(first=(PointCloud2, topics.model_block("cutterhead"), qos.BLOCK), after="load_node"),
        "analysis_node": Case({"history": str(folder / "history.sqlite"), "gsa.on_threshold": False}),
        "live_view": Case({"port": 0}),
        "web_view": Case({"port": 0, "history": "none"}),
        "bag_player": Case({"bag": str(RECORDING)}, (Clock, topics.CLOCK, qos.CLOCK)),
        "bag_recorder": Case({"topics": [topics.LOADS_BLOCK], "output": str(folder / "recorded")}),
    }
    return {name: given[name] for name in NODES}


def help_seconds() -> dict[str, float]:
    """Run `--help` once."""
    before, start = children_cpu(), time.perf_counter()
    subprocess.run(HELP, check=True, stdout=subprocess.DEVNULL)
    return {"seconds": time.perf_counter() - start, "cpu": children_cpu() - before}


def children_cpu() -> float:
    """CPU time of all processes that have ended (s)."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


class Nodes(NodeProcesses):
    """Node processes whose CPU time is known."""

    def cpu(self, name: str) -> float:
        """CPU time of a node (s)."""
        times = psutil.Process(self._running[name].pid).cpu_times()
        return float(times.user + times.system)


class Watcher:
    """Sees nodes become active and their first messages arrive."""

    def __init__(self) -> None:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("startup", namespace=topics.NAMESPACE)
        self._executor = fastest_executor()
        self._executor.add_node(self._node)
        self._states = {name: self._node.create_client(GetState, f"{name}/get_state") for name in NODES}

    def first_message(self, kind: Any, name: str, profile: Any) -> Callable[[], bool]:
        """Whether a message has come on a topic since now."""
        came: list[bytes] = []
        made = self._node.create_subscription(kind, name, came.append, profile, raw=True)

        def look() -> bool:
            if came:
                self._node.destroy_subscription(made)
            return bool(came)

        return look

    def active(self, name: str) -> Callable[[], bool]:
        """Whether a node says that it is active. What it is asked while it starts, it answers as soon as it spins."""
        client = self._states[name]
        states: list[int] = []
        asked = 0.0

        def look() -> bool:
            nonlocal asked
            now = time.monotonic()
            if now - asked > ASKED_EVERY_S and client.service_is_ready():
                asked = now
                answer = client.call_async(GetState.Request())
                answer.add_done_callback(lambda answer: states.append(answer.result().current_state.id))
            return State.PRIMARY_STATE_ACTIVE in states

        return look

    def gone(self, name: str) -> Callable[[], bool]:
        """Whether no node of this name is known, of a run before this one or of others in this ROS domain."""
        return lambda: not self._states[name].service_is_ready()

    def wait(self, condition: Callable[[], bool], nodes: NodeProcesses, what: str) -> None:
        """Spin until a condition holds."""
        until = time.monotonic() + LONGEST_S
        while not condition():
            nodes.check()
            if time.monotonic() > until:
                raise SystemExit(f"{what} within {LONGEST_S:.0f} s")
            self._executor.spin_once(timeout_sec=0.002)

    def close(self) -> None:
        """Leave ROS."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()


def node_seconds(watcher: Watcher, name: str) -> dict[str, float]:
    """Start a node once, and end it."""
    with tempfile.TemporaryDirectory() as folder, Nodes(Path(folder) / "logs") as nodes:
        case = cases(Path(folder))[name]
        for other in filter(None, (case.after, name)):
            watcher.wait(watcher.gone(other), nodes, f"another {other} in this ROS domain did not end")
        if case.after:
            nodes.start(NodeCommand(case.after))
            watcher.wait(watcher.active(case.after), nodes, f"{case.after} did not become active")
        active = watcher.active(name)
        arrived = watcher.first_message(*case.first) if case.first else None
        start = time.perf_counter()
        nodes.start(NodeCommand(name, case.parameters))
        watcher.wait(active, nodes, f"{name} did not become active")
        found = {"active": time.perf_counter() - start, "cpu": nodes.cpu(name)}
        if arrived:
            watcher.wait(arrived, nodes, f"{name} sent nothing")
            found["first"] = time.perf_counter() - start
        return found


def medians(runs: list[dict[str, float]]) -> dict[str, float]:
    """Median of each figure, without the round that filled the caches."""
    return {key: statistics.median(run[key] for run in runs[1:]) for key in runs[0]}


@dataclass(frozen=True)
class Starts:
    """Medians over so many runs: of the help, and by node; s."""

    runs: int
    load: tuple[float, ...]
    help: dict[str, float]
    nodes: dict[str, dict[str, float]]


def measure(runs: int) -> Starts:
    """All figures."""
    of_help = medians([help_seconds() for _ in range(runs + 1)])
    watcher = Watcher()
    nodes = {name: medians([node_seconds(watcher, name) for _ in range(runs + 1)]) for name in NODES}
    watcher.close()
    return Starts(runs, os.getloadavg(), of_help, nodes)


def show(found: Starts) -> None:
    """Print the table, and whether the targets hold."""
    load = " ".join(f"{value:.1f}" for value in found.load)
    print(f"median of {found.runs}, load average {load}\n")
    print("| | active, s | first message, s | CPU until active, s | target |\n|" + " --- |" * 5)
    rows = [("`tbm-monitor --help`", found.help["seconds"], None, found.help["cpu"], HELP_TARGET_S)]
    rows += [(name, row["active"], row.get("first"), row["cpu"], NODE_TARGET_S) for name, row in found.nodes.items()]
    for name, active, first, used, target in rows:
        came = "" if first is None else f"{first:.2f}"
        held = "held" if max(active, first or 0.0) < target else "missed"
        print(f"| {name} | {active:.2f} | {came} | {used:.2f} | {target:g} s {held} |")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5, help="starts of each that are counted")
    parser.add_argument("--json", action="store_true", help="print a JSON document")
    given = parser.parse_args()
    settle_ros_environment()
    found = measure(given.runs)
    print(json.dumps(asdict(found))) if given.json else show(found)


if __name__ == "__main__":
    main()
