"""Torque and speed of the drives: joint states, recordings of them, and files that become one."""

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from import_files import START, START_NS, refused, write_csv
from mcap_ros2.reader import read_ros2_messages
from rosbags.typesys import Stores, get_typestore

from tbm_msgs_py import ACCELERATION, RecordingError, load_mapping, open_recording, read_acceleration, read_recording
from tbm_msgs_py.bags.definitions import JOINT_STATE_TYPE
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.base.drive_state import DriveState, DriveStateError, from_joint_state
from tbm_msgs_py.importing import describe, import_recording
from tbm_msgs_py.recordings.mapping import DriveMapping, TopicMapping

TYPES = get_typestore(Stores.ROS2_JAZZY).types
NAN = math.nan
SECOND = 1_000_000_000
TOPIC = "/tbm/field/drives"
DRIVES = {
    "torque": {"columns": ["M1 torque", None, "M3 torque"], "unit": "kN.m"},
    "speed": {"columns": ["M1 speed"], "unit": "r/min"},
    "ratio": 20.0,
}
COLUMNS = {"M1 torque": [1.5, 1.25], "M3 torque": [-0.5, 2.0], "M1 speed": [1500.0, 1200.0]}


def joints(name, velocity=(), effort=()):
    """Joint state as a library that is not ours has it."""
    arrays = [np.array(values, np.float64) for values in ((), velocity, effort)]
    header = TYPES["std_msgs/msg/Header"](TYPES["builtin_interfaces/msg/Time"](0, 0), "")
    return TYPES[JOINT_STATE_TYPE](header, list(name), *arrays)


def recorded(path, states, mapping=None):
    """What a recording of (s, state) in this order, beside a sensor, says of the drives; its reader, too."""
    with BagWriter(path) as writer:
        for second in range(4):
            stamp = START_NS + second * SECOND
            writer.write_block("/tbm/field/shield/block", stamp, ACCELERATION, np.arange(10) / 10, np.ones((10, 3)))
        for second, state in states:
            stamp = START_NS + round(second * SECOND)
            writer.write_drives(stamp, state, log_ns=START_NS + round(max(0.0, min(second, 4.0)) * SECOND))
    reader = open_recording(path, mapping)
    list(reader.pieces())
    return reader


@given(order=st.permutations(["drive_1", "drive_3", "cutterhead", "drive_40"]))
@settings(max_examples=20, deadline=None)
def test_joints_are_read_in_any_order(order):
    effort = [float("inf") if name == "drive_3" else len(name) for name in order]
    state = from_joint_state(joints(order, effort=effort))
    assert len(state.torque) == len(state.speed) == 40
    assert {number for number, torque in enumerate(state.torque, 1) if math.isfinite(torque)} == {1, 40}
    assert (state.torque[0], state.torque[39]) == (7.0, 8.0)
    assert np.isnan(state.speed).all()


@pytest.mark.parametrize(
    ("message", "problem"),
    [
        (joints(["drive_1", "drive_1"], effort=[1, 2]), "drive joints: drive_1 twice, allowed: each name once"),
        (joints(["cutterhead"], effort=[1]), "drive joints: cutterhead, allowed: drive_1 to drive_40"),
        (joints(["drive_01", "drive_41"], effort=[1, 2]), "drive_01, drive_41, allowed: drive_1 to drive_40"),
        (joints([]), "drive joints: none, allowed"),
        (joints(["drive_1"]), "neither efforts nor velocities, allowed: one for each name"),
        (joints(["drive_1", "drive_2"], effort=[1]), "drives: 1 efforts, allowed: 2, or none at all"),
        (joints(["drive_1"], [1, 2], [1]), "drives: 2 velocities, allowed: 1, or none at all"),
    ],
)
def test_a_state_of_no_drive_is_one_line(message, problem):
    with pytest.raises(DriveStateError, match=problem):
        from_joint_state(message)


def test_drives_come_in_the_order_of_time(tmp_path):
    states = [
        (1.0, DriveState((3.0,), (NAN,))),
        (0.5, DriveState((1.0, 2.0), (5.0, NAN))),
        (1.0, DriveState((9.0,), (NAN,))),
    ]
    reader = recorded(tmp_path / "bag", states)
    record = reader.drives
    assert (record.start_ns, record.time.tolist(), record.duplicates) == (START_NS + SECOND // 2, [0.0, 0.5], 1)
    np.testing.assert_array_equal(record.torque, [[1.0, 2.0], [3.0, NAN]])
    np.testing.assert_array_equal(record.speed, [[5.0, NAN], [NAN, NAN]])
    assert "drives: /tbm/field/drives" in reader.sources.lines()
    assert reader.doubts == []


@pytest.mark.parametrize(
    ("mapping", "second", "doubt"),
    [
        (
            DriveMapping(topic="/plc"),
            0.0,
            "drives: topic /plc is not in the recording, allowed: .* none of the recording",
        ),
        (DriveMapping(topic="/tbm/field/shield/block"), 0.0, "drives: .*PointCloud2, allowed: .*JointState"),
        (None, 9000.0, "drives /tbm/field/drives: 1 of 1 header stamps do not fit .* placed by the log times"),
    ],
)
def test_drives_that_cannot_be_used_are_a_doubt(tmp_path, mapping, second, doubt):
    topics = {"/tbm/field/shield/block": {"point": "shield", "units": "m/s2", "gravity": "removed", "frame": "fixed"}}
    stated = mapping and TopicMapping.model_validate({"topics": topics, "drives": mapping})
    reader = recorded(tmp_path / "bag", [(second, DriveState((1.0,), (2.0,)))], stated)
    (found,) = reader.doubts
    assert re.match(doubt, found)


def test_a_recording_of_drives_alone_is_read(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.write_drives(START_NS, DriveState((1.0, 2.0), (NAN, NAN)))
    recording = read_recording(tmp_path / "bag")
    assert (recording.points, recording.drives.torque.tolist()) == ({}, [[1.0, 2.0]])
    with pytest.raises(RecordingError, match="topic /tbm/field/drives: type sensor_msgs/msg/JointState, allowed: geom"):
        read_acceleration(tmp_path / "bag", TOPIC)


def test_columns_of_motors_become_drives_at_the_pinions(tmp_path):
    path = write_csv(tmp_path / "plc.csv", COLUMNS)
    imported = import_recording(path, describe(None, {"drives": DRIVES, "rate": 1.0, "start": START}), tmp_path / "bag")
    stream = imported.streams["drives"]
    assert (stream.topic, stream.samples, stream.rate_hz) == (TOPIC, 2, 1.0)
    assert stream.unmeasured == ["drive_2 torque", "drive_2 speed", "drive_3 speed"]
    found = [item.ros_msg for item in read_ros2_messages(next((tmp_path / "bag").glob("*.mcap")))]
    assert [list(one.name) for one in found] == [["drive_1", "drive_2", "drive_3"]] * 2
    np.testing.assert_allclose([one.effort for one in found], [[30e3, NAN, -10e3], [25e3, NAN, 40e3]])
    np.testing.assert_allclose([one.velocity for one in found], [[2.5 * np.pi, NAN, NAN], [2 * np.pi, NAN, NAN]])
    assert found[1].header.stamp.sec == START_NS // SECOND + 1
    assert not (tmp_path / "bag" / "mapping.yaml").exists()


def test_the_filter_of_drives_is_in_the_mapping(tmp_path):
    path, described = write_csv(tmp_path / "plc.csv", COLUMNS), {"drives": DRIVES | {"low_pass_hz": 0.3}}
    described = describe(None, described | {"rate": 1.0, "start": START})
    import_recording(path, described, tmp_path / "bag")
    assert load_mapping(tmp_path / "bag" / "mapping.yaml").drives == DriveMapping(low_pass_hz=0.3)
    assert "low_pass_hz" in refused(path, described, tmp_path / "bag.mcap")


@pytest.mark.parametrize(
    ("drives", "problem"),
    [
        ({}, "drives: torque or speed: missing, allowed: at least one"),
        ({"torque": {"columns": [None], "unit": "N.m"}}, "none or one twice, allowed: a column for each drive"),
        ({"torque": {"columns": ["a", "a"], "unit": "N.m"}}, "none or one twice"),
        ({"torque": {"columns": ["a"], "unit": "N"}}, "drives.torque.unit: 'N', allowed: "),
        ({"torque": {"columns": ["a"] * 41, "unit": "N.m"}}, "drives.torque.columns: .*allowed: at most 40"),
        (DRIVES | {"ratio": 0}, "drives.ratio: 0, allowed: greater than 0"),
    ],
)
def test_a_description_of_no_drive_is_one_line(drives, problem):
    with pytest.raises(Exception, match=problem):
        describe(None, {"drives": drives, "rate": 1.0, "start": START})
