"""Recordings as other writers make them, and damage to them."""

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from tbm_msgs_py import Bag
from tbm_msgs_py.bags.batch import MessageBatch
from tbm_msgs_py.bags.definitions import typestore
from tbm_msgs_py.blocks import split_ns

VALUES = (0, 1, 2**16, 2**28, 2**31 - 1, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1)
KINDS = [(compression, True) for compression in CompressionType] + [(CompressionType.NONE, False)]


def rewrite(source, path, compression, *, chunk_size=20_000, **options):
    """The recording as the mcap library would have made it: small chunks with checksums."""
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=chunk_size, compression=compression, **options)
        writer.start("ros2", "test")
        channels = {}
        for message in Bag(source).messages():
            topic = message.topic
            if topic not in channels:
                schema = writer.register_schema(topic.type, "ros2msg", topic.definition.encode())
                channels[topic] = writer.register_channel(topic.name, "cdr", schema)
            writer.add_message(channels[topic], message.log_ns, message.data, message.log_ns)
        writer.finish()
    return path


def write_accel(writer, topic, stamp_ns, xyz, *, log_ns=None, frame_id=""):
    """Write one acceleration sample, logged at its stamp unless told otherwise."""
    name, types = "geometry_msgs/msg/AccelStamped", typestore().types
    vector = types["geometry_msgs/msg/Vector3"]
    sec, nanosec = split_ns(stamp_ns)
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](sec, nanosec), frame_id)
    accel = types["geometry_msgs/msg/Accel"](vector(*map(float, xyz)), vector(0.0, 0.0, 0.0))
    data = typestore().serialize_cdr(types[name](header, accel), name)
    writer.write(topic, name, stamp_ns if log_ns is None else log_ns, data)


def batch_of(messages):
    """Messages of one topic as a batch, one byte apart so that nothing is aligned."""
    data = np.frombuffer(b"".join(message + b"x" for message in messages), np.uint8)
    sizes = np.array([len(message) for message in messages], np.int64)
    at = np.cumsum(sizes + 1) - sizes - 1
    return MessageBatch(data, np.array([np.ones_like(at), at, at, sizes]), {}, (len(messages),))


class Mutations:
    """Random damage; the same for the same seed."""

    def __init__(self, seed):
        self._random = np.random.default_rng(seed)

    def damaged(self, data):
        """A copy with one to four kinds of damage."""
        data = bytearray(data)
        kinds = (self._flip, self._cut, self._insert, self._remove, self._repeat, self._number, self._erase)
        for _ in range(self._random.integers(1, 5)):
            if data:
                kinds[self._random.integers(len(kinds))](data)
        return bytes(data)

    def _place(self, data):
        return int(self._random.integers(len(data)))

    def _stretch(self, data):
        first = self._place(data)
        return slice(first, first + int(self._random.choice([1, 4, 9, 40, 500, 5000])))

    def _flip(self, data):
        for _ in range(self._random.integers(1, 9)):
            data[self._place(data)] ^= 1 << int(self._random.integers(8))

    def _cut(self, data):
        del data[self._place(data) :]

    def _insert(self, data):
        data[(at := self._place(data)) : at] = self._random.bytes(int(self._random.integers(1, 300)))

    def _remove(self, data):
        del data[self._stretch(data)]

    def _repeat(self, data):
        data[(at := self._place(data)) : at] = data[self._stretch(data)]

    def _number(self, data):
        value = VALUES[self._random.integers(len(VALUES))]
        size = int(self._random.choice([2, 4, 8]))
        at = self._place(data)
        data[at : at + size] = (value % 2 ** (8 * size)).to_bytes(size, "little")

    def _erase(self, data):
        where = self._stretch(data)
        data[where] = bytes(len(data[where]))
