"""What reading said of the data of a recorded point, added up over the pieces."""

from dataclasses import dataclass, field, fields
from typing import Any

from tbm_msgs_py.recording import AccelerationRecord

COUNTS = tuple(item.name for item in fields(AccelerationRecord) if item.type == "int" and item.name != "start_ns")
"""Every fault that reading counts: clipped, duplicates, invalid and the others."""


@dataclass
class PointLedger:
    """Samples and faults of one recorded point.

    Attributes
    ----------
    topic, gravity, frame : str
        As the mapping states.
    start_ns : int
        Header time of the first sample.
    rate_hz : float
        Of the first piece.
    end : float
        s after the first sample, of the last one.
    samples : int
    gaps : list of (float, float)
        Holes, s after the first sample.
    stuck : list of (str, float, float)
        Sensor axis and begin and end, s after the first sample, where it holds one value.
    counts : dict of str to int
    clock_offset, clock_drift : float
        Means over the samples: header stamp minus log time, s, and its change, parts per million.
    """

    topic: str
    gravity: str
    frame: str
    start_ns: int
    rate_hz: float
    end: float = 0.0
    samples: int = 0
    gaps: list[tuple[float, float]] = field(default_factory=list)
    stuck: list[tuple[str, float, float]] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(COUNTS, 0))
    clock_offset: float = 0.0
    clock_drift: float = 0.0

    @classmethod
    def of(cls, record: AccelerationRecord) -> "PointLedger":
        """Begin with the first piece of a point."""
        return cls(record.topic, record.gravity, record.frame, record.start_ns, record.rate_hz)

    def add(self, record: AccelerationRecord) -> None:
        """Take the next piece."""
        offset = (record.start_ns - self.start_ns) * 1e-9
        self.gaps += [(offset + begin, offset + end) for begin, end in record.gaps]
        for axis, begin, end in record.stuck:
            self._hold(axis, offset + begin, offset + end, begin == 0.0)
        self.end = offset + float(record.time[-1])
        for name in COUNTS:
            self.counts[name] += getattr(record, name)
        share = len(record.time) / (self.samples + len(record.time))
        self.clock_offset += share * (record.clock_offset - self.clock_offset)
        self.clock_drift += share * (record.clock_drift - self.clock_drift)
        self.samples += len(record.time)

    def _hold(self, axis: str, begin: float, end: float, first: bool) -> None:
        """Note a stretch; one that begins a piece may go on with one that ended the piece before."""
        before = [place for place, (known, _, last) in enumerate(self.stuck) if known == axis and last == self.end]
        if first and before:
            self.stuck[before[0]] = (axis, self.stuck[before[0]][1], end)
        else:
            self.stuck.append((axis, begin, end))

    def to_dict(self) -> dict[str, Any]:
        """Give what a document holds."""
        return {
            "topic": self.topic,
            "samples": self.samples,
            "rate_hz": self.rate_hz,
            "duration": self.end,
            "gaps": [list(gap) for gap in self.gaps],
            "stuck": [list(stretch) for stretch in self.stuck],
            **self.counts,
            "clock_offset": self.clock_offset,
            "clock_drift": self.clock_drift,
            "gravity": self.gravity,
            "frame": self.frame,
        }
