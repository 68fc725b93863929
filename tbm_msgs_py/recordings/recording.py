"""Recordings as arrays: acceleration per test point on header time, in machine axes and m/s²."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from tbm_msgs_py.bags.bag import Bag
from tbm_msgs_py.bags.batch import MessageBatch, Topic
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.files import real_path
from tbm_msgs_py.base.texts import listed
from tbm_msgs_py.recordings.acceleration import AccelerationRecord, acceleration_record
from tbm_msgs_py.recordings.channels import LeftOut
from tbm_msgs_py.recordings.clocks import ClockTrack, clock_doubts, clock_shifts, reference_clock
from tbm_msgs_py.recordings.drives import DriveEntries, DriveRecord
from tbm_msgs_py.recordings.faults import FaultCounts
from tbm_msgs_py.recordings.mapping import (
    DriveMapping,
    TopicMapping,
    contract_mapping,
    contract_sensor,
    default_mapping_file,
    load_mapping,
)
from tbm_msgs_py.recordings.operating import OperatingPoints, OperatingRecord
from tbm_msgs_py.recordings.reading_order import follows_log
from tbm_msgs_py.recordings.sources import JointTopic, SensorTopic, StatesT
from tbm_msgs_py.recordings.splitting import RecordSplitter
from tbm_msgs_py.recordings.timeline import DecodedStream
from tbm_msgs_py.recordings.used import BY_PROGRAM, UsedSources

PIECE_S = 60.0


class NoSampleError(RecordingError):
    """No test point of a recording has a single sample; one line that says why of each."""


@dataclass(frozen=True)
class UsedMapping:
    """A mapping, and the file that it was read from, if it was.

    Attributes
    ----------
    mapping : TopicMapping
    file : Path or None
        Absolute, links followed.
    stated : bool
        It was given or found, and is not the contract's.
    """

    mapping: TopicMapping
    file: Path | None = None
    stated: bool = True


class RecordingReader:
    """A recording read piece by piece; made by `open_recording`.

    Attributes
    ----------
    path : Path
        Of the recording, absolute, links followed.
    sensors : dict
        Sensor of each mapped test point that is in the recording; none where it holds the drives alone.
    mapping : UsedMapping
        What says so.
    """

    def __init__(self, bag: Bag, mapping: UsedMapping) -> None:
        self.path, self.mapping = bag.path, mapping
        self._bag = bag
        self._channels = _channels(bag)
        self._restart()
        self.sensors = {point: topic.sensor for point, topic in self._sensors.items()}
        if not self.sensors and self._drives is None:
            raise RecordingError(f"{bag.path}: {self._no_sensor()}")

    @property
    def messages(self) -> int:
        """Messages read so far."""
        return sum(file.messages for file in self._bag.files)

    @property
    def lost(self) -> int:
        """Messages known to be missing or undecodable; complete when all pieces were read, like all below."""
        found = (topic.line.total for topic in self._sensors.values())
        undecodable = sum(faults.undecodable + faults.unstamped for faults in found)
        return self._bag.lost + undecodable + sum(topic.states.undecodable for topic in self._joints)

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
        """Operating points read so far, on the reference clock of the sensors; None without any."""
        return None if self._operating is None else self._operating.states.record(self._reference)

    @property
    def drives(self) -> DriveRecord | None:
        """Torque and speed of the drives read so far, on the reference clock of the sensors; None without any."""
        return None if self._drives is None else self._drives.states.record(self._reference)

    @property
    def drive_topic(self) -> str | None:
        """Topic of the drives, where the recording has it."""
        return None if self._drives is None else self._drives.name

    @property
    def drive_mapping(self) -> DriveMapping:
        """What says which topic is that of the drives, and how it was recorded."""
        return self.mapping.mapping.drives or DriveMapping()

    @property
    def _joints(self) -> list[JointTopic[OperatingPoints] | JointTopic[DriveEntries]]:
        """Topics of joint states that are read."""
        return [topic for topic in (self._operating, self._drives) if topic is not None]

    @property
    def _reference(self) -> ClockTrack | None:
        """Clock that joint states are placed on."""
        clocks = self.clocks
        reference = reference_clock(clocks)
        return None if reference is None else clocks[reference]

    @property
    def clocks(self) -> dict[str, ClockTrack]:
        """Clock of each test point."""
        return {point: topic.clock for point, topic in self._sensors.items()}

    @property
    def faults(self) -> Mapping[str, FaultCounts]:
        """What was found so far, by test point."""
        return {point: topic.line.total for point, topic in self._sensors.items()}

    def not_used(self, point: str) -> list[str]:
        """Return what of the topic of a test point is not used so far, a text each: how much, and why."""
        topic = self._sensors[point]
        left = [f"{one.messages} messages left out, {one.what}: {one.reason}" for one in topic.channel.left_out]
        return [*topic.line.total.dropped(), *left]

    @property
    def left_out(self) -> list[LeftOut]:
        """Messages of mapped topics that are not used, so far."""
        chosen = [topic.channel for topic in (*self._sensors.values(), *self._joints)]
        return [*self._beside, *(one for channel in chosen for one in channel.left_out)]

    @property
    def problems(self) -> Mapping[str, str]:
        """Why a test point that the mapping names has no samples so far."""
        unread = next(iter(self._bag.notes), "") if self._bag.lost or self._bag.damaged else ""
        silent = {point: topic.problem(unread) for point, topic in self._sensors.items() if point not in self._sampled}
        return {**self._missing, **silent}

    @property
    def sources(self) -> UsedSources:
        """Files, topics and clocks that are used, so far."""
        record, file = self.operating_point, self.mapping.file
        mapping = str(file) if file else BY_PROGRAM if self.mapping.stated else None
        placed = tuple(point for point, shift in clock_shifts(self.clocks).items() if shift)
        if self._operating is None or record is None:
            return UsedSources(mapping, placed=placed, drives=self.drive_topic)
        return UsedSources(mapping, self._operating.name, len(record.points), record.clock, placed, self.drive_topic)

    @property
    def doubts(self) -> list[str]:
        """What is not as mapping, stamps or rates say: the operating point, unused messages, clocks; a line each."""
        found = list(self._no_joints)
        for topic in self._joints:
            record = topic.states.record(self._reference)
            found += topic.doubts(None if record is None else record.doubt)
        found += [doubt for point, topic in self._sensors.items() if point in self._sampled for doubt in topic.doubts]
        return [*found, *clock_doubts(self.clocks)]

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
        NoSampleError
            At the end, when no test point had a single sample.
        """
        if not length_s >= 1e-3:
            raise ValueError(f"pieces of {length_s:g} s, allowed: 0.001 s or more")
        self._restart()
        splitter = RecordSplitter({point: topic.line for point, topic in self._sensors.items()}, length_s)
        sampled = {(topic.name, topic.channel.used.type) for topic in self._sensors.values()}
        by_log = self._bag.is_disordered() and follows_log(self._bag.batches(), sampled)
        for batch in self._bag.batches_in_order() if by_log else self._bag.batches():
            self._add(batch)
            yield from map(self._records, splitter.due())
        yield from map(self._records, splitter.rest())
        if not self._sampled:
            reasons = self.problems.values()
            raise NoSampleError(f"{self.path}: {listed(reasons, separator='; ') if reasons else self._no_sensor()}")

    def _restart(self) -> None:
        """Forget what was read, and find the topics of the mapping."""
        self._sensors: dict[str, SensorTopic] = {}
        self._missing: dict[str, str] = {}
        self._sampled: set[str] = set()
        for name, sensor in self.mapping.mapping.topics.items():
            try:
                self._sensors[sensor.point] = SensorTopic(name, self._found(name), sensor)
            except RecordingError as error:
                self._missing[sensor.point] = str(error)
        self._beside = [] if self.mapping.stated else _beside_blocks(self._channels, self.mapping.mapping)
        self._no_joints: list[str] = []
        named, drives = self.mapping.mapping, self.drive_mapping
        self._operating = self._joint_topic(
            "operating point", named.operating_point, OperatingPoints(), "operating_point" in named.model_fields_set
        )
        self._drives = self._joint_topic("drives", drives.topic, DriveEntries(drives), named.drives is not None)
        self._topics = {topic.name: topic for topic in self._sensors.values()}

    def _joint_topic(self, what: str, name: str, states: StatesT, stated: bool) -> JointTopic[StatesT] | None:
        """Topic of joint states; None where there is none, a doubt where it is there or was `stated`."""
        try:
            return JointTopic(what, name, self._found(name), states)
        except RecordingError as error:
            if stated or name in self._channels:
                self._no_joints.append(f"{what}: {error}: none of the recording is used")
        return None

    def _found(self, name: str) -> Mapping[Topic, int]:
        """Channels of a topic that the mapping names."""
        if name not in self._channels:
            raise RecordingError(f"topic {name} is not in the recording, {_listing(self._channels)}")
        return self._channels[name]

    def _no_sensor(self) -> str:
        wanted = self.mapping.mapping.topics
        if not any(name in self._channels for name in wanted):
            names = f" ({listed(wanted)})" if wanted else ""
            return f"no topic of the mapping is in the recording{names}, {_listing(self._channels)}"
        return listed(self._missing.values(), separator="; ")

    def _add(self, batch: MessageBatch) -> None:
        for topic, messages in batch.by_topic():
            if topic.name in self._topics:
                self._topics[topic.name].add(topic, messages)
            for joints in self._joints:
                if topic.name == joints.name:
                    joints.add(topic, messages)

    def _records(self, piece: Mapping[str, DecodedStream]) -> dict[str, AccelerationRecord]:
        self._sampled |= piece.keys()
        return {
            point: acceleration_record(self._sensors[point].name, self.sensors[point], data)
            for point, data in piece.items()
        }


class Recording(RecordingReader):
    """A recording that was read as a whole; made by `read_recording`.

    Attributes
    ----------
    points : dict
        Record of each mapped test point that has samples; none where the recording holds the drives alone.
    """

    def __init__(self, bag: Bag, mapping: UsedMapping) -> None:
        super().__init__(bag, mapping)
        found: dict[str, AccelerationRecord] = {}
        try:
            for piece in self.pieces(math.inf):
                found.update(piece)
        except NoSampleError:
            if self.sensors or self.drives is None:
                raise
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
        Not readable, nothing in it, or no mapped topic in it that can be decoded as acceleration; one of several that
        cannot is a problem of its test point.
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
    bag = Bag(real_path(path))
    if topic not in (found := _channels(bag)):
        raise RecordingError(f"{bag.path}: topic {topic} is not in the recording, {_listing(found)}")
    stated = _stated_mapping(bag, mapping)
    sensor = stated.mapping.topics.get(topic) if stated else None
    chosen = TopicMapping(topics={topic: sensor or contract_sensor(_point_of(topic))})
    recording = Recording(bag, UsedMapping(chosen, stated.file if stated else None))
    for record in recording.points.values():
        return record
    raise RecordingError(f"{bag.path}: {listed(recording.problems.values())}")


def _opened(path: str | Path, mapping: TopicMapping | str | Path | None) -> tuple[Bag, UsedMapping]:
    bag = Bag(real_path(path))
    return bag, _stated_mapping(bag, mapping) or UsedMapping(contract_mapping(_channels(bag)), stated=False)


def _stated_mapping(bag: Bag, mapping: TopicMapping | str | Path | None) -> UsedMapping | None:
    if isinstance(mapping, TopicMapping):
        return UsedMapping(mapping)
    file = default_mapping_file(bag.path) if mapping is None else Path(mapping)
    return None if file is None else UsedMapping(load_mapping(file), real_path(file))


def _channels(bag: Bag) -> dict[str, dict[Topic, int]]:
    """Channels with messages, and how many, by topic name."""
    found: dict[str, dict[Topic, int]] = {}
    for topic, count in bag.info().topics.items():
        if count:
            found.setdefault(topic.name, {})[topic] = count
    if not found:
        raise bag.nothing_read()
    return found


def _beside_blocks(channels: Mapping[str, Mapping[Topic, int]], mapping: TopicMapping) -> list[LeftOut]:
    """Single samples of test points whose blocks are used."""
    blocks = {name: name.removesuffix("block") + "accel" for name in mapping.topics if name.endswith("/block")}
    return [
        LeftOut(single, "single samples", sum(channels[single].values()), f"the blocks of {name} are used")
        for name, single in blocks.items()
        if single in channels
    ]


def _point_of(topic: str) -> str:
    parts = topic.strip("/").split("/")
    return parts[-2] if len(parts) > 1 else parts[0]


def _listing(channels: Mapping[str, Mapping[Topic, int]]) -> str:
    return "allowed: " + listed(f"{topic.name} ({topic.type})" for name in sorted(channels) for topic in channels[name])
