"""What was wrong with the data of a recording, per test point, added up over its pieces."""

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from tbm_gsa.arrays import Array
from tbm_msgs_py.recording import GAP_FACTOR, AccelerationRecord

_NOT_FAULTS = ("start_ns",)


@dataclass
class PointLedger:
    """Samples, faults and description of one recorded point.

    Attributes
    ----------
    topic, gravity, frame : str
        As the mapping states.
    start_ns : int
        Header time of the first sample.
    end : float
        s after it, of the last one.
    samples : int
    gaps : list of (float, float)
        Holes, also those between pieces: s after the first sample.
    counts : dict of str to int
        Every fault that reading counts: clipped, duplicates, invalid, undecodable and what else it may find.
    dead : list of str
        Machine axes on which not one sample differs from the first.
    """

    topic: str
    gravity: str
    frame: str
    start_ns: int
    rate_hz: float
    end: float = 0.0
    samples: int = 0
    gaps: list[tuple[float, float]] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    _first: Array | None = None
    _still: Array = field(default_factory=lambda: np.ones(3, dtype=bool))

    @classmethod
    def of(cls, record: AccelerationRecord) -> "PointLedger":
        """Begin with the first piece of a point."""
        return cls(record.topic, record.gravity, record.frame, record.start_ns, record.rate_hz)

    def add(self, record: AccelerationRecord) -> None:
        """Take the next piece."""
        offset = (record.start_ns - self.start_ns) * 1e-9
        if self.samples and self.rate_hz and offset + float(record.time[0]) - self.end > GAP_FACTOR / self.rate_hz:
            self.gaps.append((self.end, offset + float(record.time[0])))
        self.gaps += [(offset + begin, offset + end) for begin, end in record.gaps]
        self.end = offset + float(record.time[-1])
        self.samples += len(record.time)
        for item in fields(record):
            value = getattr(record, item.name)
            if isinstance(value, int) and item.name not in _NOT_FAULTS:
                self.counts[item.name] = self.counts.get(item.name, 0) + value
        if self._first is None:
            self._first = record.values[0]
        self._still &= (record.values == self._first).all(axis=0)

    @property
    def dead(self) -> list[str]:
        """Axes that say nothing; of a single sample that cannot be told."""
        return [axis for axis, still in zip("xyz", self._still, strict=True) if still and self.samples > 1]

    def to_dict(self) -> dict[str, Any]:
        """Give what a document holds."""
        return {
            "topic": self.topic,
            "samples": self.samples,
            "rate_hz": self.rate_hz,
            "duration": self.end,
            "gaps": [list(gap) for gap in self.gaps],
            "dead": self.dead,
            **self.counts,
            "gravity": self.gravity,
            "frame": self.frame,
        }
