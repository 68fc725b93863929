"""Recordings as arrays: acceleration per test point on header time, in machine axes and m/s²."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from tbm_msgs_py.bags.bag import Bag
from tbm_msgs_py.bags.batch import MessageBatch, Topic
from tbm_msgs_py.bags.definitions import JOINT_STATE_TYPE
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.texts import listed, quoted
from tbm_msgs_py.recordings.decoding import ACCELERATION_TYPES, decode_samples
from tbm_msgs_py.recordings.faults import Clock, FaultCounts, find_gaps, stuck_axes
from tbm_msgs_py.recordings.mapping import (
    SensorMapping,
    TopicMapping,
    contract_mapping,
    contract_sensor,
    default_mapping_file,
    load_mapping,
)
from tbm_msgs_py.recordings.operating import OperatingPoints, OperatingRecord
from tbm_msgs_py.recordings.reading_order import follows_log
from tbm_msgs_py.recordings.splitting import RecordSplitter
from tbm_msgs_py.recordings.timeline import DecodedStream, Timeline

PIECE_S = 60.0


@dataclass(frozen=True)
class AccelerationRecord:
    """Acceleration of one test point, or a piece of it. What the faults mean is in docs/recordings.md.

    Attributes
    ----------
    topic, point : str
        Where it comes from.
    start_ns : int
        Header time of the first sample, ns since the epoch.
    time : ndarray (n,)
        Header time after `start_ns`, s, strictly increasing.
    values : ndarray (n, 3)
        Machine axes x, y, z, m/s².
    gaps : list of (float, float)
        Times of the last sample before and the first after each hole, s; in a piece the first hole may begin before
        `start_ns`, at a negative time.
    rate_hz : float
        Mean sample rate outside the gaps; 0 for fewer than two samples.
    clipped : int
        Samples at the stated range.
    gravity, frame : str
        As the mapping states: ``included`` or ``removed``, ``fixed`` or ``rotating``.
    stuck : tuple of (str, float, float)
        Sensor axis and times, s, of each interval in which it holds one value.
    faults : FaultCounts
        What was dropped or put right.
    clock : Clock
        Header stamps against log times.
    """

    topic: str
    point: str
    start_ns: int
    time: Array
    values: Array
    gaps: list[tuple[float, float]]
    rate_hz: float
    clipped: int = 0
    gravity: str = "removed"
    frame: str = "fixed"
    stuck: tuple[tuple[str, float, float], ...] = ()
    faults: FaultCounts = field(default_factory=FaultCounts)
    clock: Clock = field(default_factory=Clock)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.time[-1])


class RecordingReader:
    """A recording read piece by piece; made by `open_recording`.

    Attributes
    ----------
    path : Path
        Of the recording.
    sensors : dict
        Sensor of each mapped test point that is in the recording.
    """

    def __init__(self, bag: Bag, topics: Mapping[str, Topic], mapping: TopicMapping) -> None:
        self.path = bag.path
        self.sensors = {mapping.topics[name].point: mapping.topics[name] for name in topics}
        self._bag = bag
        self._topics = {mapping.topics[name].point: topic for name, topic in topics.items()}
        self._points = {(topic.name, topic.type): point for point, topic in self._topics.items()}
        self._mapping = mapping
        self._restart()

    @property
    def messages(self) -> int:
        """Messages read so far."""
        return sum(file.messages for file in self._bag.files)

    @property
    def lost(self) -> int:
        """Messages known to be missing or undecodable; complete when all pieces were read, like the two below."""
        undecodable = sum(line.total.undecodable for line in self._lines.values())
        return self._bag.lost + undecodable + self._operating.undecodable

    @property
    def truncated(self) -> bool:
        """A file ends before its recording does."""
        return self._bag.truncated

    @property
    def damaged(self) -> int:
        """Places that are no part of a recording; `lost` is a lower bound when there are any."""
        return self._bag.damaged

    @property
    def operating_point(self) -> OperatingRecord | None:
        """Operating points read so far, None without any."""
        return self._operating.record()

    @property
    def faults(self) -> Mapping[str, FaultCounts]:
        """What was found so far, by test point."""
        return {point: line.total for point, line in self._lines.items()}

    @property
    def problems(self) -> Mapping[str, str]:
        """Why a test point has no samples so far."""
        unread = next(iter(self._bag.notes), "") if self._bag.lost or self._bag.damaged else ""
        other = unread or "no finite sample, allowed: at least one"
        return {
            point: f"topic {self._topics[point].name}: {line.problem or other}"
            for point, line in self._lines.items()
            if point not in self._sampled
        }

    @cached_property
    def sha256(self) -> str:
        """Digest of the files."""
        return self._bag.sha256()

    def pieces(self, length_s: float = PIECE_S) -> Iterator[Mapping[str, AccelerationRecord]]:
        """Consecutive intervals of header time; a test point without samples in one is left out of it.

        Times are strictly increasing, also from one piece to the next; faults are counted per piece. What is held in
        memory is a piece and the samples that may still be late.

        Parameters
        ----------
        length_s : float
            Length of an interval, s; ``inf`` for the whole recording in one piece.

        Raises
        ------
        RecordingError
            At the end, when no test point had a single sample.
        """
        if not length_s >= 1e-3:
            raise ValueError(f"pieces of {length_s:g} s, allowed: 0.001 s or more")
        self._restart()
        splitter = RecordSplitter(self._lines, length_s)
        by_log = self._bag.is_disordered() and follows_log(self._bag.batches(), self._points)
        for batch in self._bag.batches_in_order() if by_log else self._bag.batches():
            self._add(batch)
            yield from map(self._records, splitter.due())
        yield from map(self._records, splitter.rest())
        if not self._sampled:
            raise RecordingError(f"{self.path}: {listed(self.problems.values(), separator='; ')}")

    def _restart(self) -> None:
        self._lines = {point: Timeline() for point in self.sensors}
        self._operating = OperatingPoints()
        self._sampled: set[str] = set()

    def _add(self, batch: MessageBatch) -> None:
        for topic, messages in batch.by_topic():
            if point := self._points.get((topic.name, topic.type)):
                self._lines[point].add(decode_samples(topic.type, messages))
            elif topic.name == self._mapping.operating_point and topic.type == JOINT_STATE_TYPE:
                self._operating.add(messages)

    def _records(self, piece: Mapping[str, DecodedStream]) -> dict[str, AccelerationRecord]:
        self._sampled |= piece.keys()
        return {point: _record(self._topics[point].name, self.sensors[point], data) for point, data in piece.items()}


class Recording(RecordingReader):
    """A recording that was read as a whole; made by `read_recording`.

    Attributes
    ----------
    points : dict
        Record of each mapped test point that has samples.
    """

    def __init__(self, bag: Bag, topics: Mapping[str, Topic], mapping: TopicMapping) -> None:
        super().__init__(bag, topics, mapping)
        found = {point: record for piece in self.pieces(math.inf) for point, record in piece.items()}
        self.points = {point: found[point] for point in self.sensors if point in found}


def open_recording(path: str | Path, mapping: TopicMapping | str | Path | None = None) -> RecordingReader:
    """Open a recording to read its mapped test points piece by piece.

    Parameters
    ----------
    path : str or Path
        rosbag2 folder or bare MCAP file; a damaged one is read as far as it goes.
    mapping : TopicMapping, str or Path, optional
        Mapping or its file; default `mapping.yaml` in or beside the recording, else the topics of the contract.

    Raises
    ------
    RecordingError
        Not readable, nothing in it, no mapped topic in it, or one of a type that is no acceleration.
    """
    return RecordingReader(*_opened(path, mapping))


def read_recording(path: str | Path, mapping: TopicMapping | str | Path | None = None) -> Recording:
    """Read every mapped test point of a recording as a whole, and its operating point.

    Parameters and errors are those of `open_recording`; it is an error, too, when no test point has a single sample.
    """
    return Recording(*_opened(path, mapping))


def read_acceleration(
    path: str | Path, topic: str, mapping: TopicMapping | str | Path | None = None
) -> AccelerationRecord:
    """Read one acceleration topic of a recording.

    Parameters
    ----------
    path : str or Path
        rosbag2 folder or bare MCAP file.
    topic : str
        Absolute topic name. One that no mapping names is taken as m/s² in machine axes, gravity removed.
    mapping : TopicMapping, str or Path, optional
        As in `open_recording`.
    """
    bag = Bag(path)
    found = _topics(bag)
    stated = _stated_mapping(bag, mapping)
    sensor = stated.topics.get(topic) if stated else None
    chosen = TopicMapping(topics={topic: sensor or contract_sensor(_point_of(topic))})
    mapped = _mapped(bag, found, chosen)
    if not mapped:
        raise RecordingError(f"{bag.path}: topic {topic} is not in the recording, {_listing(found)}")
    (record,) = Recording(bag, mapped, chosen).points.values()
    return record


def _opened(path: str | Path, mapping: TopicMapping | str | Path | None) -> tuple[Bag, dict[str, Topic], TopicMapping]:
    bag = Bag(path)
    found = _topics(bag)
    chosen = _stated_mapping(bag, mapping) or contract_mapping(dict.fromkeys(topic.name for topic in found))
    mapped = _mapped(bag, found, chosen)
    if not mapped:
        raise RecordingError(f"{bag.path}: no topic of the mapping is in the recording, {_listing(found)}")
    return bag, mapped, chosen


def _stated_mapping(bag: Bag, mapping: TopicMapping | str | Path | None) -> TopicMapping | None:
    if isinstance(mapping, TopicMapping):
        return mapping
    file = default_mapping_file(bag.path) if mapping is None else mapping
    return None if file is None else load_mapping(file)


def _topics(bag: Bag) -> list[Topic]:
    found = [topic for topic, count in bag.info().topics.items() if count]
    if not found:
        raise bag.nothing_read()
    return found


def _mapped(bag: Bag, found: list[Topic], mapping: TopicMapping) -> dict[str, Topic]:
    """Topic of each mapped name that is in the recording."""
    mapped: dict[str, Topic] = {}
    by_name: dict[str, list[Topic]] = {}
    for topic in found:
        by_name.setdefault(topic.name, []).append(topic)
    for name in mapping.topics:
        there = by_name.get(name, [])
        usable = [topic for topic in there if topic.type in ACCELERATION_TYPES and topic.encoding == "cdr"]
        if there and not usable and (other := there[0].encoding) != "cdr":
            raise RecordingError(f"{bag.path}: topic {name}: message encoding {quoted(other)}, allowed: cdr")
        if there and not usable:
            raise RecordingError(
                f"{bag.path}: topic {name}: type {there[0].type or 'unknown'}, allowed: {', '.join(ACCELERATION_TYPES)}"
            )
        if usable:
            mapped[name] = usable[0]
    return mapped


def _record(topic: str, sensor: SensorMapping, stream: DecodedStream) -> AccelerationRecord:
    start, values = int(stream.times_ns[0]), stream.values
    time = np.asarray((stream.times_ns - start) * 1e-9, np.float64)
    gaps, rate = find_gaps(time, None if stream.before_ns is None else (stream.before_ns - start) * 1e-9)
    clipped = 0
    if sensor.range is not None:
        clipped = int(np.count_nonzero((np.abs(values) >= sensor.range * (1 - 1e-6)).any(axis=1)))
    return AccelerationRecord(
        topic=topic,
        point=sensor.point,
        start_ns=start,
        time=time,
        values=values @ sensor.matrix().T,
        gaps=gaps,
        rate_hz=rate,
        clipped=clipped,
        gravity=sensor.gravity,
        frame=sensor.frame,
        stuck=tuple(("xyz"[axis], first, last) for axis, first, last in stuck_axes(time, values, rate)),
        faults=stream.faults,
        clock=stream.clock,
    )


def _point_of(topic: str) -> str:
    parts = topic.strip("/").split("/")
    return parts[-2] if len(parts) > 1 else parts[0]


def _listing(found: list[Topic]) -> str:
    return "allowed: " + listed(f"{topic.name} ({topic.type})" for topic in sorted(found, key=lambda t: t.name))
