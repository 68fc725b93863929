"""Decoding in bulk gives what the message libraries give, message by message."""

import numpy as np
import pytest
from bag_files import batch_of
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap_ros2._dynamic import generate_dynamic

from tbm_msgs_py import ACCELERATION, LOADS, blocks
from tbm_msgs_py.bags.definitions import BLOCK_TYPE, typestore
from tbm_msgs_py.recordings.decoding import ACCELERATION_TYPES, decode_samples

STORE = typestore()
TYPES = STORE.types
NUMBER = st.floats(allow_nan=False)
FRAME = st.text(st.characters(min_codepoint=32, max_codepoint=1000), max_size=20)


def header(stamp, frame):
    return TYPES["std_msgs/msg/Header"](TYPES["builtin_interfaces/msg/Time"](*stamp), frame)


def single(kind, stamp, frame, xyz, other):
    vector, rest = TYPES["geometry_msgs/msg/Vector3"](*xyz), TYPES["geometry_msgs/msg/Vector3"](other, other, other)
    if kind.endswith("Imu"):
        turn, nine = TYPES["geometry_msgs/msg/Quaternion"](other, 0.0, 0.0, 1.0), np.full(9, other)
        return TYPES[kind](header(stamp, frame), turn, nine, rest, nine, vector, nine)
    if kind.endswith("AccelStamped"):
        return TYPES[kind](header(stamp, frame), TYPES["geometry_msgs/msg/Accel"](vector, rest))
    return TYPES[kind](header(stamp, frame), vector)


@pytest.mark.parametrize("kind", [kind for kind in ACCELERATION_TYPES if kind != BLOCK_TYPE])
@given(
    st.lists(
        st.tuples(
            st.tuples(st.integers(0, 2**31 - 1), st.integers(0, 10**9 - 1)),
            FRAME,
            st.tuples(NUMBER, NUMBER, NUMBER),
            NUMBER | st.just(-1.0),
            st.booleans(),
        ),
        max_size=12,
    )
)
@settings(max_examples=60)
def test_single_samples_with_frames_of_any_length(kind, wanted):
    data = [
        bytes(STORE.serialize_cdr(single(kind, stamp, frame, xyz, other), kind, little_endian=little))
        for stamp, frame, xyz, other, little in wanted
    ]
    samples = decode_samples(kind, batch_of(data))
    marked = [kind.endswith("Imu") and other == -1.0 for *_, other, _ in wanted]
    assert (samples.faults.undecodable, samples.faults.unmeasured) == (0, sum(marked))
    wanted = [one for one, left in zip(wanted, marked, strict=True) if not left]
    assert [samples.frame_ids[k] for k in samples.frames] == [frame for _, frame, *_ in wanted]
    assert samples.times_ns.tolist() == [stamp[0] * 10**9 + stamp[1] for stamp, *_ in wanted]
    np.testing.assert_array_equal(samples.values, np.array([xyz for _, _, xyz, *_ in wanted]).reshape(-1, 3))


def test_single_samples_are_those_of_mcap_ros2():
    kind = "geometry_msgs/msg/AccelStamped"
    decode = generate_dynamic(kind, STORE.generate_msgdef(kind, ros_version=2)[0])[kind]
    random = np.random.default_rng(5)
    data = [
        bytes(STORE.serialize_cdr(single(kind, (k, 7), "x" * (k % 9), random.normal(size=3), 1.0), kind))
        for k in range(40)
    ]
    samples = decode_samples(kind, batch_of(data))
    for message, values in zip(map(decode, data), samples.values, strict=True):
        linear = message.accel.linear
        assert (linear.x, linear.y, linear.z) == tuple(values)


def cloud(layout, stamp, frame, offsets, values, **changed):
    field = TYPES["sensor_msgs/msg/PointField"]
    data = np.frombuffer(blocks.encode(layout, offsets, values), np.uint8)
    parts = {
        "header": header(stamp, frame),
        "height": 1,
        "width": len(offsets),
        "fields": [field(name=name, offset=at, datatype=kind, count=1) for name, at, kind in layout.fields],
        "is_bigendian": False,
        "point_step": layout.point_step,
        "row_step": len(data),
        "data": data,
        "is_dense": True,
    }
    return TYPES[BLOCK_TYPE](**{**parts, **changed})


@given(st.lists(st.tuples(st.integers(0, 30), FRAME, st.booleans(), st.integers(0, 9)), max_size=10))
@settings(max_examples=60)
def test_blocks_are_those_of_the_library(wanted):
    """Blocks of any length and byte order, some of them wrong: what `blocks.from_cloud` takes is taken alike."""
    messages, expected, wrong = [], [], 0
    random = np.random.default_rng(1)
    for k, (count, frame, little, kind) in enumerate(wanted):
        offsets, values = np.arange(count) / 7, random.normal(size=(count, 3))
        changed = {7: {"row_step": 1}, 8: {"width": count + 1}, 9: {"is_bigendian": True}}.get(kind, {})
        message = cloud(ACCELERATION, (k, 5), frame, offsets, values, **changed)
        messages.append(bytes(STORE.serialize_cdr(message, BLOCK_TYPE, little_endian=little)))
        try:
            expected.append(blocks.from_cloud(message))
        except blocks.BlockError:
            wrong += 1
    samples = decode_samples(BLOCK_TYPE, batch_of(messages))
    assert samples.faults.undecodable == wrong
    assert samples.times_ns.tolist() == [t for block in expected for t in block.times_ns().tolist()]
    np.testing.assert_array_equal(samples.values, np.concatenate([np.empty((0, 3)), *(b.values for b in expected)]))
    assert samples.counts.tolist() == [len(block.offsets) for block in expected]


@pytest.mark.parametrize(
    ("offsets", "named"), [([0.0, np.nan], "finite"), ([0.0, np.inf], "finite"), ([0.0, 1e9], "86400")]
)
def test_times_of_no_sense_make_a_block_undecodable(offsets, named):
    good = cloud(ACCELERATION, (1, 0), "a", [0.0, 0.1], np.ones((2, 3)))
    bad = cloud(ACCELERATION, (2, 0), "a", offsets, np.ones((2, 3)))
    samples = decode_samples(
        BLOCK_TYPE, batch_of([bytes(STORE.serialize_cdr(m, BLOCK_TYPE)) for m in (good, bad, good)])
    )
    assert (samples.faults.undecodable, samples.times_ns.tolist()) == (1, [10**9, 11 * 10**8] * 2)
    assert named in samples.problem


def test_blocks_of_other_channels_are_named():
    loads = cloud(LOADS, (1, 0), "", [0.0], np.ones((1, 6)))
    samples = decode_samples(BLOCK_TYPE, batch_of([bytes(STORE.serialize_cdr(loads, BLOCK_TYPE)), b"", b"\0\1"]))
    assert (samples.faults.undecodable, len(samples.times_ns)) == (3, 0)
    assert "fx fy fz" in samples.problem
