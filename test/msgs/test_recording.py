"""Recordings: what was written is read back by us and by other tools; damage costs what it must and no more."""

import numpy as np
import pytest
from bag_files import rewrite, write_accel
from mcap.reader import make_reader
from mcap.writer import CompressionType
from rosbags.highlevel import AnyReader
from sample_bag import BLOCKS, RATE, SAMPLES, START_NS, fill, signal

from tbm_msgs_py import (
    ACCELERATION,
    Bag,
    BagWriter,
    OperatingPoint,
    RecordingError,
    read_acceleration,
    read_recording,
)
from tbm_msgs_py.bags.definitions import typestore
from tbm_msgs_py.bags.mcap_file import MAGIC
from tbm_msgs_py.bags.qos import offered_qos
from tbm_msgs_py.recordings.faults import find_gaps
from tbm_msgs_py.topics import BLOCK_QOS, OPERATING_POINT_QOS

BLOCK_TOPIC = "/tbm/field/cutterhead/block"
MESSAGES = BLOCKS * 6 + 1


def test_acceleration_is_what_was_written(folder):
    record = read_acceleration(folder, topic=BLOCK_TOPIC)
    assert record.start_ns == START_NS
    np.testing.assert_allclose(record.time, np.arange(BLOCKS * SAMPLES) / RATE, atol=1e-12)
    np.testing.assert_allclose(record.values, signal(0, BLOCKS * SAMPLES), atol=1e-7)
    assert record.gaps == []
    assert record.rate_hz == pytest.approx(RATE)


def test_path_may_be_text(bare):
    assert len(read_acceleration(str(bare), topic=BLOCK_TOPIC).time) == BLOCKS * SAMPLES


def test_recording_has_points_and_operating_point(folder):
    recording = read_recording(folder)
    assert set(recording.points) == {"cutterhead", "shield"}
    assert (recording.messages, recording.lost, recording.truncated) == (MESSAGES, 0, False)
    assert recording.operating_point.points == (OperatingPoint(0.586, 3.04e6, 1.2e7),)
    assert len(recording.sha256) == 64
    shield = recording.points["shield"]
    assert shield.rate_hz == pytest.approx(100.0)
    np.testing.assert_array_equal(shield.values[:, 2], np.arange(5 * BLOCKS))


def test_rosbags_reads_what_we_write(folder):
    with AnyReader([folder], default_typestore=typestore()) as reader:
        assert reader.message_count == MESSAGES
        block = next(reader.deserialize(d, c.msgtype) for c, _, d in reader.messages() if c.topic == BLOCK_TOPIC)
    assert (block.width, block.point_step) == (SAMPLES, 20)


def test_mcap_ros2_reads_what_we_write(bare):
    from mcap_ros2.decoder import DecoderFactory

    with bare.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = [message for _, channel, _, message in reader.iter_decoded_messages([BLOCK_TOPIC])]
    assert len(decoded) == BLOCKS
    assert [field.name for field in decoded[0].fields] == ["t", "ax", "ay", "az"]


def test_offered_qos_survives(folder):
    qualities = {topic.name: offered_qos(topic.qos) for topic in Bag(folder).info().topics}
    assert qualities[BLOCK_TOPIC] == BLOCK_QOS
    assert qualities["/tbm/operating_point"] == OPERATING_POINT_QOS


def test_messages_come_in_log_time_order(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for chunk in ((3, 1, 2), (6, 2, 4), (5, 9, 8)):
            for k in chunk:
                write_accel(writer, "/a", START_NS + k, (0, 0, k))
            writer.flush()
    first_two = [m.log_ns - START_NS for m in Bag(tmp_path / "bag").messages()]
    assert first_two == sorted(first_two)
    late = [m.log_ns - START_NS for m in Bag(tmp_path / "bag").messages(start_ns=START_NS + 5)]
    assert late == [5, 6, 8, 9]


@pytest.mark.parametrize("chunks", [True, False])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_files_of_other_writers_are_read(tmp_path, compression, chunks, folder):
    recording = read_recording(rewrite(folder, tmp_path / "other.mcap", compression, use_chunking=chunks))
    assert recording.messages == MESSAGES
    assert len(recording.points["cutterhead"].time) == BLOCKS * SAMPLES


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("kind", ["folder", "bare"])
def test_cut_file_gives_everything_before_the_cut(tmp_path, share, kind, request):
    source = request.getfixturevalue(kind)
    data = (source / "field.mcap" if source.is_dir() else source).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(share * len(data))])
    recording = read_recording(cut)
    whole = read_acceleration(source, BLOCK_TOPIC)
    part = recording.points["cutterhead"]
    assert recording.truncated
    assert len(part.time) >= share * 0.8 * len(whole.time) - SAMPLES
    np.testing.assert_array_equal(part.values, whole.values[: len(part.values)])


def test_declared_count_that_is_not_reached_is_lost(tmp_path, folder):
    copy = tmp_path / "field"
    copy.mkdir()
    (copy / "metadata.yaml").write_bytes((folder / "metadata.yaml").read_bytes())
    data = (folder / "field.mcap").read_bytes()
    (copy / "field.mcap").write_bytes(data[: len(data) // 2])
    recording = read_recording(copy)
    assert recording.truncated
    assert recording.messages + recording.lost == MESSAGES
    assert Bag(copy).info().lost == recording.lost


def several_files(path):
    """A recording in several files, each of some blocks."""
    with BagWriter(path, max_bytes=20_000) as writer:
        fill(writer)
    return path


def test_what_was_not_read_yet_is_not_lost(tmp_path):
    bag = Bag(several_files(tmp_path / "bag"))
    assert len(bag.files) > 2
    for _ in range(2):  # a reading that stops early, after none and after one that went to the end
        messages = bag.messages()
        next(messages)
        assert bag.lost == 0
        messages.close()
        assert len(list(bag.messages())) > 0
        assert bag.lost == 0


@pytest.mark.parametrize(("damaged", "met"), [(0, True), (-1, False)])
def test_a_reading_that_stops_early_counts_the_losses_it_met(tmp_path, damaged, met):
    bag = Bag(several_files(tmp_path / "bag"))
    file = bag.files[damaged].path
    data = bytearray(file.read_bytes())
    with file.open("rb") as stream:
        chunk = make_reader(stream).get_summary().chunk_indexes[0]
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 255
    file.write_bytes(data)
    assert len(list(bag.messages())) > 0
    lost = bag.lost
    assert lost > 0
    next(bag.messages())
    assert bag.lost == (lost if met else 0)


def test_killed_recorder_leaves_a_readable_folder(tmp_path):
    writer = BagWriter(tmp_path / "bag")
    writer.open()
    fill(writer)
    writer.flush()
    recording = read_recording(tmp_path / "bag")
    assert (recording.messages, recording.truncated) == (MESSAGES, True)
    writer.close()
    assert not read_recording(tmp_path / "bag").truncated


@pytest.mark.parametrize("compression", list(CompressionType))
def test_damaged_chunk_is_counted_and_the_rest_is_read(tmp_path, compression, folder):
    path = rewrite(folder, tmp_path / "field.mcap", compression)
    data = bytearray(path.read_bytes())
    with path.open("rb") as file:
        chunk = make_reader(file).get_summary().chunk_indexes[2]
    middle = chunk.chunk_start_offset + chunk.chunk_length // 2
    data[middle : middle + 20] = bytes(255 - byte for byte in data[middle : middle + 20])
    path.write_bytes(data)
    recording = read_recording(path)
    assert not recording.truncated
    assert 0 < recording.lost < MESSAGES // 4
    assert recording.messages + recording.lost == MESSAGES


def test_file_that_grows_while_it_is_read(tmp_path, folder):
    complete = tmp_path / "complete.mcap"
    rewrite(folder, complete, CompressionType.NONE)
    whole = complete.read_bytes()
    growing = tmp_path / "growing.mcap"
    growing.write_bytes(whole[: len(whole) // 2])
    messages = (message for batch in Bag(growing).batches() for chunk in batch.chunks() for message in chunk.raw())
    first = next(messages)
    growing.write_bytes(whole)  # what a recorder does meanwhile
    assert [first, *messages] == list(Bag(complete).messages())


def test_failed_writing_leaves_nothing(tmp_path):
    for name in ("bag", "bare.mcap"):
        with pytest.raises(KeyError), BagWriter(tmp_path / name) as writer:
            fill(writer, [0])
            raise KeyError
    assert list(tmp_path.iterdir()) == []


def test_existing_recording_is_not_overwritten(folder):
    with pytest.raises(RecordingError, match="exists already"):
        BagWriter(folder)


def test_gaps_duplicates_and_bad_values(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        fill(writer, [0, 1, 1, 4, 3])
        bad = np.full((SAMPLES, 3), np.nan)
        offsets = np.arange(SAMPLES) / RATE
        writer.write_block(BLOCK_TOPIC, START_NS + 5 * SAMPLES * 10**9 // RATE, ACCELERATION, offsets, bad)
    record = read_acceleration(tmp_path / "bag", BLOCK_TOPIC)
    assert (record.faults.duplicates, record.faults.invalid) == (SAMPLES, SAMPLES)
    period, block = 1 / RATE, SAMPLES / RATE
    np.testing.assert_allclose(record.gaps, [(2 * block - period, 3 * block)], atol=1e-9)
    assert record.rate_hz == pytest.approx(RATE)


def test_rate_follows_a_slow_clock():
    time = np.arange(1000) * (1 + 1e-4) / 1000
    assert find_gaps(np.delete(time, slice(400, 410)))[1] == pytest.approx(1000 / (1 + 1e-4), rel=1e-9)
    assert find_gaps(time[:1]) == ([], 0.0)


def refusal(call):
    with pytest.raises(RecordingError) as caught:
        call()
    assert "\n" not in str(caught.value)
    assert "allowed: " in str(caught.value)
    return str(caught.value)


def test_missing_empty_and_foreign_files_are_one_line(tmp_path):
    assert "no such file" in refusal(lambda: read_recording(tmp_path / "none.mcap"))
    (tmp_path / "empty.mcap").touch()
    assert "empty" in refusal(lambda: read_recording(tmp_path / "empty.mcap"))
    (tmp_path / "text.mcap").write_text("hello, this is no recording")
    assert "not an MCAP file" in refusal(lambda: read_recording(tmp_path / "text.mcap"))
    (tmp_path / "head.mcap").write_bytes(MAGIC)
    assert "no message" in refusal(lambda: read_recording(tmp_path / "head.mcap"))
    (tmp_path / "folder").mkdir()
    assert "no recording in this folder" in refusal(lambda: read_recording(tmp_path / "folder"))
    (tmp_path / "folder" / "metadata.yaml").write_text("a: [")
    assert "metadata" in refusal(lambda: read_recording(tmp_path / "folder"))


def test_another_storage_is_named(tmp_path):
    (tmp_path / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: {version: 5, storage_identifier: rosdb, relative_file_paths: [a.rdb]}"
    )
    assert "'rosdb', allowed: mcap, sqlite3" in refusal(lambda: read_recording(tmp_path))


def test_wrong_topic_lists_what_is_there(folder):
    message = refusal(lambda: read_acceleration(folder, topic="/nowhere"))
    assert "/nowhere" in message
    assert BLOCK_TOPIC in message
    message = refusal(lambda: read_acceleration(folder, topic="/tbm/operating_point"))
    assert "JointState" in message


def test_recording_without_mapped_topic_lists_what_is_there(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        write_accel(writer, "/imu", START_NS, (0, 0, 0))
    assert "/imu" in refusal(lambda: read_recording(tmp_path / "bag"))


def test_samples_without_stamps_are_refused(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        write_accel(writer, "/tbm/field/shield/accel", 0, (0, 0, 0), log_ns=START_NS)
    assert "stamp" in refusal(lambda: read_recording(tmp_path / "bag"))
