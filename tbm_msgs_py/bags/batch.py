"""Messages of a part of a file as arrays: what everything that reads recordings works on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import groupby
from typing import NamedTuple

import numpy as np

from tbm_msgs_py.base.arrays import Bytes, Flags, Integers

POOL = 4 << 20  # bytes of decompressed chunks that are passed on together
LOOSE = 1000  # messages outside chunks that count as one chunk


@dataclass(frozen=True)
class Topic:
    """One recorded topic.

    Attributes
    ----------
    name, type : str
        Absolute topic name and message type such as ``sensor_msgs/msg/Imu``.
    encoding : str
        ``cdr`` for ROS 2.
    qos : str
        Offered profiles as rosbag2 writes them (YAML), empty when unknown.
    definition, type_hash : str
        Message definition text, and its hash where the file states it.
    schema_encoding : str
        What the text is written in: ``ros2msg`` or ``ros2idl`` for ROS 2, empty when unknown.
    """

    name: str
    type: str
    encoding: str = "cdr"
    qos: str = field(default="", repr=False)
    definition: str = field(default="", repr=False)
    type_hash: str = field(default="", repr=False)
    schema_encoding: str = field(default="", repr=False)


class RawMessage(NamedTuple):
    """One serialised message with its log time in ns."""

    topic: Topic
    log_ns: int
    data: bytes


@dataclass(frozen=True, eq=False)
class MessageBatch:
    """Messages in file order.

    Attributes
    ----------
    data : ndarray of uint8
        Bytes that hold them.
    messages : ndarray (4, n)
        Channel, log time in ns, place and size in bytes of each.
    topics : dict
        Topic of each channel that occurs.
    ends : tuple of int
        Where the chunks end within the messages.
    """

    data: Bytes
    messages: Integers
    topics: dict[int, Topic]
    ends: tuple[int, ...]

    def __len__(self) -> int:
        return int(self.messages.shape[1])

    def counts(self) -> dict[Topic, int]:
        """Messages of each topic."""
        found: dict[Topic, int] = {}
        for channel, count in enumerate(np.bincount(self.messages[0])):
            if count:
                topic = self.topics[channel]
                found[topic] = found.get(topic, 0) + int(count)
        return found

    def by_topic(self) -> Iterator[tuple[Topic, MessageBatch]]:
        """Messages of each topic, in file order, as one chunk."""
        channels = self.messages[0].astype(np.uint16)
        ordered = np.take(self.messages, np.argsort(channels, kind="stable"), axis=1)
        ends = np.cumsum(np.bincount(channels))
        found: dict[Topic, list[Integers]] = {}
        for channel in np.flatnonzero(np.diff(ends, prepend=0)).tolist():
            first = int(ends[channel - 1]) if channel else 0
            found.setdefault(self.topics[channel], []).append(ordered[:, first : int(ends[channel])])
        for topic, parts in found.items():
            chosen = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
            if len(parts) > 1:  # two publishers of a topic: back into file order
                chosen = chosen[:, np.argsort(chosen[2], kind="stable")]
            yield topic, MessageBatch(self.data, chosen, self.topics, (chosen.shape[1],))

    def chunks(self) -> Iterator[MessageBatch]:
        """Chunk after chunk."""
        for first, end in zip((0, *self.ends), self.ends, strict=False):
            yield MessageBatch(self.data, self.messages[:, first:end], self.topics, (end - first,))

    def where(self, keep: Flags) -> MessageBatch:
        """Only some of the messages, chunk by chunk as before."""
        ends = np.concatenate(([0], np.cumsum(keep)))[list(self.ends)]
        return MessageBatch(self.data, self.messages[:, keep], self.topics, tuple(ends.tolist()))

    def raw(self) -> Iterator[RawMessage]:
        """One object a message, ordered by log time."""
        order = np.argsort(self.messages[1], kind="stable")
        for channel, log_ns, at, size in self.messages[:, order].T.tolist():
            yield RawMessage(self.topics[channel], log_ns, self.data[at : at + size].tobytes())


def joined(window: Bytes, parts: Iterable[tuple[Bytes, Integers]], topics: dict[int, Topic]) -> Iterator[MessageBatch]:
    """Join the messages of chunks: a call for each small chunk would cost more than the work in it.

    Parts within the window are joined as they are, the others by copying their bytes behind one another.
    """
    for inside, group in groupby(parts, key=lambda part: part[0] is window):
        found = list(group)
        data = window if inside else found[0][0]
        if not inside and len(found) > 1:
            places = np.cumsum([0, *(len(part) for part, _ in found)])
            data = np.concatenate([part for part, _ in found])
            shifts = [np.array([[0], [0], [place], [0]]) for place in places[:-1]]
            found = [(data, part + shift) for (_, part), shift in zip(found, shifts, strict=True)]
        messages = np.concatenate([part for _, part in found], axis=1)
        ends = tuple(np.cumsum([part.shape[1] for _, part in found]).tolist())
        yield MessageBatch(data, messages, topics, ends)


def rebatched(messages: Iterable[RawMessage]) -> Iterator[MessageBatch]:
    """Join single messages, in their order, to batches of up to `POOL` bytes."""
    channels: dict[Topic, int] = {}
    rows: list[tuple[int, int, int, int]] = []
    parts: list[bytes] = []
    place = 0
    for message in messages:
        channel = channels.setdefault(message.topic, len(channels))
        rows.append((channel, message.log_ns, place, len(message.data)))
        parts.append(message.data)
        place += len(message.data)
        if place > POOL:
            yield _batch(rows, parts, channels)
            rows, parts, place = [], [], 0
    if rows:
        yield _batch(rows, parts, channels)


def _batch(rows: list[tuple[int, int, int, int]], parts: list[bytes], channels: dict[Topic, int]) -> MessageBatch:
    topics = {channel: topic for topic, channel in channels.items()}
    data = np.frombuffer(b"".join(parts), np.uint8)
    return MessageBatch(data, np.array(rows, np.int64).T.copy(), topics, (len(rows),))
