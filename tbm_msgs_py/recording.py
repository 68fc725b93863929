"""Recordings as arrays: acceleration per test point on header time, in machine axes and m/s²."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tbm_msgs_py.bags.bag import Bag
from tbm_msgs_py.bags.errors import RecordingError
from tbm_msgs_py.bags.mapping import (
    Mapping,
    SensorMapping,
    contract_mapping,
    contract_sensor,
    default_mapping_file,
    load_mapping,
)
from tbm_msgs_py.bags.stretch import RawMessage, Topic
from tbm_msgs_py.bags.samples import ACCELERATION_TYPES, JOINT_STATE_TYPE, Samples, decode_samples, typestore
from tbm_msgs_py.blocks import stamp_to_ns
from tbm_msgs_py.operating_point import OperatingPoint, OperatingPointError, from_joint_state

GAP_FACTOR = 1.5  # a step longer than this many sample periods is a gap


@dataclass(frozen=True)
class AccelerationRecord:
    """Acceleration of one test point.

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
        Times of the last sample before and the first after each hole, s.
    rate_hz : float
        Mean sample rate outside the gaps; 0 for fewer than two samples.
    clipped, duplicates, invalid, undecodable : int
        Samples at the stated range; samples dropped for a repeated time or a value that is not finite; messages that
        could not be decoded.
    gravity, frame : str
        As the mapping states: ``included`` or ``removed``, ``fixed`` or ``rotating``.
    """

    topic: str
    point: str
    start_ns: int
    time: NDArray[np.float64]
    values: NDArray[np.float64]
    gaps: list[tuple[float, float]]
    rate_hz: float
    clipped: int = 0
    duplicates: int = 0
    invalid: int = 0
    undecodable: int = 0
    gravity: str = "removed"
    frame: str = "fixed"

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.time[-1])


@dataclass(frozen=True)
class OperatingRecord:
    """Operating point over time.

    Attributes
    ----------
    start_ns : int
        Header time of the first entry, ns.
    time : ndarray (n,)
        Header time after `start_ns`, s.
    points : tuple of OperatingPoint
        One each time.
    """

    start_ns: int
    time: NDArray[np.float64]
    points: tuple[OperatingPoint, ...]


@dataclass(frozen=True)
class Recording:
    """All mapped test points of a recording.

    Attributes
    ----------
    points : dict
        Record of each test point.
    operating_point : OperatingRecord or None
        When the recording has it.
    messages, lost : int
        Messages read; messages known to be missing or undecodable.
    truncated : bool
        A file ends before its recording does.
    sha256 : str
        Digest of the files.
    """

    path: Path
    points: dict[str, AccelerationRecord]
    operating_point: OperatingRecord | None
    messages: int
    lost: int
    truncated: bool
    sha256: str


def read_acceleration(path: str | Path, topic: str, mapping: Mapping | str | Path | None = None) -> AccelerationRecord:
    """Read one acceleration topic of a recording.

    Parameters
    ----------
    path : str or Path
        rosbag2 folder or bare MCAP file.
    topic : str
        Absolute topic name. One that no mapping names is taken as m/s² in machine axes, gravity removed.
    mapping : Mapping, str or Path, optional
        Mapping or its file; default `mapping.yaml` in or beside the recording, else the topics of the contract.
    """
    bag = Bag(path)
    stated = _stated_mapping(bag, mapping)
    messages, found = _collect(bag, {topic})
    if topic not in messages:
        raise RecordingError(f"{bag.path}: topic {topic} is not in the recording, {_listing(found)}")
    sensor = stated.topics.get(topic) if stated else None
    return _record(bag, messages[topic], sensor or contract_sensor(_point_of(topic)))


def read_recording(path: str | Path, mapping: Mapping | str | Path | None = None) -> Recording:
    """Read every mapped test point of a recording, and its operating point.

    Parameters
    ----------
    path : str or Path
        rosbag2 folder or bare MCAP file; a truncated one is read as far as it goes.
    mapping : Mapping, str or Path, optional
        As in `read_acceleration`.
    """
    bag = Bag(path)
    stated = _stated_mapping(bag, mapping)
    messages, found = _collect(bag, {*stated.topics, stated.operating_point} if stated else None)
    chosen = stated or contract_mapping(messages)
    mapped = [topic for topic in chosen.topics if topic in messages]
    if not mapped:
        raise RecordingError(f"{bag.path}: no topic of the mapping is in the recording, {_listing(found)}")
    records = {chosen.topics[topic].point: _record(bag, messages[topic], chosen.topics[topic]) for topic in mapped}
    total = sum(found.values())
    undecodable = sum(record.undecodable for record in records.values())
    return Recording(
        path=bag.path,
        points=records,
        operating_point=_operating_record(messages.get(chosen.operating_point, [])),
        messages=total,
        lost=max(bag.lost, (bag.declared or 0) - total) + undecodable,
        truncated=bag.truncated,
        sha256=bag.sha256(),
    )


def _stated_mapping(bag: Bag, mapping: Mapping | str | Path | None) -> Mapping | None:
    if isinstance(mapping, Mapping):
        return mapping
    file = default_mapping_file(bag.path) if mapping is None else mapping
    return None if file is None else load_mapping(file)


def _collect(bag: Bag, wanted: set[str] | None) -> tuple[dict[str, list[RawMessage]], dict[Topic, int]]:
    """Messages of the wanted topics (None: those that may be needed), and the count of every topic in the recording."""
    messages: dict[str, list[RawMessage]] = {}
    found: dict[Topic, int] = {}
    for message in bag.messages():
        topic = message.topic
        found[topic] = found.get(topic, 0) + 1
        if topic.name in wanted if wanted is not None else topic.type in (*ACCELERATION_TYPES, JOINT_STATE_TYPE):
            messages.setdefault(topic.name, []).append(message)
    if not found:
        raise RecordingError(f"{bag.path}: no message could be read, allowed: a recording with at least one message")
    return messages, found


def _record(bag: Bag, messages: list[RawMessage], sensor: SensorMapping) -> AccelerationRecord:
    topic = messages[0].topic
    where = f"{bag.path}: topic {topic.name}"
    if topic.type not in ACCELERATION_TYPES:
        raise RecordingError(f"{where}: type {topic.type or 'unknown'}, allowed: {', '.join(ACCELERATION_TYPES)}")
    samples = decode_samples(topic.type, [message.data for message in messages])
    if not len(samples.times_ns):
        raise RecordingError(f"{where}: none of {len(messages)} messages can be decoded: {samples.problem}")
    if not samples.times_ns.any():
        raise RecordingError(f"{where}: every header stamp is 0, allowed: stamped samples")
    times_ns, values, duplicates, invalid = _ordered(samples)
    if not len(times_ns):
        raise RecordingError(f"{where}: no sample is a finite number")
    time = (times_ns - times_ns[0]) * 1e-9
    gaps, rate = find_gaps(time)
    limit = np.inf if sensor.range is None else sensor.range * (1 - 1e-6)
    return AccelerationRecord(
        topic=topic.name,
        point=sensor.point,
        start_ns=int(times_ns[0]),
        time=time,
        values=values @ sensor.matrix().T,
        gaps=gaps,
        rate_hz=rate,
        clipped=int(np.count_nonzero((np.abs(values) >= limit).any(axis=1))),
        duplicates=duplicates,
        invalid=invalid,
        undecodable=samples.undecodable,
        gravity=sensor.gravity,
        frame=sensor.frame,
    )


def _ordered(samples: Samples) -> tuple[NDArray[np.int64], NDArray[np.float64], int, int]:
    """Order samples by time; times, values, and the counts of repeated times and non-finite values dropped."""
    finite = np.isfinite(samples.values).all(axis=1)
    times, values = samples.times_ns[finite], samples.values[finite]
    unique, first = np.unique(times, return_index=True)
    return unique, values[first], len(times) - len(unique), int(np.count_nonzero(~finite))


def find_gaps(time: NDArray[np.float64]) -> tuple[list[tuple[float, float]], float]:
    """Holes in increasing times (n,) in s, and the mean rate in Hz outside them."""
    if len(time) < 2:
        return [], 0.0
    steps = np.diff(time)
    holes = steps > GAP_FACTOR * np.median(steps)
    gaps = [(float(time[i]), float(time[i + 1])) for i in np.flatnonzero(holes)]
    return gaps, float(1.0 / np.mean(steps[~holes]))


def _operating_record(messages: list[RawMessage]) -> OperatingRecord | None:
    entries: list[tuple[int, OperatingPoint]] = []
    for message in messages:
        if message.topic.type != JOINT_STATE_TYPE:
            continue
        state = typestore().deserialize_cdr(message.data, JOINT_STATE_TYPE)
        try:
            entries.append((stamp_to_ns(state.header.stamp), from_joint_state(state)))  # type: ignore[attr-defined]
        except OperatingPointError:
            continue
    if not entries:
        return None
    entries.sort(key=lambda entry: entry[0])
    times = np.array([stamp for stamp, _ in entries], np.int64)
    return OperatingRecord(entries[0][0], (times - times[0]) * 1e-9, tuple(point for _, point in entries))


def _point_of(topic: str) -> str:
    parts = topic.strip("/").split("/")
    return parts[-2] if len(parts) > 1 else parts[0]


def _listing(found: dict[Topic, int]) -> str:
    return "topics there: " + ", ".join(f"{topic.name} ({topic.type})" for topic in sorted(found, key=lambda t: t.name))
