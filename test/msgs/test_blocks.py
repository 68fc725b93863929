"""Blocks: what goes in comes out, and a block that contradicts itself is one clear line."""

import array
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tbm_msgs_py import blocks
from tbm_msgs_py.blocks import ACCELERATION, LOADS, BlockError, mesh_forces

LAYOUTS = (ACCELERATION, LOADS, mesh_forces(10), mesh_forces(3))
STAMP_NS = 1_700_000_000_123_456_789


def cloud(layout, packed, **changes):
    sec, nanosec = blocks.split_ns(STAMP_NS)
    message = SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), frame_id="sensor"),
        height=1,
        width=len(packed) // layout.point_step,
        fields=[SimpleNamespace(name=n, offset=o, datatype=d, count=1) for n, o, d in layout.fields],
        is_bigendian=False,
        point_step=layout.point_step,
        row_step=len(packed),
        data=array.array("B", packed),
    )
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def test_sensor_sample_is_20_bytes_as_the_contract_says():
    assert ACCELERATION.point_step == 20
    assert ACCELERATION.fields == (("t", 0, 8), ("ax", 8, 7), ("ay", 12, 7), ("az", 16, 7))
    assert LOADS.point_step == 56
    assert [name for name, _, _ in mesh_forces(10).fields][-1] == "f10"


@settings(max_examples=60)
@given(st.data(), st.sampled_from(LAYOUTS), st.integers(1, 40))
def test_round_trip_is_exact(data, layout, samples):
    width = 32 if layout.kind == "f4" else 64
    numbers = st.floats(-1e6, 1e6, width=width)
    offsets = data.draw(arrays(np.float64, samples, elements=st.floats(0, 10)))
    values = data.draw(arrays(np.float64, (samples, len(layout.channels)), elements=numbers))
    block = blocks.from_cloud(cloud(layout, blocks.encode(layout, offsets, values)))
    assert block.layout == layout
    assert block.stamp_ns == STAMP_NS
    assert block.frame_id == "sensor"
    np.testing.assert_array_equal(block.offsets, offsets)
    np.testing.assert_array_equal(block.values, values)


def test_times_are_whole_nanoseconds_far_from_the_epoch():
    offsets = np.arange(250) / 5000.0
    data = blocks.encode(ACCELERATION, offsets, np.zeros((250, 3)))
    times = blocks.from_cloud(cloud(ACCELERATION, data)).times_ns()
    np.testing.assert_array_equal(times, STAMP_NS + np.arange(250, dtype=np.int64) * 200_000)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"point_step": 24}, "point_step"),
        ({"row_step": 19}, "row_step"),
        ({"width": 3}, "row_step"),
        ({"width": 0}, "width"),
        ({"height": 2}, "height"),
        ({"is_bigendian": True}, "is_bigendian"),
        ({"data": array.array("B", b"\0" * 39)}, "39 bytes"),
        ({"fields": []}, "fields"),
        ({"fields": [SimpleNamespace(name="t", offset=0, datatype=7, count=1)]}, "fields"),
    ],
)
def test_contradiction_is_one_line(changes, named):
    data = blocks.encode(ACCELERATION, [0.0, 0.1], np.zeros((2, 3)))
    with pytest.raises(BlockError, match=named) as caught:
        blocks.from_cloud(cloud(ACCELERATION, data, **changes))
    assert "\n" not in str(caught.value)
    assert "allowed" in str(caught.value)


def test_time_that_is_not_finite_is_refused():
    data = blocks.encode(ACCELERATION, [0.0, np.nan, 0.2], np.zeros((3, 3)))
    with pytest.raises(BlockError, match="finite"):
        blocks.from_cloud(cloud(ACCELERATION, data))


def test_encode_refuses_shapes_that_do_not_match():
    with pytest.raises(BlockError, match="allowed"):
        blocks.encode(ACCELERATION, [0.0, 1.0], np.zeros((2, 2)))
    with pytest.raises(BlockError, match="allowed"):
        blocks.encode(ACCELERATION, [0.0], np.zeros((2, 3)))


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_stamp_round_trip(stamp_ns):
    sec, nanosec = blocks.split_ns(stamp_ns)
    assert blocks.stamp_to_ns(SimpleNamespace(sec=sec, nanosec=nanosec)) == stamp_ns


def test_stamp_out_of_range_is_refused():
    with pytest.raises(BlockError, match="32-bit"):
        blocks.split_ns(2**31 * 10**9)
