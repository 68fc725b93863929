"""What is wrong with the sensors of a recording: the faults of its pieces added up, in the memory of one piece."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.recordings.acceleration import AccelerationRecord
from tbm_msgs_py.recordings.faults import CLOCK_JUMP_NS, FaultCounts, seconds_by_axis
from tbm_msgs_py.recordings.mapping import TopicMapping
from tbm_msgs_py.recordings.recording import NoSampleError, RecordingReader, open_recording

COUNTS = ("clipped", *FaultCounts.__dataclass_fields__)
"""Every fault that is counted."""


class _Drift:
    """Drift of a clock over a recording.

    From piece to piece, which is from the first to the last: the scatter of the latency is divided by the length of the
    recording, while the drifts of the pieces would divide it by that of a piece. Where the offset jumps from one piece
    to the next the clock was set, or the log times stood still: that is no drift.
    """

    def __init__(self) -> None:
        self._last: tuple[float, float] | None = None  # middle and offset of the piece before, s
        self._change = self._time = 0.0
        self._largest, self._within = 0, 0.0  # samples of the largest piece, and the drift in it

    @property
    def ppm(self) -> float:
        """Parts per million; those in the largest piece when no two pieces go together."""
        return 1e6 * self._change / self._time if self._time else self._within

    def add(self, middle: float, record: AccelerationRecord) -> None:
        """Add the next piece, its middle in s on any steady clock."""
        if self._last is not None:
            change = record.clock.offset - self._last[1]
            if abs(change) * NANOSECONDS <= CLOCK_JUMP_NS:
                self._change += change
                self._time += middle - self._last[0]
        self._last = middle, record.clock.offset
        if len(record.time) > self._largest:
            self._largest, self._within = len(record.time), record.clock.drift


@dataclass
class PointHealth:
    """Samples and faults of one test point over a whole recording.

    Attributes
    ----------
    topic, gravity, frame : str
        As the mapping states.
    start_ns : int
        Header time of the first sample.
    samples : int
        Those that can be used.
    duration : float
        From the first sample to the last, s.
    gaps : list of (float, float)
        Holes, s after the first sample.
    stuck : list of (str, float, float)
        Sensor axis, begin and end of each interval in which it holds one value, s after the first sample.
    clipped : int
        Samples at the stated range.
    clock_offset : float
        Mean over the samples of header stamp minus log time, s, latency included.
    faults : FaultCounts
        What was dropped or put right.
    """

    topic: str
    gravity: str
    frame: str
    start_ns: int
    samples: int = 0
    duration: float = 0.0
    gaps: list[tuple[float, float]] = field(default_factory=list)
    stuck: list[tuple[str, float, float]] = field(default_factory=list)
    clipped: int = 0
    clock_offset: float = 0.0
    faults: FaultCounts = field(default_factory=FaultCounts)
    _steps: int = 0
    _stepped_s: float = 0.0
    _drift: _Drift = field(default_factory=_Drift)

    @classmethod
    def of(cls, record: AccelerationRecord) -> PointHealth:
        """Health before the first piece of a point is added."""
        return cls(record.topic, record.gravity, record.frame, record.start_ns)

    @property
    def rate_hz(self) -> float:
        """Mean rate outside the gaps: steps by the time they take, of all pieces."""
        return self._steps / self._stepped_s if self._steps else 0.0

    @property
    def clock_drift(self) -> float:
        """Change of the offset of the clock per time, parts per million, from the first piece to the last."""
        return self._drift.ppm

    @property
    def missing_s(self) -> float:
        """Length of all gaps together."""
        return sum(end - begin for begin, end in self.gaps)

    @property
    def stuck_s(self) -> dict[str, float]:
        """Seconds that each sensor axis held one value."""
        return seconds_by_axis(self.stuck)

    def counts(self) -> dict[str, int]:
        """How often each fault of `COUNTS` occurred."""
        return {"clipped": self.clipped, **asdict(self.faults)}

    def add(self, record: AccelerationRecord) -> None:
        """Add the next piece."""
        offset, count = (record.start_ns - self.start_ns) / NANOSECONDS, len(record.time)
        self.gaps += [(offset + begin, offset + end) for begin, end in record.gaps]
        for axis, begin, end in record.stuck:
            self._hold(axis, offset + begin, offset + end, begin == 0.0)
        self.duration = offset + record.duration
        self.samples += count
        self.clipped += record.clipped
        self.clock_offset += count / self.samples * (record.clock.offset - self.clock_offset)
        self._drift.add(offset + record.duration / 2, record)
        if record.rate_hz:
            steps = count - 1 - sum(begin >= 0.0 for begin, _ in record.gaps)
            self._steps += steps
            self._stepped_s += steps / record.rate_hz

    def _hold(self, axis: str, begin: float, end: float, first: bool) -> None:
        """Add an interval; one that begins a piece may go on with one that ended the piece before."""
        if first:
            for place, (known, start, last) in enumerate(self.stuck):
                if known == axis and last == self.duration:
                    self.stuck[place] = (axis, start, end)
                    return
        self.stuck.append((axis, begin, end))


class RecordingHealth:
    """Health of the test points of a recording, added up while it is read.

    Attributes
    ----------
    reader : RecordingReader
        What reads it, and says what it left out.
    """

    def __init__(self, reader: RecordingReader) -> None:
        self.reader = reader
        self._points: dict[str, PointHealth] = {}

    @property
    def points(self) -> dict[str, PointHealth]:
        """Test points with samples so far, in the order of the mapping, with the faults behind their last samples."""
        for point, health in self._points.items():
            health.faults = self.reader.faults[point]
        return {point: self._points[point] for point in self.reader.sensors if point in self._points}

    @property
    def problems(self) -> dict[str, str]:
        """Why a test point has no samples so far."""
        return dict(self.reader.problems)

    def add(self, piece: Mapping[str, AccelerationRecord]) -> None:
        """Add the next piece."""
        for point, record in piece.items():
            self._points.setdefault(point, PointHealth.of(record)).add(record)


def check_recording(path: str | Path, mapping: TopicMapping | str | Path | None = None) -> RecordingHealth:
    """Read a recording through and add up the faults of its sensors.

    Parameters and errors are those of `open_recording`; a recording whose test points have no samples is no error.
    """
    reader = open_recording(path, mapping)
    health = RecordingHealth(reader)
    with suppress(NoSampleError):  # its problems say why
        for piece in reader.pieces():
            health.add(piece)
    return health
