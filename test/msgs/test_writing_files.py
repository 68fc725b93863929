"""Recordings of several files, under a quota, on a disk that fills: true metadata, nothing flushed is lost."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from tbm_msgs_py import ACCELERATION, Bag, BagWriter, OperatingPoint, RecordingError, read_recording
from tbm_msgs_py.bags import quota
from tbm_msgs_py.bags.definitions import typestore
from tbm_msgs_py.bags.folder import lock
from tbm_msgs_py.bags.quota import KEEP, enforce, mark, stored

START_NS = 1_767_225_600_000_000_000
TOPIC = "/tbm/field/cutterhead/block"
PERIOD = 50_000_000  # ns
LIMITED = mark(50.0)
POINT = OperatingPoint(0.586, 3.04e6, 1.2e7)


def write_block(writer, k):
    values = np.full((250, 3), float(k))
    writer.write_block(TOPIC, START_NS + k * PERIOD, ACCELERATION, np.arange(250) / 5000, values)


def fill(writer, blocks):
    for k in blocks:
        write_block(writer, k)


def information(folder):
    return yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def split(path, blocks, **options):
    with BagWriter(path, **options) as writer:
        writer.write_operating_point(START_NS, POINT)
        fill(writer, blocks)
    return path


@pytest.mark.parametrize("options", [{"max_seconds": 0.5}, {"max_bytes": 50_000}])
def test_split_recording_is_read_as_one(tmp_path, options):
    path = split(tmp_path / "bag", range(40), **options)
    described = information(path)
    names = [f"bag_{k}.mcap" for k in range(4)]
    assert described["relative_file_paths"] == [file["path"] for file in described["files"]] == names
    assert sorted(file.name for file in path.iterdir()) == [*names, "metadata.yaml"]
    assert [file["message_count"] for file in described["files"]] == [11] * 4  # 10 blocks and the operating point
    with AnyReader([path], default_typestore=typestore()) as reader:
        found = [(c.topic, log, reader.deserialize(data, c.msgtype)) for c, log, data in reader.messages()]
        assert reader.message_count == len(found) == described["message_count"] == 44
    stamps = [log for topic, log, _ in found if topic == TOPIC]
    assert stamps == [START_NS + k * PERIOD for k in range(40)]
    assert [m.topic.name for m in Bag(path).messages([TOPIC])] == [TOPIC] * 40
    assert described["duration"]["nanoseconds"] == 39 * PERIOD
    counts = {t["topic_metadata"]["name"]: t["message_count"] for t in described["topics_with_message_count"]}
    assert counts == {"/tbm/operating_point": 4, TOPIC: 40}


def test_each_file_of_a_split_recording_stands_alone(tmp_path):
    path = split(tmp_path / "bag", range(30), max_seconds=0.5)
    for k in range(3):
        recording = read_recording(path / f"bag_{k}.mcap")
        assert recording.operating_point.points == (POINT,)
        assert recording.points["cutterhead"].values[0, 0] == 10 * k


def test_one_message_larger_than_a_file_may_be_is_written(tmp_path):
    path = split(tmp_path / "bag", range(3), max_bytes=10)
    assert Bag(path).info().messages == 4 + 3  # the operating point before each block


def test_bare_file_cannot_be_split(tmp_path):
    with pytest.raises(RecordingError, match="allowed: a new folder"):
        BagWriter(tmp_path / "bag.mcap", max_seconds=1.0)


def test_unclosed_recording_has_its_topics_and_messages(tmp_path):
    writer = BagWriter(tmp_path / "bag", max_seconds=0.5)
    writer.open()
    fill(writer, range(15))
    writer.flush()
    write_block(writer, 15)  # not flushed
    info = Bag(tmp_path / "bag").info()
    assert (info.messages, info.truncated) == (15, True)
    (topic,) = information(tmp_path / "bag")["topics_with_message_count"]
    assert topic["topic_metadata"]["type"] == "sensor_msgs/msg/PointCloud2"
    writer.close()
    assert Bag(tmp_path / "bag").info().messages == 16


def recorded(folder, name, blocks, age):
    """A finished marked recording in files of 10 blocks, last changed `age` s ago and 10 s from file to file."""
    path = split(folder / name, blocks, max_seconds=0.5, custom_data=LIMITED)
    files = sorted(path.glob("*.mcap"))
    for place, file in enumerate(files):
        changed = 1_700_000_000 - age + 10 * place
        os.utime(file, (changed, changed))
    return path, [file.stat().st_size for file in files]


def test_quota_deletes_the_oldest_files_first(tmp_path):
    old, old_sizes = recorded(tmp_path, "old", range(20), 1000)
    new, new_sizes = recorded(tmp_path, "new", range(30), 500)
    writer = BagWriter(tmp_path / "now", max_seconds=0.5, custom_data=LIMITED)
    writer.open()
    fill(writer, range(5))
    writer.flush()
    total = sum(file.size for file in stored(tmp_path))
    assert total == sum(old_sizes) + sum(new_sizes) + writer.current.stat().st_size
    assert enforce(total, writer) == ([], 0)
    gone, over = enforce(total - sum(old_sizes) - 1, writer)
    assert over == 1 - new_sizes[0]
    assert [file.path.name for file in gone] == ["old_0.mcap", "old_1.mcap", "new_0.mcap"]
    assert not old.exists()  # with its last file
    described = information(new)
    assert described["relative_file_paths"] == ["new_1.mcap", "new_2.mcap"]
    with Reader(new) as reader:
        assert reader.message_count == described["message_count"] == 22
        assert sum(1 for _ in reader.messages()) == 22
        assert reader.start_time == START_NS + 10 * PERIOD
    counts = {t["topic_metadata"]["name"]: t["message_count"] for t in described["topics_with_message_count"]}
    assert counts == {"/tbm/operating_point": 2, TOPIC: 20}
    assert read_recording(new).lost == 0
    writer.close()


def test_quota_never_deletes_what_is_being_written(tmp_path):
    other = BagWriter(tmp_path / "other", custom_data=LIMITED)
    other.open()  # another recorder in the same folder
    writer = BagWriter(tmp_path / "now", max_seconds=0.5, custom_data=LIMITED)
    writer.open()
    fill(writer, range(35))
    writer.flush()
    gone, over = enforce(0, writer)
    assert over == writer.current.stat().st_size + other.current.stat().st_size
    assert [file.path.name for file in gone] == ["now_0.mcap", "now_1.mcap", "now_2.mcap"]
    assert other.current.exists()
    fill(writer, range(35, 45))
    writer.close()
    assert information(tmp_path / "now")["relative_file_paths"] == ["now_3.mcap", "now_4.mcap"]
    assert [m.log_ns for m in Bag(tmp_path / "now").messages()] == [START_NS + k * PERIOD for k in range(30, 45)]
    other.close()


@pytest.mark.parametrize(
    "custom_data",
    [None, mark(0.0), {"quota": "50"}, {"recorder": "another", "quota": "50"}],
)
def test_quota_is_for_what_was_recorded_under_one(tmp_path, custom_data):
    """What was recorded without it, imported or made by another program neither counts nor goes."""
    reference = split(tmp_path / "reference", range(20), custom_data=custom_data)
    with BagWriter(tmp_path / "now", custom_data=LIMITED) as writer:
        assert enforce(0, writer) == ([], writer.current.stat().st_size)
    assert Bag(reference).info().messages == 21


def test_words_like_the_mark_are_none(tmp_path):
    note = {"note": "recorder: tbm_monitor under quota: 50"}
    reference = split(tmp_path / "reference", range(20), custom_data=note)
    with BagWriter(tmp_path / "now", custom_data=LIMITED) as writer:
        assert enforce(0, writer)[0] == []
    assert Bag(reference).info().messages == 21


def test_quota_leaves_what_is_marked_to_be_kept(tmp_path):
    old, _ = recorded(tmp_path, "old", range(20), 1000)
    kept, _ = recorded(tmp_path, "kept", range(20), 2000)
    (kept / KEEP).touch()
    writer = BagWriter(tmp_path / "now", max_seconds=0.5, custom_data=LIMITED)
    writer.open()
    fill(writer, range(25))
    writer.flush()
    (writer.path / KEEP).touch()
    gone, over = enforce(0, writer)  # neither counts
    assert ([file.path.name for file in gone], over) == (["old_0.mcap", "old_1.mcap"], 0)
    assert not old.exists()
    (writer.path / KEEP).unlink()
    gone, over = enforce(0, writer)
    assert [file.path.name for file in gone] == ["now_0.mcap", "now_1.mcap"]
    assert over == writer.current.stat().st_size
    writer.close()
    assert Bag(kept).info().messages == 22


def test_what_is_marked_at_the_last_moment_is_kept(tmp_path, monkeypatch):
    old, _ = recorded(tmp_path, "old", range(20), 1000)

    def listed(folder):
        found = stored(folder)
        (old / KEEP).touch()
        return found

    monkeypatch.setattr(quota, "stored", listed)
    with BagWriter(tmp_path / "now", custom_data=LIMITED) as writer:
        assert enforce(0, writer)[0] == []
    assert Bag(old).info().messages == 22


def test_quota_deletes_no_file_that_a_recording_does_not_name(tmp_path):
    old, _ = recorded(tmp_path, "old", range(20), 1000)
    elsewhere = split(tmp_path / "archive" / "linked", range(10), custom_data=LIMITED)
    (tmp_path / "linked").symlink_to(elsewhere)
    (old / "link.mcap").symlink_to(elsewhere / "linked.mcap")
    with BagWriter(tmp_path / "now", max_seconds=0.5, custom_data=LIMITED) as writer:
        for folder in (old, writer.path):
            (folder / "copy.mcap").write_bytes((elsewhere / "linked.mcap").read_bytes())
        gone, _ = enforce(0, writer)
    assert [file.path.name for file in gone] == ["old_0.mcap", "old_1.mcap"]
    assert sorted(file.name for file in old.iterdir()) == ["copy.mcap", "link.mcap"]
    assert (tmp_path / "now" / "copy.mcap").exists()
    assert Bag(elsewhere).info().messages == 11


def test_quota_leaves_a_recording_whose_metadata_was_spoilt(tmp_path):
    spoilt, _ = recorded(tmp_path, "old", range(20), 1000)
    file = spoilt / "metadata.yaml"
    content = yaml.safe_load(file.read_text())
    del content["rosbag2_bagfile_information"]["files"]
    file.write_text(yaml.safe_dump(content))
    with BagWriter(tmp_path / "now", custom_data=LIMITED) as writer:
        gone, over = enforce(0, writer)
    assert gone == []
    assert over > 0
    assert len(list(spoilt.glob("*.mcap"))) == 2


def test_lock_goes_with_the_recording(tmp_path):
    writer = BagWriter(tmp_path / "bag")
    writer.open()
    assert lock(tmp_path / "bag") is None
    writer.close()
    descriptor = lock(tmp_path / "bag")
    assert descriptor is not None
    os.close(descriptor)


FILL = """
import resource, signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_writing_files import BagWriter, RecordingError, fill, information
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
writer = BagWriter(Path({path!r}), {compression!r}, **{options!r})
writer.open()
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
try:
    for k in range(1000):
        fill(writer, [k])
        if k % 10 == 9:
            writer.flush()
            print(k + 1)
    writer.close()
except RecordingError as error:
    writer.salvage()
    print(error)
"""


@pytest.mark.parametrize("compression", ["none", "zstd"])
@pytest.mark.parametrize("options", [{}, {"max_seconds": 5.0}])
def test_full_disk_costs_only_what_was_not_flushed(tmp_path, request, compression, options):
    """The limit on the size of a file refuses a write as a full disk does, in the middle of it."""
    path, tests = tmp_path / "bag", str(request.path.parent)
    limit = 20_000 if compression == "zstd" else 300_000
    script = FILL.format(tests=tests, path=str(path), compression=compression, options=options, limit=limit)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    *flushed, error = done.stdout.splitlines()
    assert "File too large" in error
    assert "bag" in error
    kept = int(flushed[-1])
    assert kept > 0
    assert kept < 1000
    info = Bag(path).info()
    assert info.messages == kept
    assert information(path)["message_count"] == kept
    assert [m.log_ns for m in Bag(path).messages()] == [START_NS + k * PERIOD for k in range(kept)]


def test_killed_in_the_middle_of_splitting_is_read(tmp_path, request):
    path, tests = tmp_path / "bag", str(request.path.parent)
    script = FILL.format(tests=tests, path=str(path), compression="none", options={"max_seconds": 1.0}, limit=10**9)
    script = script.replace("    writer.close()", "    import os; os.kill(os.getpid(), signal.SIGKILL)")
    script = script.replace("range(1000)", "range(115)")
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    info = Bag(path).info()
    assert (info.messages, info.truncated) == (110, True)
