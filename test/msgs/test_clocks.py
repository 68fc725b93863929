"""One check of clocks for sensors and operating points: what does not fit is placed by the log times, or named."""

import re

import numpy as np
import pytest
from bag_files import batch_of, write_accel
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_bag import START_NS

from tbm_msgs_py import ACCELERATION, BagWriter, OperatingPoint, RecordingError, blocks, read_recording
from tbm_msgs_py.bags.definitions import BLOCK_TYPE, serialised_block, serialised_operating_point, typestore
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.blocks import BlockError
from tbm_msgs_py.recordings.decoding import decode_samples
from tbm_msgs_py.recordings.recording_health import check_recording

MS, SECOND = 10**6, 10**9
HOUR = 3600 * SECOND
SHIELD, GIRDER = "/tbm/field/shield/accel", "/tbm/field/girder/accel"
POINTS = [OperatingPoint(0.5, torque, 1e7) for torque in (2e6, 4e6, 6e6)]
LOGGED = [0, 40 * SECOND, 80 * SECOND]  # after the start


def stamped(data, seconds, nanoseconds):
    """Message with another stamp than a writer of times would give it."""
    return bytes(data[:4]) + np.array([seconds & 0xFFFFFFFF, nanoseconds], "<u4").tobytes() + bytes(data[12:])


def recorded(path, stamps, *, sensor_ns=0, girder_ns=None, log_ns=None):
    """Two minutes of a sensor at 10 Hz and three operating points, whose (seconds, nanoseconds) are given."""
    with BagWriter(path) as writer:
        for k in range(1200):
            at = START_NS + k * 100 * MS
            log = at if log_ns is None else log_ns
            write_accel(writer, SHIELD, at + sensor_ns, (k, k % 7, 1), log_ns=log)
            if girder_ns is not None:
                write_accel(writer, GIRDER, at + girder_ns, (k, k % 7, 1), log_ns=log)
            if k * 100 * MS in LOGGED:
                place = LOGGED.index(k * 100 * MS)
                data = stamped(serialised_operating_point(at, POINTS[place]), *stamps[place])
                writer.write("/tbm/operating_point", "sensor_msgs/msg/JointState", log, data)
    return path


def shifted(by_ns):
    return [divmod(START_NS + at + by_ns, SECOND) for at in LOGGED]


@pytest.mark.parametrize(
    ("stamps", "sensor_ns", "named"),
    [
        ([(0, 0)] * 3, 0, "3 of 3 header stamps .*the stamp is 0"),
        (shifted(7 * HOUR), 0, "25200.000 s ahead of the sensors'"),
        (shifted(-7 * HOUR), 0, "2 of 3 .*25200.000 s behind the sensors'"),
        (shifted(0), -7 * HOUR, "25200.000 s ahead of the sensors'"),
        ([(1_700_000_000, 3 * SECOND)] * 3, 0, "3000000000 ns is no ROS time"),
        ([(-5, 0)] * 3, 0, "stamp of -5 s and 0 ns is no ROS time"),
        ([*shifted(0)[:2], (0, 0)], 0, "1 of 3"),
    ],
)
def test_operating_points_off_the_clock_use_the_log(tmp_path, stamps, sensor_ns, named):
    recording = read_recording(recorded(tmp_path / "bag", stamps, sensor_ns=sensor_ns))
    found = recording.operating_point
    assert found.clock == recording.sources.operating_clock == "log times"
    assert (found.start_ns + np.rint(found.time * 1e9)).tolist() == pytest.approx(
        [START_NS + at + sensor_ns for at in LOGGED], abs=MS
    )
    assert found.points == tuple(POINTS)
    (doubt,) = recording.doubts
    assert doubt.startswith("operating point /tbm/operating_point: ")
    assert doubt.endswith(": placed by the log times")
    assert re.search(named, doubt)


@pytest.mark.parametrize("sensor_ns", [0, -7 * HOUR, 3 * SECOND - START_NS])
def test_operating_points_on_the_clock_keep_their_stamps(tmp_path, sensor_ns):
    """That of the sensors, be it the recorder's or not; a latched first one is hours older than the recording."""
    stamps = shifted(sensor_ns + 2 * SECOND)
    if sensor_ns == 0:
        stamps[0] = divmod(START_NS - 5 * HOUR, SECOND)
    recording = read_recording(recorded(tmp_path / "bag", stamps, sensor_ns=sensor_ns))
    assert (recording.operating_point.clock, recording.doubts) == ("header stamps", [])
    found = recording.operating_point
    times = [seconds * SECOND + nanoseconds for seconds, nanoseconds in stamps]
    assert (found.start_ns + np.rint(found.time * 1e9)).tolist() == pytest.approx(times, abs=1000)


def test_without_clock_and_log_times_none_is_used(tmp_path):
    recording = read_recording(recorded(tmp_path / "bag", shifted(7 * HOUR), log_ns=START_NS))
    assert recording.operating_point is None
    assert "log times, which are all the same" in recording.doubts[0]
    fitting = read_recording(recorded(tmp_path / "good", shifted(0), log_ns=START_NS))
    assert (fitting.operating_point.clock, fitting.doubts) == ("header stamps", [])


def test_sensors_on_clocks_apart_are_named(tmp_path):
    health = check_recording(recorded(tmp_path / "bag", shifted(0), girder_ns=-7 * HOUR))
    assert health.reader.sources.placed == ("girder",)
    assert health.reader.doubts == [
        "test point girder: its clock is 25200.000 s behind that of shield: placed beside it by the log times"
    ]
    assert health.points["girder"].samples == 1200


def test_a_clock_of_another_speed_is_named(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(1200):
            write_accel(writer, SHIELD, START_NS + k * SECOND, (k, 0, 1), log_ns=START_NS + k * 100 * MS)
    (doubt,) = check_recording(tmp_path / "bag").reader.doubts
    assert re.fullmatch(
        r"test point shield: its header stamps span 1\d{3}\.\d+ s, its log times 11\d\.\d+ s: .*", doubt
    )


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30, -1e300])
@pytest.mark.parametrize("name", ["speed", "torque", "thrust", "head_angle", "advance"])
def test_no_operating_point_is_absurd(name, value):
    with pytest.raises(InputError, match="not finite or absurd, allowed: up to 1e"):
        OperatingPoint(**{"speed": 0.5, "torque": 2e6, "thrust": 1e7, name: value})


STAMP = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
GOOD = st.tuples(st.integers(1, 2**31 - 1), st.integers(0, SECOND - 1))


@given(st.lists(STAMP | GOOD, max_size=12), st.sampled_from(["block", "accel"]))
@settings(max_examples=40)
def test_stamps_that_are_no_ros_time_are_counted(stamps, kind):
    """As rclpy has it: no negative seconds, and less than a second of nanoseconds."""
    name, store = {"block": BLOCK_TYPE, "accel": "geometry_msgs/msg/Vector3Stamped"}[kind], typestore()
    if kind == "block":
        data = serialised_block(ACCELERATION, 0, [0.0], [[1, 2, 3]], "a")
    else:
        vector = store.types["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0)
        header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](0, 0), "a")
        data = store.serialize_cdr(store.types[name](header, vector), name)
    valid = [seconds >= 0 and nanoseconds < SECOND for seconds, nanoseconds in stamps]
    samples = decode_samples(name, batch_of([stamped(data, *stamp) for stamp in stamps]))
    assert (samples.faults.unstamped, samples.faults.undecodable) == (len(stamps) - sum(valid), 0)
    assert samples.times_ns.tolist() == [s * SECOND + n for (s, n), good in zip(stamps, valid, strict=True) if good]
    for (seconds, nanoseconds), good in zip(stamps, valid, strict=True):
        time = store.types["builtin_interfaces/msg/Time"](seconds, nanoseconds)
        if good:
            assert blocks.stamp_to_ns(time) == seconds * SECOND + nanoseconds
        else:
            with pytest.raises(BlockError, match="is no ROS time, allowed: "):
                blocks.stamp_to_ns(time)


def test_no_ros_time_is_said_and_not_the_rate(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(500):
            data = serialised_block(ACCELERATION, START_NS + k * MS, [0.0], [[k, 0, 0]])
            bad = stamped(data, 1_700_000_000, SECOND + k) if k % 50 else bytes(data)
            writer.write("/tbm/field/shield/block", BLOCK_TYPE, START_NS + k * MS, bad)
    recording = read_recording(tmp_path / "bag")
    assert (recording.faults["shield"].unstamped, recording.lost) == (490, 490)
    assert recording.points["shield"].rate_hz == pytest.approx(20.0)
    with BagWriter(tmp_path / "all") as writer:
        writer.write("/tbm/field/shield/block", BLOCK_TYPE, START_NS, bad)
    with pytest.raises(RecordingError, match="ns is no ROS time"):
        read_recording(tmp_path / "all")


@pytest.mark.parametrize("few", [3, 40])
@pytest.mark.parametrize("place", [0, 300, 960])
def test_stamps_far_outside_the_log_times_are_astray(tmp_path, few, place):
    """However many: they do not make what follows late."""
    far = 2_000_000_000 * SECOND
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(1000):
            at = START_NS + k * MS
            write_accel(writer, SHIELD, far + k * MS if place <= k < place + few else at, (k, 0, 0), log_ns=at)
    shield = read_recording(tmp_path / "bag").points["shield"]
    assert (shield.faults.astray, shield.faults.late, shield.faults.clock_steps) == (few, 0, 0)
    assert len(shield.time) == 1000 - few
    assert shield.duration < 1.0


def test_far_stamps_are_astray_whatever_the_windows(tmp_path, monkeypatch):
    monkeypatch.setattr("tbm_msgs_py.bags.mcap_file.WINDOW", 1 << 12)
    test_stamps_far_outside_the_log_times_are_astray(tmp_path, 400, 300)
