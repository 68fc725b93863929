"""Recordings of events: what the ring keeps, against a plain list; what is on the disk, read by rosbags."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader

from tbm_gsa.app.nodes.block_ring import BlockRing, KeptMessage
from tbm_gsa.app.nodes.snapshots import Snapshots
from tbm_gsa.history import Event
from tbm_msgs_py import ACCELERATION, OperatingPoint, read_acceleration
from tbm_msgs_py.bags.writing import serialised_block, serialised_operating_point
from tbm_msgs_py.topics import BLOCK_QOS, OPERATING_POINT_QOS

SECOND, START = 10**9, 1_700_000_000 * 10**9
EVENT = Event(START, "sensor", "girder", "warning", "sensor", "")
FIELD, POINT = "/tbm/field/girder/block", "/tbm/operating_point"


def message(number, size=10, latched=False, topic=FIELD):
    quality = OPERATING_POINT_QOS if latched else BLOCK_QOS
    return KeptMessage(topic, "sensor_msgs/msg/PointCloud2", quality, number * SECOND, bytes([number % 251]) * size)


def everything(ring):
    number, found = ring.after(0)
    kept = found
    while found:
        number, found = ring.after(number)
        kept = kept + found
    return kept


@settings(max_examples=40, deadline=None)
@example(sizes=[0, 1, 100], keep=2)
@given(sizes=st.lists(st.integers(0, 120), max_size=40), keep=st.integers(0, 12))
def test_the_ring_holds_the_newest_that_have_room(sizes, keep):
    ring = BlockRing(100, keep * SECOND)
    given = [message(number, size) for number, size in enumerate(sizes)]
    for one in given:
        ring.add(one)
    fitting = [one for one in given if len(one.data) <= 100]
    kept = everything(ring)
    assert kept == fitting[len(fitting) - len(kept) :]  # the newest, whole and in their order
    assert sum(len(one.data) for one in kept) <= 100
    if kept:
        assert kept[-1].at_ns - kept[0].at_ns <= keep * SECOND
        older = fitting[: len(fitting) - len(kept)]
        in_time = [one for one in older if kept[-1].at_ns - one.at_ns <= keep * SECOND]
        # One that would have been in time went because there was no room: at worst an end of the memory stays empty.
        assert not in_time or sum(len(one.data) for one in [in_time[-1], *kept]) > 100 - max(map(len, map(data, kept)))


def data(one):
    return one.data


def test_a_latched_message_outlives_the_ring_and_a_jump_back():
    ring = BlockRing(100, 5 * SECOND)
    ring.add(message(1, latched=True, topic=POINT))
    for number in (3, 8):
        ring.add(message(number))
    assert [one.at_ns for one in ring.latched()] == [SECOND]
    assert [one.at_ns // SECOND for one in everything(ring)] == [3, 8]
    ring.add(message(2))
    assert [one.at_ns // SECOND for one in everything(ring)] == [2]
    assert ring.latched()[0].topic == POINT


def block(number):
    at_ns = START + number * SECOND
    values = np.full((10, 3), float(number))
    content = serialised_block(ACCELERATION, at_ns, np.arange(10) / 10.0, values, "girder")
    return KeptMessage(FIELD, "sensor_msgs/msg/PointCloud2", BLOCK_QOS, at_ns, bytes(content))


def taken(snapshots, now):
    """What came of the recording, which its thread ends."""
    done = snapshots.poll(now)
    if done is None:
        snapshots._running._thread.join()
    return done or snapshots.poll(now)


@pytest.fixture
def snapshots(tmp_path):
    made = Snapshots(tmp_path / "snapshots", 60.0, 30.0, 1e6, 1e6)
    content = serialised_operating_point(START, OperatingPoint(0.7, 4e6, 9e6))
    made.keep(KeptMessage(POINT, "sensor_msgs/msg/JointState", OPERATING_POINT_QOS, START, bytes(content)))
    yield made
    made.close()


def test_a_minute_before_and_half_a_minute_after_are_recorded(snapshots):
    for number in range(100):
        snapshots.keep(block(number))
    path = snapshots.begin(EVENT, START + 100 * SECOND)
    assert Path(path).name == "20231114T221500Z_sensor_girder"
    assert snapshots.begin(EVENT, START + 101 * SECOND) == path  # it runs
    for number in range(100, 130):
        snapshots.keep(block(number))
        assert snapshots.poll(START + number * SECOND) is None
    outcome = taken(snapshots, START + 130 * SECOND)
    assert (outcome.path, outcome.problem, outcome.there) == (path, "", True)
    record = read_acceleration(path, topic=FIELD)
    assert (record.values[0, 0], record.values[-1, 0], record.gaps) == (39.0, 129.0, [])
    with AnyReader([Path(path)]) as reader:
        counts = {one.topic: one.msgcount for one in reader.connections}
        assert counts == {FIELD: 91, POINT: 1}
        stamps = [stamp for _, stamp, _ in reader.messages()]
        assert stamps[0] == START + 39 * SECOND
        assert all(b >= a for a, b in pairwise(stamps))
    assert snapshots.begin(EVENT, START + 140 * SECOND) == ""  # the same again
    assert snapshots.begin(EVENT, START + 900 * SECOND)


def test_the_newest_recordings_are_kept(tmp_path):
    made = Snapshots(tmp_path, 60.0, 0.0, 1e6, 30e3)
    paths = []
    for number in range(4):
        for second in range(20):
            made.keep(block(1000 * number + second))
        now = START + (1000 * number + 20) * SECOND
        paths.append(Path(made.begin(EVENT, now)))
        assert taken(made, now).problem == ""
    there = [path.exists() for path in paths]
    assert there[-1]
    assert not there[0]
    assert there == sorted(there)


def test_what_cannot_be_recorded_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    made = Snapshots(tmp_path / "file" / "snapshots", 60.0, 0.0, 1e6, 1e6)
    assert made.begin(EVENT, START) == ""  # nothing has come
    made.keep(block(0))
    assert made.begin(EVENT, START)
    outcome = taken(made, START + SECOND)
    assert "allowed: a folder that can be written" in outcome.problem
    assert not outcome.there
    assert Snapshots(None, 60.0, 0.0, 1e6, 1e6).begin(EVENT, START) == ""
