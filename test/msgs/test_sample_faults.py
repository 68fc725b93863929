"""Faults of the samples: found, counted, and handled as docs/recordings.md says."""

import numpy as np
import pytest
from bag_files import write_accel
from hypothesis import given
from hypothesis import strategies as st
from sample_bag import START_NS

from tbm_msgs_py import ACCELERATION, BagWriter, SensorMapping, TopicMapping, read_acceleration, read_recording
from tbm_msgs_py.recordings.faults import clock_of, other_clocks, stuck_axes
from tbm_msgs_py.recordings.recording_health import check_recording

TOPIC = "/tbm/field/shield/accel"
MS = 10**6
HOUR = 3600 * 10**9


def written(path, stamps, values=None, logs=None):
    """A recording of single samples, stamps and log times in ms after the start."""
    values = np.column_stack([np.sin(np.arange(len(stamps))) + k for k in range(3)]) if values is None else values
    with BagWriter(path) as writer:
        for k, (stamp, xyz) in enumerate(zip(stamps, values, strict=True)):
            log = stamp if logs is None else logs[k]
            write_accel(writer, TOPIC, START_NS + round(stamp * MS), xyz, log_ns=START_NS + round(log * MS))
    return path


def test_late_packets_are_put_in_order(tmp_path):
    stamps = np.arange(1000.0)
    values = np.column_stack([stamps, -stamps, 2 * stamps])
    order = np.r_[:300, 400:700, 300:400, 700:1000]
    written(tmp_path / "bag", stamps[order], values[order], logs=np.arange(1000.0))
    record = read_acceleration(tmp_path / "bag", TOPIC)
    np.testing.assert_allclose(record.time * 1e3, stamps, atol=1e-9)
    np.testing.assert_array_equal(record.values, values)
    assert (record.faults.disordered, record.faults.duplicates, record.faults.late, record.gaps) == (100, 0, 0, [])


def test_repeated_stamps_keep_the_first_sample(tmp_path):
    values = np.arange(30.0).reshape(10, 3)
    record = read_acceleration(written(tmp_path / "bag", [0, 1, 2, 2, 3, 4, 4, 4, 5, 6], values), TOPIC)
    assert record.faults.duplicates == 3
    np.testing.assert_array_equal(record.values, values[[0, 1, 2, 4, 5, 8, 9]])


def test_samples_that_are_not_finite_leave_a_gap(tmp_path):
    values = np.ones((50, 3)) + np.arange(50)[:, None]
    values[20, 1], values[21, 0], values[40, 2] = np.nan, np.inf, -np.inf
    record = read_acceleration(written(tmp_path / "bag", np.arange(50.0), values), TOPIC)
    assert record.faults.invalid == 3
    np.testing.assert_allclose(record.gaps, [(0.019, 0.022), (0.039, 0.041)])


def test_clipping_at_the_range_of_the_mapping(tmp_path):
    values = 20.0 * np.sin(np.arange(500) / 7)[:, None] * [1.0, 0.1, 0.1]
    clipped = np.clip(values, -16.0, 16.0)
    sensor = SensorMapping(point="shield", units="m/s2", gravity="removed", frame="fixed", range=16.0)
    path = written(tmp_path / "bag", np.arange(500.0), clipped)
    record = read_acceleration(path, TOPIC, TopicMapping(topics={TOPIC: sensor}))
    assert record.clipped == np.count_nonzero(np.abs(values[:, 0]) >= 16.0)
    assert len(record.time) == 500


def test_stuck_and_dead_axes(tmp_path):
    random = np.random.default_rng(3)
    values = random.normal(size=(5000, 3))
    values[:, 1] = 0.25
    values[1000:3001, 2] = values[1000, 2]
    record = read_acceleration(written(tmp_path / "bag", np.arange(5000.0), values), TOPIC)
    assert [(axis, *np.round((first, last), 9)) for axis, first, last in record.stuck] == [
        ("y", 0.0, 4.999),
        ("z", 1.0, 3.0),
    ]
    assert len(record.time) == 5000
    sensor = SensorMapping(point="shield", units="m/s2", gravity="removed", frame="fixed", axes=("-z", None, "x"))
    lacking = read_acceleration(tmp_path / "bag", TOPIC, TopicMapping(topics={TOPIC: sensor}))
    assert {axis for axis, *_ in lacking.stuck} == {"z"}  # y is none that the mapping says is measured


@given(st.integers(0, 400), st.integers(1, 400), st.integers(0, 400))
def test_stuck_intervals_of_any_place_and_length(before, held, after):
    values = np.concatenate([np.arange(before) + 1.0, np.zeros(held), -1.0 - np.arange(after)])[:, None]
    found = stuck_axes(np.arange(len(values), dtype=float), values, 100.0)
    assert found == ([(0, float(before), float(before + held - 1))] if held >= 100 else [])


def test_a_few_stamps_of_another_clock_are_dropped(tmp_path):
    stamps, logs = np.arange(2000.0), np.arange(2000.0) + 5
    stamps[[0, 500, 501, 1500]] += HOUR / MS
    record = read_acceleration(written(tmp_path / "bag", stamps, logs=logs), TOPIC)
    assert (record.faults.astray, record.faults.clock_steps, len(record.time)) == (4, 0, 1996)
    assert record.duration == pytest.approx(1.998)


def test_two_clocks_in_turn_on_one_topic_leave_one(tmp_path):
    stamps, logs = np.arange(1000.0), np.arange(1000.0)
    stamps[1::2] -= HOUR / MS
    record = read_acceleration(written(tmp_path / "bag", stamps, logs=logs), TOPIC)
    assert (record.faults.astray, len(record.time)) == (500, 500)
    assert record.rate_hz == pytest.approx(500.0)


@pytest.mark.parametrize("step", [60_000.0, HOUR / MS, 1e10])
def test_a_clock_that_is_set_forward_is_a_gap(tmp_path, step):
    stamps, logs = np.arange(1000.0) - 1e12, np.arange(1000.0)
    stamps[400:] += step
    record = read_acceleration(written(tmp_path / "bag", stamps, logs=logs), TOPIC)
    assert (record.faults.clock_steps, record.faults.astray, len(record.time)) == (1, 0, 1000)
    assert len(record.gaps) == 1


def test_a_clock_that_is_set_back_repeats_no_time(tmp_path):
    stamps, logs = np.arange(60_000.0, step=10.0), np.arange(60_000.0, step=10.0)
    stamps[3000:] -= 20_000.0
    record = read_acceleration(written(tmp_path / "bag", stamps, logs=logs), TOPIC)
    assert (record.faults.clock_steps, record.faults.astray) == (1, 0)
    assert record.faults.late == 2000
    np.testing.assert_allclose(record.time, np.arange(4000) / 100, atol=1e-9)


def test_burst_of_stored_samples_is_no_clock_fault(tmp_path):
    """A minute of samples arrives at once: their log times stand still, their stamps are right."""
    stamps = np.arange(300_000.0, step=100.0)
    logs = (stamps // 60_000 + 1) * 60_000
    record = read_acceleration(written(tmp_path / "bag", stamps, logs=logs), TOPIC)
    assert (record.faults.clock_steps, record.faults.astray, record.faults.late, len(record.time)) == (0, 0, 0, 3000)


def test_useless_log_times_change_no_sample(tmp_path):
    record = read_acceleration(written(tmp_path / "bag", np.arange(3000.0) * 100, logs=np.zeros(3000)), TOPIC)
    assert (len(record.time), record.faults.astray, record.faults.clock_steps, record.gaps) == (3000, 0, 0, [])


def test_offset_and_drift_of_a_clock():
    log = START_NS + np.arange(0, 3600, 0.1) * 1e9
    true = np.random.default_rng(1).exponential(0.002, len(log))
    stamps = (START_NS + (log - START_NS) * (1 + 25e-6) - 1.5e9 - true * 1e9).astype(np.int64)
    clock = clock_of(stamps, log.astype(np.int64))
    assert clock.drift == pytest.approx(25.0, rel=0.02)
    assert clock.offset == pytest.approx(-1.5 + 25e-6 * 1800, abs=0.005)


def test_drift_over_pieces_and_clocks_between_points(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(0, 400_000, 50):
            log = START_NS + k * MS
            write_accel(writer, "/tbm/field/shield/accel", log + k * 40, (k, 1, 2), log_ns=log)  # 40 ppm
            write_accel(writer, "/tbm/field/girder/accel", log - 7 * HOUR, (k, 1, 2), log_ns=log)
    health = check_recording(tmp_path / "bag")
    assert health.points["shield"].clock_drift == pytest.approx(40.0, rel=1e-3)
    assert health.points["girder"].clock_offset == pytest.approx(-7 * 3600.0)
    assert health.points["girder"].samples == health.points["shield"].samples == 8000
    assert set(health.points["girder"].stuck_s) == {"y", "z"}


def test_drift_is_from_the_first_piece_to_the_last(tmp_path):
    """A buffer that fills up within a minute makes every piece drift by -100 ppm of its own."""
    true = np.arange(0.0, 420_000.0, 200.0)
    latency = 6.0 * (true % 60_000) / 60_000
    health = check_recording(written(tmp_path / "bag", true * (1 + 40e-6), logs=true + latency))
    assert health.points["shield"].clock_drift == pytest.approx(40.0, rel=0.02)


def test_a_clock_that_is_set_does_not_drift(tmp_path):
    true = np.arange(0.0, 480_000.0, 200.0)
    shown = true * (1 + 40e-6) + np.where(true < 240_000, 0.0, HOUR / MS)
    shield = check_recording(written(tmp_path / "bag", shown, logs=true)).points["shield"]
    assert shield.faults.clock_steps == 1
    assert shield.clock_drift == pytest.approx(40.0, rel=0.02)


def test_rate_is_that_of_all_pieces(tmp_path):
    stamps = np.concatenate([np.arange(0.0, 120_000.0, 50.0), np.arange(120_000.0, 240_000.0, 100.0)])
    shield = check_recording(written(tmp_path / "bag", stamps)).points["shield"]
    assert shield.rate_hz == pytest.approx(15.0, rel=1e-3)  # half of the time 20 Hz, half 10 Hz


def test_one_dead_sensor_is_a_problem_and_no_error(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(20):
            write_accel(writer, TOPIC, START_NS + k * MS, (k, 0, 0))
            write_accel(writer, "/tbm/field/girder/accel", START_NS + k * MS, (np.nan, 0, 0))
            write_accel(writer, "/tbm/field/walkway/accel", START_NS + k * MS, (0, -1e300, 0))
            write_accel(writer, "/tbm/field/gripper/accel", 0, (k, 0, 0), log_ns=START_NS + k * MS)
    recording = read_recording(tmp_path / "bag")
    assert set(recording.points) == {"shield"}
    assert "finite" in recording.problems["girder"]
    assert "finite" in recording.problems["walkway"]
    assert recording.faults["walkway"].invalid == 20
    assert "stamp" in recording.problems["gripper"]


@given(st.lists(st.sampled_from([0, 1, 2]), min_size=1, max_size=60))
def test_no_message_of_the_clock_that_counts_is_astray(clocks):
    """Whatever the order of messages of clocks far apart, what is kept never jumps but at a step."""
    log = np.arange(len(clocks)) * 100 * MS
    stamps = log + np.array(clocks) * HOUR
    astray, steps, _ = other_clocks(stamps, log, None)
    kept = np.flatnonzero(~astray)
    changes = [int(kept[i + 1]) for i in np.flatnonzero(np.diff(np.array(clocks)[kept]))]
    assert set(changes) <= set(steps)
    assert len(kept) > 0


def test_samples_that_share_a_stamp_are_a_doubt(tmp_path):
    """Of a driver that stamps a packet of ten and not each sample: what is left is whole at a tenth of the rate."""
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(500):
            log = START_NS + k * 1_000_000
            write_accel(writer, "/tbm/field/shield/accel", log // 10_000_000 * 10_000_000, (k, 0, 0), log_ns=log)
    health = check_recording(tmp_path / "bag")
    assert health.points["shield"].rate_hz == pytest.approx(100.0)
    (doubt,) = health.reader.doubts
    assert "of 500 messages of /tbm/field/shield/accel 450 samples at the time of another are not used" in doubt


@pytest.mark.parametrize(("unit", "said"), [(1e-3, False), (1.0, True)])
def test_blocks_whose_times_are_no_seconds_are_a_doubt(tmp_path, unit, said):
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(20):
            values = np.random.default_rng(k).normal(size=(100, 3))
            stamp = START_NS + k * 200_000_000
            writer.write_block("/tbm/field/shield/block", stamp, ACCELERATION, np.arange(100) * unit, values)
    doubts = check_recording(tmp_path / "bag").reader.doubts
    assert ["last 495 times as long as their stamps are apart: t in" in doubt for doubt in doubts[-1:]] == [True] * said
