"""Speed and memory of comparing an hour of five points at 1 kHz offline: `python benchmarks/comparison.py`.

First three minutes are compared in pieces of 7 s and in one, and have to agree. Then each part of the work on an hour
is measured in a process of its own, so that the memory is that of the whole process. The page cache is warm.
"""

from __future__ import annotations

import multiprocessing
import resource
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from tbm_gsa.comparison.field_side import FieldSide, reduce_field
from tbm_gsa.comparison.workflow import compare_recording
from tbm_gsa.signals.estimates import estimate
from tbm_gsa.signals.settings import Settings
from tbm_msgs_py import ACCELERATION, BagWriter
from tbm_msgs_py.recordings.acceleration import AccelerationRecord
from tbm_msgs_py.recordings.clocks import ClockTrack
from tbm_msgs_py.recordings.faults import FaultCounts
from tbm_msgs_py.recordings.recording import RecordingReader, open_recording

POINTS = ("cutterhead", "shield", "walkway", "girder", "gripper")
RATE, BLOCK, START_NS = 1000, 250, 1_700_000_000_000_000_000


def write(path: Path, seconds: int) -> Path:
    """Blocks of noise, interleaved as sensors send them."""
    values = np.random.default_rng(0).standard_normal((60 * RATE, 3))
    offsets = np.arange(BLOCK) / RATE
    with BagWriter(path) as writer:
        for first in range(0, seconds * RATE, BLOCK):
            place = first % len(values)
            for point in POINTS:
                stamp = START_NS + first * 1_000_000_000 // RATE
                writer.write_block(
                    f"/tbm/field/{point}/block", stamp, ACCELERATION, offsets, values[place : place + BLOCK]
                )
    return path


class InPieces:
    """A reader whose pieces have another length."""

    def __init__(self, reader: RecordingReader, length_s: float) -> None:
        self.sensors, self._reader, self._length = reader.sensors, reader, length_s

    @property
    def faults(self) -> Mapping[str, FaultCounts]:
        """What the reader has counted."""
        return self._reader.faults

    @property
    def clocks(self) -> Mapping[str, ClockTrack]:
        """Those of the reader."""
        return self._reader.clocks

    def pieces(self) -> Iterator[Mapping[str, AccelerationRecord]]:
        """Consecutive pieces."""
        return self._reader.pieces(self._length)


def rms(side: FieldSide) -> np.ndarray:
    """RMS of every point and axis."""
    statistics = [estimate(signal, {0: 1.0}, Settings()) for signal in side.signals.values()]
    return np.array([[axis.rms for axis in point.values()] for point in statistics])


def measured(name: str, path: Path, job: str) -> None:
    """Print a row of the table, from within a process of its own."""
    before = time.perf_counter(), time.process_time()
    if job == "reading":
        for _ in open_recording(path).pieces():
            pass
    elif job == "field":
        rms(reduce_field(open_recording(path), POINTS, Settings()))
    else:
        compare_recording(path)
    wall, cpu = time.perf_counter() - before[0], time.process_time() - before[1]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"| {name} | {wall:.1f} | {cpu:.1f} | {peak:.0f} |", flush=True)


def main() -> None:
    """Run all."""
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        short = open_recording(write(Path(folder) / "short", 180))
        one, pieces = (rms(reduce_field(InPieces(short, length), POINTS, Settings())) for length in (np.inf, 7.0))
        if not np.allclose(one, pieces, rtol=1e-6, atol=0.0):
            raise SystemExit(f"pieces and the whole differ by {np.abs(pieces / one - 1.0).max():.2g}")
        path = write(Path(folder) / "hour", 3600)
        print(
            "| an hour, five points, 1 kHz | s | CPU s | peak of the process, MB |\n| --- | --- | --- | --- |",
            flush=True,
        )
        for name, job in (("reading alone", "reading"), ("field side", "field"), ("whole `compare`", "compare")):
            process = context.Process(target=measured, args=(name, path, job))
            process.start()
            process.join()


if __name__ == "__main__":
    main()
