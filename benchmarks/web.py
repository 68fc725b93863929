"""The page to watch beside the real nodes: `python benchmarks/web.py [--seconds 30]`.

Three nodes and five sensors (as `streaming.py` has them), then the page's node beside them: without a client, with one,
with twenty, and with twenty beside one that reads a kilobyte a second and one that reads nothing. Processor time of
every node, what the clients got, blocks that were lost. Then a real Chromium, if there is one: the time to its first
paint and to the verdict.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
from streaming import BLOCKS, System, Watcher, cpu, memory

from tbm_gsa.app.cli.processes import NodeCommand, settle_ros_environment

PORT = 18080
NODES = ("load_node", "dynamics_node", "analysis_node", "web_view")
WARM_UP_S = 12.0
SLOW_BYTES = 1000  # a second
LOADS = 5  # of the page in a browser


async def read(counts: dict[str, list[float]], name: str, pause: float) -> None:
    """Count what one client gets; with a pause it reads a little of it once a second."""
    head = f"GET /live HTTP/1.1\r\nHost: 127.0.0.1:{PORT}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    reader, writer = await asyncio.open_connection("127.0.0.1", PORT, limit=SLOW_BYTES if pause else 1 << 20)
    writer.write(f"{head}Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode())
    begin = time.monotonic()
    counts[name] = [0.0, 0.0]
    while pause < 1e6 and (found := await reader.read(SLOW_BYTES if pause else 1 << 20)):
        counts[name] = [counts[name][0] + len(found), time.monotonic() - begin]
        await asyncio.sleep(pause)
    if pause >= 1e6:
        await asyncio.sleep(pause)


async def clients(fast: int, slow: int, dead: int, seconds: float) -> None:
    """Be clients for a while; bytes a second of each kind as JSON."""
    counts: dict[str, list[float]] = {}
    kinds = {"fast": (fast, 0.0), "slow": (slow, 1.0), "dead": (dead, 1e6)}
    tasks = [
        asyncio.create_task(read(counts, f"{kind} {place}", pause))
        for kind, (count, pause) in kinds.items()
        for place in range(count)
    ]
    await asyncio.sleep(seconds)
    for task in tasks:
        task.cancel()
    rates = [size / seconds for name, (size, _) in counts.items() if name.startswith("fast")]
    print(json.dumps({"bytes_s": sum(rates) / max(1, len(rates))}))


def phase(watcher: Watcher, processes: dict[str, psutil.Process], seconds: float, counts: tuple[int, int, int]) -> None:
    """Measure for a while with so many clients, and print a row."""
    command = [sys.executable, __file__, "--role", *map(str, counts), "--seconds", str(seconds)]
    reading = subprocess.Popen(command, stdout=subprocess.PIPE, text=True) if any(counts) else None
    watcher.spin(2.0)
    watcher.restart()
    before, start = {name: cpu(process) for name, process in processes.items()}, time.monotonic()
    watcher.spin(seconds - 4.0)
    wall = time.monotonic() - start
    share = {name: 100.0 * (cpu(process) - before[name]) / wall for name, process in processes.items()}
    lost = sum(watcher.meters[name].lost for name in BLOCKS)
    late = max(sorted(watcher.meters[name].late)[int(0.99 * watcher.meters[name].received)] for name in BLOCKS)
    told = json.loads(reading.communicate()[0])["bytes_s"] / 1e3 if reading else 0.0
    words = f"{counts[0]} clients" + (f", {counts[1]} slow, {counts[2]} that reads nothing" if counts[1] else "")
    row = [words, *(f"{share[name]:.1f}" if name in share else "–" for name in NODES)]
    used = memory(processes["web_view"]) if "web_view" in processes else 0.0
    print("|", " | ".join([*row, f"{used:.0f}", f"{told:.1f}", f"{lost}", f"{1e3 * late:.0f}"]), "|", flush=True)


@contextmanager
def browser() -> Iterator[Any]:
    """Chromium as the tests have it."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "test" / "ros"))
    from browser import start_browser  # noqa: PLC0415 - in the tests' folder

    with tempfile.TemporaryDirectory() as profile:
        started = start_browser(Path(profile))
        try:
            yield started
        finally:
            started.quit()


def first_paint() -> None:
    """Load the page again and again, also as on a phone that computes four times slower; medians."""
    script = """
        const done = arguments[0];
        const look = () => {
          const paint = performance.getEntriesByName("first-contentful-paint")[0];
          const told = document.querySelector("#name").textContent !== "tbm_monitor"
            && document.querySelector("#title").textContent !== "Waiting for the first word";
          if (paint && told) done([paint.startTime, performance.now()]);
          else requestAnimationFrame(look);
        };
        look();"""
    with browser() as started:
        for name, slower in (("this computer", 1), ("four times slower", 4)):
            started.execute_cdp_cmd("Emulation.setCPUThrottlingRate", {"rate": slower})
            times = []
            for _ in range(LOADS):
                started.get(f"http://127.0.0.1:{PORT}/")
                times.append(started.execute_async_script(script))
            paint, verdict = (sorted(one)[LOADS // 2] for one in zip(*times, strict=True))
            print(f"first paint on {name}: {paint:.0f} ms, verdict: {verdict:.0f} ms")


def measure(seconds: float) -> None:
    """Run all."""
    with tempfile.TemporaryDirectory() as folder, System(Path(folder)) as system:
        watcher = Watcher()
        processes = system.begin()
        watcher.wait_for_blocks(20)
        watcher.spin(WARM_UP_S)
        columns = [f"{name}, %" for name in NODES]
        print("| with |", " | ".join([*columns, "memory, MB", "kB/s a client", "blocks lost", "p99, ms"]), "|")
        print("|" + " --- |" * 9)
        phase(watcher, processes, seconds, (0, 0, 0))
        system.start(NodeCommand("web_view", {"port": PORT, "history": str(Path(folder) / "history.sqlite")}))
        processes["web_view"] = psutil.Process(system._running["web_view"].process.pid)
        watcher.spin(WARM_UP_S)
        for counts in ((0, 0, 0), (1, 0, 0), (20, 0, 0), (20, 1, 1)):
            phase(watcher, processes, seconds, counts)
        watcher.close()
        first_paint()


def main() -> None:
    """Measure, or be the clients."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="length of each phase")
    parser.add_argument("--role", nargs=3, type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.role:
        return asyncio.run(clients(*given.role, given.seconds))
    settle_ros_environment()
    return measure(given.seconds)


if __name__ == "__main__":
    main()
