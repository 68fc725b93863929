"""Speed of reading recordings, in one run of `python benchmarks/reading.py`.

Five sensors in turn in an MCAP file without compression, 1 MiB chunks with checksums. First a short file is read by
mcap-ros2-support, rosbags and this project, and the results are held against each other, number by number; then each is
timed: the libraries on the short file, this project on a long one that is in the page cache. Best of several.
"""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from tbm_msgs_py import ACCELERATION, Bag, blocks, open_recording, topics
from tbm_msgs_py.bags.definitions import BLOCK_TYPE, typestore
from tbm_msgs_py.recordings.decoding import DecodedSamples, decode_samples

ACCEL, IMU = "geometry_msgs/msg/AccelStamped", "sensor_msgs/msg/Imu"
START = 1_700_000_000 * 10**9
RATE, BLOCK = 1000, 100  # Hz; samples
PERIOD = 10**9 // RATE
SHORT = {ACCEL: 20_000, IMU: 20_000, BLOCK_TYPE: 2_000}
LONG = {ACCEL: 2_000_000, IMU: 1_000_000, BLOCK_TYPE: 180_000}  # the last: an hour
TIMES = 5


def message(kind: str, frame: str) -> bytearray:
    """One serialised message, its stamp to be filled in."""
    types = typestore().types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), frame)
    random = np.random.default_rng(len(frame))
    vector = types["geometry_msgs/msg/Vector3"](*random.normal(size=3))
    nine = np.zeros(9)
    if kind == ACCEL:
        content = types[kind](header, types["geometry_msgs/msg/Accel"](vector, vector))
    elif kind == IMU:
        turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        content = types[kind](header, turn, nine, vector, nine, vector, nine)
    else:
        field = types["sensor_msgs/msg/PointField"]
        fields = [field(name, at, datatype, 1) for name, at, datatype in ACCELERATION.fields]
        samples = blocks.encode(ACCELERATION, np.arange(BLOCK) / RATE, random.normal(size=(BLOCK, 3)))
        data = np.frombuffer(samples, np.uint8)
        step = ACCELERATION.point_step
        content = types[kind](header, 1, BLOCK, fields, False, step, len(data), data, True)
    return bytearray(typestore().serialize_cdr(content, kind))


def write(path: Path, kind: str, count: int) -> None:
    """Write `count` messages of five sensors in turn."""
    points = topics.TEST_POINTS
    name = topics.field_block if kind == BLOCK_TYPE else topics.field_accel
    step = PERIOD * (BLOCK if kind == BLOCK_TYPE else 1)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start("ros2", "benchmark")
        definition, _ = typestore().generate_msgdef(kind, ros_version=2)
        schema = writer.register_schema(kind, "ros2msg", definition.encode())
        channels = [writer.register_channel(topics.absolute(name(point)), "cdr", schema) for point in points]
        messages = [message(kind, point) for point in points]
        for i in range(count):
            turn, sensor = divmod(i, len(points))
            stamp = START + turn * step
            messages[sensor][4:12] = np.array(divmod(stamp, 10**9), "<u4").tobytes()
            writer.add_message(channels[sensor], stamp + step, bytes(messages[sensor]), stamp)
        writer.finish()


def samples(kind: str, decoded: object) -> tuple[np.ndarray, np.ndarray]:
    """Give times (ns) and values of one message of a library."""
    if kind == BLOCK_TYPE:
        block = blocks.from_cloud(decoded)
        return block.times_ns(), block.values
    stamp = blocks.stamp_to_ns(decoded.header.stamp)
    vector = decoded.accel.linear if kind == ACCEL else decoded.linear_acceleration
    return np.array([stamp]), np.array([[vector.x, vector.y, vector.z]])


def by_mcap_ros2(path: Path, found: Callable[[str, object], None]) -> None:
    """Decode with mcap-ros2-support."""
    with path.open("rb") as file:
        for _, channel, _, decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            found(channel.topic, decoded)


def by_rosbags(path: Path, found: Callable[[str, object], None]) -> None:
    """Decode with rosbags."""
    with AnyReader([path], default_typestore=typestore()) as reader:
        for connection, _, data in reader.messages():
            found(connection.topic, reader.deserialize(data, connection.msgtype))


def by_us(path: Path, found: Callable[[str, DecodedSamples], None]) -> None:
    """Decode to arrays of times (ns) and values, a few megabytes at a time."""
    for batch in Bag(path).batches():
        for topic, messages in batch.by_topic():
            found(topic.name, decode_samples(topic.type, messages))


def by_pieces(path: Path) -> None:
    """All the way: ordered, checked for faults, in machine axes and m/s², a minute at a time."""
    for _ in open_recording(path).pieces():
        pass


def check(path: Path, kind: str) -> None:
    """Compare the three, number by number."""
    ours: dict[str, list] = {}
    by_us(path, lambda topic, part: ours.setdefault(topic, []).append((part.times_ns, part.values)))
    for library in (by_mcap_ros2, by_rosbags):
        theirs: dict[str, list] = {}
        library(path, lambda topic, decoded, to=theirs: to.setdefault(topic, []).append(samples(kind, decoded)))
        if theirs.keys() != ours.keys():
            raise SystemExit(f"{kind}: {library.__name__} has other topics")
        for topic, parts in ours.items():
            for mine, other in zip(zip(*parts, strict=True), zip(*theirs[topic], strict=True), strict=True):
                if not np.array_equal(np.concatenate(mine), np.concatenate(other)):
                    raise SystemExit(f"{kind}: {library.__name__} and this project differ in {topic}")


def fastest(work: Callable[[], object], times: int = TIMES) -> float:
    """Seconds of the fastest of several runs."""
    taken = []
    for _ in range(times):
        start = time.perf_counter()
        work()
        taken.append(time.perf_counter() - start)
    return min(taken)


def main() -> None:
    """Run all."""
    print("| messages | read by | million messages/s | million samples/s |")
    print("| --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        for kind, few in SHORT.items():
            short, long = Path(folder) / "short.mcap", Path(folder) / "long.mcap"
            write(short, kind, few)
            write(long, kind, LONG[kind])
            check(short, kind)
            by_us(long, drop)
            rows = {
                "mcap-ros2-support": (few, fastest(lambda p=short: by_mcap_ros2(p, drop), 2)),
                "rosbags": (few, fastest(lambda p=short: by_rosbags(p, drop), 2)),
                "this project, arrays": (LONG[kind], fastest(lambda p=long: by_us(p, drop))),
                "this project, pieces": (LONG[kind], fastest(lambda p=long: by_pieces(p))),
            }
            for reader, (count, seconds) in rows.items():
                rate = count / seconds / 1e6
                each = BLOCK if kind == BLOCK_TYPE else 1
                print(f"| {kind.rpartition('/')[2]} | {reader} | {rate:.3g} | {rate * each:.3g} |")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"\npeak memory {peak:.0f} MB")


def drop(topic: str, decoded: object) -> None:
    """Drop a decoded message."""


if __name__ == "__main__":
    main()
