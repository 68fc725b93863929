"""What is wrong with the sensors of a recording: the faults of its pieces added up, in the memory of one piece."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from tbm_msgs_py.bags.faults import Faults
from tbm_msgs_py.bags.mapping import Mapping
from tbm_msgs_py.recording import AccelerationRecord, open_recording


@dataclass
class PointHealth:
    """Faults of one test point over a whole recording.

    Attributes
    ----------
    topic : str
        Its topic.
    samples : int
        Those that can be used.
    rate_hz : float
        Mean rate outside the gaps.
    gaps, missing_s : int, float
        Holes, and their length together.
    clipped : int
        Samples at the stated range.
    stuck_s : dict
        Seconds that each sensor axis held one value.
    clock_offset, clock_drift : float
        Header stamp minus log time, s, latency included, and its change in parts per million.
    faults : Faults
        What was dropped or put right.
    """

    COUNTS: ClassVar = tuple(Faults.__dataclass_fields__)

    topic: str
    samples: int = 0
    rate_hz: float = 0.0
    gaps: int = 0
    missing_s: float = 0.0
    clipped: int = 0
    stuck_s: dict[str, float] = field(default_factory=dict)
    clock_offset: float = 0.0
    clock_drift: float = 0.0
    faults: Faults = field(default_factory=Faults)

    def add(self, record: AccelerationRecord) -> None:
        """Add a piece; its rate and clock count by its samples."""
        count = len(record.time)
        share = count / (self.samples + count)
        self.samples += count
        self.rate_hz += share * (record.rate_hz - self.rate_hz)
        self.clock_offset += share * (record.clock_offset - self.clock_offset)
        self.gaps += len(record.gaps)
        self.missing_s += sum(end - begin for begin, end in record.gaps)
        self.clipped += record.clipped
        for axis, begin, end in record.stuck:
            self.stuck_s[axis] = self.stuck_s.get(axis, 0.0) + end - begin


@dataclass(frozen=True)
class Health:
    """Test points of a recording, and why those without samples have none."""

    points: dict[str, PointHealth]
    problems: dict[str, str]


def check_recording(path: str | Path, mapping: Mapping | str | Path | None = None) -> Health:
    """Read a recording through and add up the faults of its sensors.

    Parameters and errors are those of `open_recording`; a recording whose test points have no samples is no error.
    """
    reader = open_recording(path, mapping)
    points: dict[str, PointHealth] = {}
    first: dict[str, AccelerationRecord] = {}
    last: dict[str, AccelerationRecord] = {}
    for piece in reader.pieces():
        for point, record in piece.items():
            points.setdefault(point, PointHealth(record.topic)).add(record)
            first.setdefault(point, record)
            last[point] = record
    for point, health in points.items():
        health.faults = reader.faults[point]
        health.clock_drift = _drift(first[point], last[point])
    return Health({point: points[point] for point in reader.points if point in points}, dict(reader.problems))


def _drift(first: AccelerationRecord, last: AccelerationRecord) -> float:
    """Change of the clock's offset per time, parts per million."""
    between = (last.start_ns - first.start_ns) * 1e-9 + (last.duration - first.duration) / 2
    return first.clock_drift if between <= 0.0 else 1e6 * (last.clock_offset - first.clock_offset) / between
