"""Page of a long history: windows of 10 s, five points, three axes, all day; `python benchmarks/history.py [DAYS]`.

The medians of one trend are held against those of all its windows; then the command that draws the page is timed, the
start of Python and the writing of the file included. The history is in the page cache. Best of several.
"""

from __future__ import annotations

import resource
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tbm_dynamics import load_machine
from tbm_gsa.app.report.quantiles import quantiles
from tbm_gsa.history import History, HistoryEntry, HistoryReader, Selection, WindowSource
from tbm_gsa.history.spread import read_spread
from tbm_gsa.provenance import machine_sha256
from tbm_msgs_py.topics import TEST_POINTS

DAYS = 90
LENGTH = 10 * 10**9
A_DAY = 86_400 * 10**9 // LENGTH
BEGIN = 1_750_000_000 * 10**9
TREND = ("shield", "x")
TIMES = 3


def levels(day: int) -> np.ndarray:
    """Measured RMS of every window, point and axis of a day, m/s²: by hours, five percent louder from day 60 on."""
    random = np.random.default_rng(day)
    hours = 2.0 * random.lognormal(0.0, 0.1, 24).repeat(A_DAY // 24)
    found: np.ndarray = hours[:, None] * random.lognormal(0.05 * (day >= 60), 0.15, (A_DAY, 3 * len(TEST_POINTS)))
    return found


def windows(day: int) -> Iterator[tuple[object, ...]]:
    """Rows of a day."""
    names = [(point, axis) for point in TEST_POINTS for axis in "xyz"]
    for number, row in enumerate(levels(day).tolist()):
        start = BEGIN + (day * A_DAY + number) * LENGTH
        for name, level in zip(names, row, strict=True):
            yield 1, *name, start, LENGTH, level, 2.0, abs(level - 2.0) / level, 1.0, 4.0 * level, 3.0


def write(path: Path, days: int) -> None:
    """Write a history, past the class that commits window by window."""
    source = WindowSource("live", "/tbm/analysis_node", "", "dz101", machine_sha256(load_machine("dz101")))
    with History(path) as history:
        history.add(source, [HistoryEntry("shield", "x", BEGIN, LENGTH, 1.0, 1.0, 0.0, 1.0)])
    with sqlite3.connect(path) as connection:
        for day in range(days):
            connection.executemany(
                "INSERT OR REPLACE INTO windows VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", windows(day)
            )


def median_errors(path: Path, days: int) -> np.ndarray:
    """Relative errors of the drawn medians of the trend against those of all its windows."""
    with HistoryReader(path) as history:
        spread = read_spread(history, Selection(point=TREND[0]))
    group = next(one for one in spread.groups if one.key[:2] == TREND)
    edges = spread.edges_ns()
    column = 3 * TEST_POINTS.index(TREND[0])
    every = np.concatenate([levels(day)[:, column] for day in range(days)])
    times = BEGIN + (np.arange(len(every)) + 0.5) * LENGTH
    drawn, exact = (quantiles(*of, edges).values[1] for of in ((group.middle_ns, group.field_rms), (times, every)))
    return np.abs(drawn / exact - 1.0)


def _processor_time() -> float:
    """Of the processes that have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Print what was measured."""
    days = int(sys.argv[1]) if len(sys.argv) > 1 else DAYS
    with tempfile.TemporaryDirectory() as folder:
        path, page = Path(folder, "history.sqlite"), Path(folder, "history.html")
        write(path, days)
        print(f"{days} days, {days * A_DAY * 3 * len(TEST_POINTS)} windows, {path.stat().st_size / 1e6:.0f} MB")
        errors = median_errors(path, days)
        print(f"medians of {TREND}: off by {100 * np.median(errors):.1f} %, at most {100 * errors.max():.1f} %")
        call = [sys.executable, "-m", "tbm_gsa.app.cli.main", "history", "--history", str(path), "--html", str(page)]
        seconds, processor = [], []
        for _ in range(TIMES):
            begin, used = time.perf_counter(), _processor_time()
            subprocess.run(call, check=True, capture_output=True)
            seconds.append(time.perf_counter() - begin)
            processor.append(_processor_time() - used)
        size = page.stat().st_size / 1000
        print(f"page: {size:.0f} kB in {min(seconds):.1f} s, {min(processor):.1f} s of processor time")


if __name__ == "__main__":
    main()
