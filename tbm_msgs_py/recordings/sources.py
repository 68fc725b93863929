"""The kinds of topics that a recording is read for: those of sensors, and the joint states."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Generic, TypeVar

import numpy as np

from tbm_msgs_py.bags.batch import MessageBatch, Topic
from tbm_msgs_py.bags.definitions import JOINT_STATE_TYPE
from tbm_msgs_py.recordings.channels import ChosenChannel
from tbm_msgs_py.recordings.clocks import ClockTrack
from tbm_msgs_py.recordings.decoding import ACCELERATION_TYPES, DecodedSamples, decode_samples
from tbm_msgs_py.recordings.joint_states import JointStates
from tbm_msgs_py.recordings.mapping import SensorMapping
from tbm_msgs_py.recordings.timeline import Timeline

_FEW = 0.01  # share of the messages, or samples, of a topic
_BLOCKS = 5  # in a batch, for their median to say something
_OVERLAP = 1.5  # length of blocks by the time between their stamps; of blocks in a row it is below 1


class SensorTopic:
    """One topic of one sensor, while it is read.

    Parameters
    ----------
    name : str
        Of the topic.
    channels : mapping of Topic to int
        Every channel of that name, and its messages.
    sensor : SensorMapping

    Attributes
    ----------
    channel : ChosenChannel
        What of it is used.
    line : Timeline
        Its samples.
    clock : ClockTrack
        Its stamps against the log times.

    Raises
    ------
    RecordingError
        No channel can be decoded.
    """

    def __init__(self, name: str, channels: Mapping[Topic, int], sensor: SensorMapping) -> None:
        self.name, self.sensor = name, sensor
        self.channel = ChosenChannel(name, channels, ACCELERATION_TYPES)
        self.line, self.clock = Timeline(), ClockTrack()
        self._frame, self._messages = sensor.frame_id, sum(channels.values())
        self._samples, self._overlap = 0, 0.0

    @property
    def doubts(self) -> list[str]:
        """What rate and coverage do not show: that much of the topic is not used, or that its blocks overlap."""
        found, place = self.line.total, f"test point {self.sensor.point}:"
        messages = found.undecodable + found.astray + found.unstamped + found.unmeasured
        samples = found.invalid + found.duplicates + found.late
        lines = []
        if messages > _FEW * self._messages or samples > _FEW * self._samples:
            lines.append(
                f"{place} of {self._messages} messages of {self.name} {', '.join(found.dropped())} are not used: rate "
                "and coverage are those of the rest"
            )
        if self._overlap > _OVERLAP:
            lines.append(
                f"{place} blocks of {self.name} last {self._overlap:.3g} times as long as their stamps are apart: t in "
                "another unit than s, or several sensors?"
            )
        return lines

    def problem(self, unread: str) -> str:
        """Why there are no samples, if there are none; what of the recording is not read may be the reason."""
        return f"topic {self.name}: {self.line.problem or unread or 'no finite sample, allowed: at least one'}"

    def add(self, topic: Topic, messages: MessageBatch) -> None:
        """Add the next messages of one channel, in file order."""
        if not self.channel.takes(topic, len(messages)):
            return
        samples = self._of_one_frame(decode_samples(topic.type, messages, self.channel.used.store))
        self._samples += len(samples.times_ns)
        self._overlap = max(self._overlap, _overlap(samples))
        self.line.add(samples)
        self.clock.add(samples.stamps_ns, samples.log_ns)

    def _of_one_frame(self, samples: DecodedSamples) -> DecodedSamples:
        """Leave out the messages of another frame: two sensors are no sensor of twice the rate."""
        if not len(samples.frames):
            return samples
        counts = np.bincount(samples.frames, minlength=len(samples.frame_ids))
        if self._frame is None:
            self._frame = samples.frame_ids[int(np.argmax(counts))]
        if samples.frame_ids == (self._frame,):
            return samples
        for frame, count in zip(samples.frame_ids, counts.tolist(), strict=True):
            if frame != self._frame and count:
                reason = f"frame_id {self._frame!r} is used, another may be chosen by the key frame_id of the mapping"
                self.channel.leave_out(f"frame_id {frame!r}", reason, count)
        if self._frame not in samples.frame_ids:
            self.line.problem = (
                self.line.problem or f"no message of frame_id {self._frame!r}, allowed: one that is there"
            )
        return samples.of_frame(self._frame)


def _overlap(samples: DecodedSamples) -> float:
    """Length of blocks by the time between their stamps; 0 where there are too few, or messages of one sample."""
    counts = samples.counts
    if len(counts) < _BLOCKS or counts.min() < 2:
        return 0.0
    last = np.cumsum(counts) - 1
    length = samples.times_ns[last] - samples.times_ns[last - counts + 1]
    apart = float(np.median(np.abs(np.diff(samples.stamps_ns))))
    return float(np.median(length)) / apart if apart else 0.0


StatesT = TypeVar("StatesT", bound=JointStates[Any])


class JointTopic(Generic[StatesT]):
    """A topic of joint states, while it is read: that of the operating point, or of the drives.

    Parameters
    ----------
    what : str
        What it is, for messages.
    name : str
        Of the topic.
    channels : mapping of Topic to int
        Every channel of that name, and its messages.
    states : JointStates
        Takes the messages that are used.

    Raises
    ------
    RecordingError
        No channel can be decoded.
    """

    def __init__(self, what: str, name: str, channels: Mapping[Topic, int], states: StatesT) -> None:
        self.what, self.name, self.states = what, name, states
        self.channel = ChosenChannel(name, channels, (JOINT_STATE_TYPE,))

    def add(self, topic: Topic, messages: MessageBatch) -> None:
        """Add the next messages of one channel."""
        if self.channel.takes(topic, len(messages)):
            self.states.add(messages, self.channel.used.store)

    def doubts(self, doubt: str | None) -> list[str]:
        """Say what may be wrong with it, given the doubt of its record, None where it has none."""
        states, place = self.states, f"{self.what} {self.name}:"
        lines = [f"{place} {doubt}"] if doubt else []
        if states.undecodable or (doubt is None and states.problem):
            lines.append(f"{place} {states.undecodable} messages cannot be used: {states.problem}")
        return lines
