"""Message objects: plain floats in every field, and arrays that survive the wire."""

import sys

import numpy as np
import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import deserialize_message, serialize_message

from tbm_msgs_py.base.drive_state import DriveState
from tbm_msgs_py.base.operating_point import OperatingPoint, from_joint_state
from tbm_msgs_py.blocks import LOADS, mesh_forces
from tbm_msgs_py.nodes import messages

STAMP_NS = 1_700_000_000_123_456_789


def over_the_wire(message):
    return deserialize_message(serialize_message(message), type(message))


@pytest.mark.parametrize("layout", [LOADS, mesh_forces(10)])
def test_a_block_survives_the_wire(layout):
    values = np.random.default_rng(0).normal(size=(50, len(layout.channels)))
    offsets = np.arange(50) / 5000
    block = messages.block_from(over_the_wire(messages.block(layout, STAMP_NS, offsets, values, "head")))
    assert (block.layout, block.stamp_ns, block.frame_id) == (layout, STAMP_NS, "head")
    np.testing.assert_array_equal(block.values, values)
    np.testing.assert_array_equal(block.offsets, offsets)


def test_whole_numbers_and_numpy_scalars_become_floats():
    numbers = np.array([1, 2, 3], np.float32)
    vector = over_the_wire(messages.vector3(STAMP_NS, numbers)).vector
    assert (vector.x, vector.y, vector.z) == (1.0, 2.0, 3.0)
    assert over_the_wire(messages.accel(STAMP_NS, [1, 2, 3])).accel.linear.z == 3.0
    wrench = over_the_wire(messages.wrench(STAMP_NS, range(6))).wrench
    assert (wrench.force.x, wrench.torque.z) == (0.0, 5.0)
    state = DriveState(tuple(numbers), (*numbers[:2], np.nan))
    assert messages.drives_from(over_the_wire(messages.drives_message(STAMP_NS, state))) == (
        STAMP_NS,
        DriveState((1.0, 2.0, 3.0), (1.0, 2.0, pytest.approx(np.nan, nan_ok=True))),
    )


def test_operating_point_and_clock():
    point = OperatingPoint(1, 2, 3, 4, 5)
    assert from_joint_state(over_the_wire(messages.operating_point_message(STAMP_NS, point))) == point
    assert messages.stamp_to_ns(over_the_wire(messages.clock(STAMP_NS)).clock) == STAMP_NS


def test_diagnostics_survive_the_wire():
    status = messages.status("model", "warn", "slow", {"real_time_factor": 0.8123456789, "lost": 3}, "dz101")
    received = over_the_wire(messages.diagnostics(STAMP_NS, [status])).status[0]
    assert (received.level, received.hardware_id) == (DiagnosticStatus.WARN, "dz101")
    assert [(pair.key, pair.value) for pair in received.values] == [("real_time_factor", "0.812346"), ("lost", "3")]


def test_unknown_message_class_is_none():
    for name in (
        "nowhere_msgs/msg/Thing",
        "sensor_msgs/msg/Thing",
        "sensor_msgs/msg/__file__",
        "antigravity/msg/Thing",  # a module of Python that opens a browser
        "/msg/Thing",
        "..msg/msg/Thing",
        "",
    ):
        assert messages.message_class(name) is None, name
    assert "antigravity" not in sys.modules
    assert messages.message_class("sensor_msgs/msg/Imu").__name__ == "Imu"
