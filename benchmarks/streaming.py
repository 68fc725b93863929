"""The real nodes at the design's rates: `python benchmarks/streaming.py [--duration 60] [--sweep] [--json]`.

Loads at 10 kHz, five test points with three axes at 5 kHz, ten mesh forces at 5 kHz, all in blocks, seven live topics
at 100 Hz, and the analysis of five sensors that measure what the model says. First the mesh forces have to be those of
an offline run, bit for bit. What the nodes themselves miss they say on /diagnostics, which is listed too. `--sweep`
lets the clock run faster and faster until blocks are lost, here or on their way to a node, or fall behind.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

# The offline run, like the nodes, on one BLAS thread: sums over more differ in their last bit.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import psutil
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import AccelStamped, WrenchStamped
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2

from tbm_dynamics import load_machine, simulate
from tbm_gsa.app.cli.processes import NodeCommand, NodeProcesses, settle_ros_environment
from tbm_msgs_py import ACCELERATION, topics
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.running import fastest_executor

NANOSECONDS = 1_000_000_000
BLOCK_NS, LIVE_NS = 50_000_000, 10_000_000
BLOCKS = (topics.LOADS_BLOCK, topics.MODEL_MESH_FORCES, *map(topics.model_block, topics.TEST_POINTS))
LIVE = {topics.LOADS_WRENCH: WrenchStamped, topics.MODEL_DRIVES: JointState}
LIVE |= {topics.model_accel(point): AccelStamped for point in topics.TEST_POINTS}
SAMPLES = {topics.LOADS_BLOCK: topics.LOAD_BLOCK_SAMPLES}
WARM_UP_S = 10.0
SWEEP, SWEEP_S = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0, 16.0), 15.0
CLOCK_S, START_NS = 0.005, 1_700_000_000 * NANOSECONDS
SEED = 0


class Meter:
    """Stamps and latencies of one topic."""

    def __init__(self, length_ns: int) -> None:
        self._length = length_ns
        self.first_ns = self.last_ns = self.received = self.lost = self.restarts = 0
        self.late: list[float] = []

    def take(self, stamp_ns: int, now_ns: int) -> None:
        """Count a message; its latency (s) is what passed since the end of what it holds."""
        if self.received == 0:
            self.first_ns = stamp_ns
        elif stamp_ns <= self.last_ns:
            self.restarts += 1
        else:
            self.lost += round((stamp_ns - self.last_ns) / self._length) - 1
        self.last_ns = stamp_ns
        self.received += 1
        self.late.append((now_ns - stamp_ns - self._length) / NANOSECONDS)


class Watcher:
    """Counts what comes, without decoding it."""

    def __init__(self) -> None:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("watcher", namespace=topics.NAMESPACE)
        self._executor = fastest_executor()
        self._executor.add_node(self._node)
        self.meters: dict[str, Meter] = {}
        self.meshes: list[Any] = []
        self.loads: list[int] = []
        self.faults: set[str] = set()
        for name in BLOCKS:
            self._watch(PointCloud2, name, BLOCK_NS, qos.BLOCK)
        for name, kind in LIVE.items():
            self._watch(kind, name, LIVE_NS, qos.BLOCK if name == topics.LOADS_WRENCH else qos.LIVE)
        self._node.create_subscription(DiagnosticArray, topics.DIAGNOSTICS, self._hear, qos.DIAGNOSTICS)
        self._first = self._node.create_subscription(
            PointCloud2, topics.MODEL_MESH_FORCES, self.meshes.append, qos.BLOCK
        )

    def _watch(self, kind: Any, name: str, length: int, profile: Any) -> None:
        self.meters[name] = Meter(length)
        self._node.create_subscription(kind, name, partial(self._take, name), profile, raw=True)

    def _hear(self, message: Any) -> None:
        self.faults |= {f"{s.name}: {s.message}" for s in message.status if s.level != DiagnosticStatus.OK}

    def _take(self, name: str, data: bytes) -> None:
        seconds, nanoseconds = struct.unpack_from("<iI", data, 4)  # after the CDR encapsulation comes the header
        stamp = seconds * NANOSECONDS + nanoseconds
        if name == topics.LOADS_BLOCK and not self.loads:
            self.loads.append(stamp)
        self.meters[name].take(stamp, time.time_ns())

    def spin(self, seconds: float) -> None:
        """Take what comes for a while."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._executor.spin_once(timeout_sec=0.02)

    def wait_for_blocks(self, count: int) -> None:
        """Wait until every block topic has so many."""
        until = time.monotonic() + 60.0
        while min(self.meters[name].received for name in BLOCKS) < count:
            if time.monotonic() > until:
                raise SystemExit("no blocks within 60 s")
            self.spin(0.1)

    def check(self) -> None:
        """Hold the first blocks against an offline run."""
        first = [messages.block_from(message) for message in self.meshes]
        self._node.destroy_subscription(self._first)
        length = (first[-1].stamp_ns - self.loads[0]) / NANOSECONDS + 0.1
        offline = simulate(load_machine("dz101"), duration=length, seed=SEED).mesh_force[::2]
        for block in first:
            at = (block.stamp_ns - self.loads[0]) // 200_000
            if not np.array_equal(block.values, offline[at : at + len(block.values)]):
                raise SystemExit("the mesh forces are not those of an offline run")

    def restart(self) -> None:
        """Count afresh."""
        self.faults.clear()
        for name, meter in self.meters.items():
            self.meters[name] = Meter(meter._length)

    def close(self) -> None:
        """Leave ROS."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()


def sensors() -> None:
    """Run the five sensors: each sends what the model says, 10 % less."""
    rclpy.init(args=[])
    node = rclpy.create_node("sensors", namespace=topics.NAMESPACE)

    def measure(publisher: Any, point: str, message: Any) -> None:
        block = messages.block_from(message)
        publisher.publish(messages.block(ACCELERATION, block.stamp_ns, block.offsets, 0.9 * block.values, point))

    for point in topics.TEST_POINTS:
        publisher = node.create_publisher(PointCloud2, topics.field_block(point), qos.BLOCK)
        node.create_subscription(PointCloud2, topics.model_block(point), partial(measure, publisher, point), qos.BLOCK)
    executor = fastest_executor()
    executor.add_node(node)
    while rclpy.ok():
        executor.spin_once(timeout_sec=1.0)


def clock(rate: float) -> None:
    """Publish a clock that runs at a multiple of real time."""
    rclpy.init(args=[])
    node = rclpy.create_node("fast_clock")
    publisher = node.create_publisher(Clock, topics.CLOCK, qos.CLOCK)
    start = time.monotonic_ns()
    while rclpy.ok():
        publisher.publish(messages.clock(START_NS + round((time.monotonic_ns() - start) * rate)))
        time.sleep(CLOCK_S)


class System(NodeProcesses):
    """The three nodes, the sensors, and a clock if it is not the computer's."""

    def __init__(self, folder: Path, rate: float | None = None) -> None:
        super().__init__(folder)
        self._rate, self._history = rate, folder / "history.sqlite"
        self._helpers: dict[str, subprocess.Popen[bytes]] = {}

    def begin(self) -> dict[str, psutil.Process]:
        """Start all; the nodes by name."""
        common = {"use_sim_time": self._rate is not None}
        analysis = {"gsa.on_threshold": False, "history": str(self._history), **common}
        self.start(NodeCommand("analysis_node", analysis))
        self.start(NodeCommand("dynamics_node", {"seed": SEED, **common}))
        self.start(NodeCommand("load_node", {"seed": SEED, "wait_for_subscribers": 2, **common}))
        self._help("sensors")
        if self._rate is not None:
            self._help("clock", "--rate", str(self._rate))
        started = {name: node.process.pid for name, node in self._running.items()}
        started |= {role: process.pid for role, process in self._helpers.items()}
        return {name: psutil.Process(pid) for name, pid in started.items()}

    def _help(self, role: str, *options: str) -> None:
        command = [sys.executable, __file__, "--role", role, *options]
        self._helpers[role] = subprocess.Popen(command, stderr=subprocess.DEVNULL)

    def stop(self) -> None:
        """End all."""
        for process in self._helpers.values():
            process.send_signal(signal.SIGKILL)
            process.wait()
        super().stop()


@dataclass(frozen=True)
class Streaming:
    """Run of so many seconds: figures by topic and by process, faults on `/diagnostics`."""

    seconds: float
    load: tuple[float, ...]
    topics: dict[str, dict[str, float]]
    processes: dict[str, dict[str, float]]
    faults: list[str]


def measure(duration: float) -> Streaming:
    """Run at real time: rates, losses, latencies by topic; CPU and memory by process."""
    with tempfile.TemporaryDirectory() as folder, System(Path(folder)) as system:
        watcher = Watcher()
        processes = system.begin()
        watcher.wait_for_blocks(20)
        watcher.check()
        watcher.spin(WARM_UP_S)
        watcher.restart()
        before = {name: (cpu(process), memory(process)) for name, process in processes.items()}
        start = time.monotonic()
        most = {name: used for name, (_, used) in before.items()}
        while (left := start + duration - time.monotonic()) > 0.0:
            watcher.spin(min(1.0, left))
            system.check()
            most = {name: max(most[name], memory(process)) for name, process in processes.items()}
        wall = time.monotonic() - start
        used = {
            name: {
                "cpu_percent": 100.0 * (cpu(process) - before[name][0]) / wall,
                "memory_mb": before[name][1],
                "end_mb": memory(process),
                "most_mb": most[name],
            }
            for name, process in processes.items()
        }
        watcher.close()
    return Streaming(wall, os.getloadavg(), rows(watcher, wall), used, sorted(watcher.faults))


def rows(watcher: Watcher, wall: float) -> dict[str, dict[str, float]]:
    """Figures of each topic."""
    found = {}
    for name, meter in watcher.meters.items():
        p50, p99, most = 1e3 * np.percentile(meter.late, (50, 99, 100))
        samples = SAMPLES.get(name, topics.MODEL_BLOCK_SAMPLES) if name in BLOCKS else 1
        rate = meter.received / wall
        found[topics.absolute(name)] = {
            "messages_s": rate,
            "samples_s": rate * samples,
            "lost": meter.lost,
            "restarts": meter.restarts,
            "p50_ms": p50,
            "p99_ms": p99,
            "most_ms": most,
        }
    return found


def cpu(process: psutil.Process) -> float:
    """CPU time (s)."""
    times = process.cpu_times()
    return float(times.user + times.system)


def memory(process: psutil.Process) -> float:
    """Resident memory (MB)."""
    return float(process.memory_info().rss / 1e6)


def keeps_up(rate: float) -> dict[str, float]:
    """Run at a multiple of the design's rates for a while: lost blocks and the share of the stream that came."""
    with tempfile.TemporaryDirectory() as folder, System(Path(folder), rate) as system:
        watcher = Watcher()
        system.begin()
        watcher.wait_for_blocks(20)
        watcher.restart()
        start = time.monotonic()
        watcher.spin(SWEEP_S)
        wall = time.monotonic() - start
        meters = [watcher.meters[name] for name in BLOCKS]
        watcher.close()
    stream = min(meter.last_ns - meter.first_ns for meter in meters) / NANOSECONDS
    lost = sum(meter.lost + meter.restarts for meter in meters)
    bridged = sum("lost steps bridged" in fault for fault in watcher.faults)
    return {"rate": rate, "lost": lost + bridged, "share": stream / (wall * rate)}


def sweep() -> list[dict[str, float]]:
    """Raise the rate until it is lost."""
    found = []
    for rate in SWEEP:
        found.append(keeps_up(rate))
        if found[-1]["lost"] or found[-1]["share"] < 0.95:
            break
    return found


def show(found: Streaming | None, swept: list[dict[str, float]]) -> None:
    """Print the tables."""
    if found is not None:
        load = " ".join(f"{value:.1f}" for value in found.load)
        print(f"{found.seconds:.0f} s, load average {load}\n")
        print("| topic | messages/s | samples/s | lost | p50 ms | p99 ms | most ms |\n|" + " --- |" * 7)
        for name, row in found.topics.items():
            print(
                f"| {name} | {row['messages_s']:.1f} | {row['samples_s']:.0f} | {row['lost']} | {row['p50_ms']:.1f} "
                f"| {row['p99_ms']:.1f} | {row['most_ms']:.1f} |"
            )
        print("\n| process | CPU of a core, % | memory MB | at the end | most |\n|" + " --- |" * 5)
        for name, row in found.processes.items():
            memories = " | ".join(f"{row[key]:.1f}" for key in ("memory_mb", "end_mb", "most_mb"))
            print(f"| {name} | {row['cpu_percent']:.0f} | {memories} |")
        print("\n" + ("\n".join(found.faults) or "no fault on /diagnostics"))
    if swept:
        print("\n| times the design's rates | lost | share of the stream |\n| --- | --- | --- |")
        for row in swept:
            print(f"| {row['rate']:g} | {row['lost']} | {row['share']:.2f} |")


def main() -> None:
    """Measure, or play one of the helpers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=60.0, help="s; 0: no run at real time")
    parser.add_argument("--sweep", action="store_true", help="find the highest rate without loss")
    parser.add_argument("--json", action="store_true", help="print a JSON document")
    parser.add_argument("--role", choices=("sensors", "clock"), help=argparse.SUPPRESS)
    parser.add_argument("--rate", type=float, help=argparse.SUPPRESS)
    given = parser.parse_args()
    settle_ros_environment()
    if given.role:
        return sensors() if given.role == "sensors" else clock(given.rate)
    found = measure(given.duration) if given.duration else None
    swept = sweep() if given.sweep else []
    if given.json:
        print(json.dumps((asdict(found) if found else {}) | ({"sweep": swept} if swept else {})))
    else:
        show(found, swept)
    return None


if __name__ == "__main__":
    main()
