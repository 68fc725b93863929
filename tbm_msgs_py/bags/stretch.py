"""Messages of a stretch of a file as arrays: what everything that reads recordings works on."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tbm_msgs_py.bags.records import Bytes

POOL = 4 << 20  # bytes of decompressed chunks that are handed on together
BATCH = 1000  # messages outside chunks that count as one batch


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
    """

    name: str
    type: str
    encoding: str = "cdr"
    qos: str = field(default="", repr=False)
    definition: str = field(default="", repr=False)
    type_hash: str = field(default="", repr=False)


class RawMessage(NamedTuple):
    """One serialised message with its log time in ns."""

    topic: Topic
    log_ns: int
    data: bytes


@dataclass(frozen=True, eq=False)
class Stretch:
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
        Where the batches (chunks) end within the messages.
    """

    data: Bytes
    messages: NDArray[np.int64]
    topics: dict[int, Topic]
    ends: tuple[int, ...]

    def __len__(self) -> int:
        return self.messages.shape[1]

    def counts(self) -> dict[Topic, int]:
        """Messages of each topic."""
        found: dict[Topic, int] = {}
        for channel, count in enumerate(np.bincount(self.messages[0])):
            if count:
                topic = self.topics[channel]
                found[topic] = found.get(topic, 0) + int(count)
        return found

    def of(self, topics: Collection[Topic]) -> Stretch:
        """Messages of some topics, as one batch."""
        channels = [channel for channel, topic in self.topics.items() if topic in topics]
        mask = self.messages[0] == channels[0] if len(channels) == 1 else np.isin(self.messages[0], channels)
        chosen = np.ascontiguousarray(self.messages[:, mask])
        return Stretch(self.data, chosen, self.topics, (chosen.shape[1],))

    def batches(self) -> Iterator[Stretch]:
        """Chunk after chunk."""
        for first, end in zip((0, *self.ends), self.ends, strict=False):
            yield Stretch(self.data, self.messages[:, first:end], self.topics, (end - first,))

    def raw(self) -> Iterator[RawMessage]:
        """One object a message, ordered by log time."""
        view = memoryview(self.data)
        order = np.argsort(self.messages[1], kind="stable")
        for channel, log_ns, at, size in self.messages[:, order].T.tolist():
            yield RawMessage(self.topics[channel], log_ns, bytes(view[at : at + size]))


def joined(
    window: Bytes, parts: Iterable[tuple[Bytes, NDArray[np.int64]]], topics: dict[int, Topic]
) -> Iterator[Stretch]:
    """Put the messages of chunks together: a call for each small chunk would cost more than the work in it.

    Parts within the window are joined as they are, the others by copying their bytes behind one another.
    """
    for inside, group in groupby(parts, key=lambda part: part[0] is window):
        found = list(group)
        data = window if inside else found[0][0]
        if not inside and len(found) > 1:
            places = np.cumsum([0, *(len(part) for part, _ in found)])
            data = np.concatenate([part for part, _ in found])
            found = [(data, part + [[0], [0], [place], [0]]) for (_, part), place in zip(found, places, strict=False)]
        messages = np.concatenate([part for _, part in found], axis=1)
        ends = tuple(np.cumsum([part.shape[1] for _, part in found]).tolist())
        yield Stretch(data, messages, topics, ends)
