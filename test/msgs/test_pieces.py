"""A recording in pieces: together they are the whole, each is a stretch of header time."""

import tracemalloc

import numpy as np
import pytest
from bag_files import write_accel
from hypothesis import given
from hypothesis import strategies as st
from sample_bag import BLOCKS, RATE, SAMPLES, START_NS

from tbm_msgs_py import ACCELERATION, BagWriter, OperatingPoint, open_recording, read_recording
from tbm_msgs_py.recordings.decoding import DecodedSamples
from tbm_msgs_py.recordings.splitting import RecordSplitter
from tbm_msgs_py.recordings.timeline import LATENESS_NS, Timeline

S = 10**9


def together(pieces):
    found = {}
    for piece in pieces:
        for point, record in piece.items():
            found.setdefault(point, []).append(record)
    return found


@pytest.mark.parametrize("length", [0.001, 0.0335, 0.5, 1.0, 60.0, np.inf])
def test_pieces_are_the_whole(folder, length):
    whole = read_recording(folder)
    reader = open_recording(folder)
    assert reader.sensors.keys() == whole.points.keys()
    for point, records in together(reader.pieces(length)).items():
        times = np.concatenate([r.start_ns + np.rint(r.time * 1e9).astype(np.int64) for r in records])
        record = whole.points[point]
        np.testing.assert_array_equal(times, record.start_ns + np.rint(record.time * 1e9).astype(np.int64))
        np.testing.assert_array_equal(np.concatenate([r.values for r in records]), record.values)
        assert all(r.duration < length for r in records)
    assert (reader.messages, reader.lost, reader.truncated) == (whole.messages, 0, False)
    assert reader.operating_point.points == whole.operating_point.points
    assert reader.sha256 == whole.sha256


def test_points_of_a_piece_are_of_the_same_interval(folder):
    for number, piece in enumerate(open_recording(folder).pieces(0.5)):
        for record in piece.values():
            first = (record.start_ns - START_NS) / S
            assert 0.5 * number <= first
            assert first + record.duration < 0.5 * (number + 1)


def test_pieces_may_be_read_again(folder):
    reader = open_recording(folder)
    first = [len(record.time) for piece in reader.pieces(0.5) for record in piece.values()]
    assert first == [len(record.time) for piece in reader.pieces(0.5) for record in piece.values()]


def test_a_length_that_is_none_is_refused(folder):
    for length in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="pieces of"):
            next(open_recording(folder).pieces(length))


def samples(stamps, log=None, values=None):
    stamps = np.asarray(stamps, np.int64)
    values = np.column_stack([stamps, stamps, stamps]).astype(float) if values is None else values
    return DecodedSamples(stamps, stamps if log is None else log, np.ones(len(stamps), np.int64), stamps, values)


@given(st.lists(st.integers(-9, 9), min_size=1, max_size=200), st.integers(1, 40), st.integers(1, 50))
def test_samples_within_the_lateness_are_never_lost(jitter, length, batch):
    """Any disorder below the lateness comes out sorted, whatever the batches and the pieces."""
    stamps = (np.arange(len(jitter)) * 2 + np.array(jitter) / 2) * S / 2 + 1000 * S
    line = Timeline()
    cutter = RecordSplitter({"a": line}, length)
    pieces = []
    for first in range(0, len(stamps), batch):
        line.add(samples(stamps[first : first + batch]))
        pieces += [piece["a"].times_ns for piece in cutter.due()]
    pieces += [piece["a"].times_ns for piece in cutter.rest()]
    np.testing.assert_array_equal(np.concatenate(pieces), np.unique(stamps.astype(np.int64)))
    assert line.total.late == 0
    assert line.total.duplicates == len(stamps) - len(np.unique(stamps))


def test_a_sample_that_is_later_is_dropped_and_counted():
    line = Timeline()
    cutter = RecordSplitter({"a": line}, 1.0)
    line.add(samples(np.arange(1000, 1040) * S))
    before = list(cutter.due())
    line.add(samples([1003 * S + 1, 1040 * S, 1041 * S]))
    after = [*cutter.due(), *cutter.rest()]
    assert before
    assert line.total.late == 1
    times = np.concatenate([piece["a"].times_ns for piece in before + after])
    np.testing.assert_array_equal(times, np.arange(1000, 1042) * S)
    assert sum(piece["a"].faults.late for piece in before + after) == 1


def test_a_gap_over_a_cut_belongs_to_the_piece_after_it(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for k in [*range(0, 900), *range(1200, 3000)]:
            write_accel(writer, "/tbm/field/shield/accel", START_NS + k * 10**6, (k, 0, 0))
    first, second, _ = (piece["shield"] for piece in open_recording(tmp_path / "bag").pieces(1.0))
    assert first.gaps == []
    np.testing.assert_allclose(second.gaps, [(-0.301, 0.0)], atol=1e-9)


def test_a_clock_that_differs_delays_no_other_point(tmp_path):
    """One sensor counts from 1970, one stops early: pieces go on, and all samples come out."""
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(0, 300_000, 20):
            log = START_NS + k * 10**6
            write_accel(writer, "/tbm/field/shield/accel", log, (k, 0, 0))
            write_accel(writer, "/tbm/field/girder/accel", k * 10**6 + 5, (k, 0, 0), log_ns=log)
            if k < 40_000:
                write_accel(writer, "/tbm/field/gripper/accel", log, (k, 0, 0))
    pieces = list(open_recording(tmp_path / "bag").pieces(20.0))
    assert len(pieces) >= 15
    assert {point: sum(len(r.time) for r in records) for point, records in together(pieces).items()} == {
        "shield": 15_000,
        "girder": 15_000,
        "gripper": 2_000,
    }
    for records in together(pieces).values():
        assert all(len(r.time) <= (20.0 + LATENESS_NS / S) * 50 + 50 * 200 for r in records)


def test_topics_one_behind_the_other_are_all_read(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for point in ("shield", "girder"):
            for k in range(0, 200_000, 50):
                write_accel(writer, f"/tbm/field/{point}/accel", START_NS + k * 10**6, (k, 0, 0))
            writer.flush()
    for records in together(open_recording(tmp_path / "bag").pieces(10.0)).values():
        np.testing.assert_array_equal(
            np.concatenate([r.start_ns + np.rint(r.time * S).astype(np.int64) for r in records]),
            START_NS + np.arange(0, 200_000, 50) * 10**6,
        )


def test_memory_is_that_of_a_piece(tmp_path):
    """Five times the length, the same memory."""
    peaks = []
    for number, minutes in enumerate((8, 40)):
        path = tmp_path / str(number)
        with BagWriter(path, "zstd") as writer:
            writer.write_operating_point(START_NS, OperatingPoint(1, 1, 1))
            offsets, values = np.arange(2000) / 1000, np.random.default_rng(0).normal(size=(2000, 3))
            for k in range(minutes * 30):
                writer.write_block("/tbm/field/shield/block", START_NS + k * 2 * S, ACCELERATION, offsets, values)
        tracemalloc.start()
        read = sum(len(piece["shield"].time) for piece in open_recording(path).pieces(10.0))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert read == minutes * 60_000
    assert peaks[1] < 1.3 * peaks[0]


def test_whole_recording_in_small_pieces_counts_each_sample_once(folder):
    pieces = together(open_recording(folder).pieces(0.1))
    assert sum(len(r.time) for r in pieces["cutterhead"]) == BLOCKS * SAMPLES
    assert all(r.rate_hz == pytest.approx(RATE) for r in pieces["cutterhead"])
