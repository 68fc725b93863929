"""What a recording says of itself: read by rosbags too, and from nothing but the metadata."""

import shutil
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tbm_msgs_py.bags.metadata import SYNTHETIC, is_synthetic
from tbm_msgs_py.bags.recovery import recover
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.base.operating_point import OperatingPoint

SHIPPED = Path(__file__).parents[2] / "bags" / "field_dz101"


def written(path, custom_data=None):
    with BagWriter(path, custom_data=custom_data) as writer:
        writer.write_operating_point(1_700_000_000_000_000_000, OperatingPoint(0.5, 3e6, 1e7))
    return path


def test_the_shipped_recording_says_that_it_is_synthetic(tmp_path):
    assert is_synthetic(SHIPPED)
    assert is_synthetic(SHIPPED / "field_dz101.mcap")
    shutil.copy(SHIPPED / "field_dz101.mcap", tmp_path)
    assert not is_synthetic(tmp_path / "field_dz101.mcap")  # by itself it has no place for the mark


def test_rosbags_writes_the_mark_and_reads_a_marked_recording(tmp_path):
    with Writer(tmp_path / "made", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.set_custom_data("synthetic", "true")
        topic = writer.add_connection("/any", "std_msgs/msg/Empty", typestore=get_typestore(Stores.ROS2_JAZZY))
        writer.write(topic, 1, b"\0\1\0\0\0")
    assert is_synthetic(tmp_path / "made")
    with Reader(SHIPPED) as reader:
        assert reader.message_count == 1485


def test_a_recording_says_it_in_its_metadata_only(tmp_path):
    measured = written(tmp_path / "measured")
    (measured / "README.md").write_text("A synthetic recording.\n")
    assert not is_synthetic(measured)
    assert is_synthetic(written(tmp_path / "made", SYNTHETIC))
    shutil.copy(measured / "measured.mcap", tmp_path / "made" / "other.mcap")
    assert not is_synthetic(tmp_path / "made" / "other.mcap")  # beside it, not of it
    assert not is_synthetic(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("given", "synthetic"),
    [
        ("{synthetic: 'true'}", True),
        ("{synthetic: true}", True),
        ("{synthetic: 'True'}", True),
        ("{synthetic: 'false'}", False),
        ("{recorder: tbm_monitor}", False),
        ("null", False),
        ("[synthetic]", False),
        ("synthetic", False),
        ("{[a]: {", False),
    ],
)
def test_what_others_wrote_into_the_custom_data(tmp_path, given, synthetic):
    file = written(tmp_path / "bag") / "metadata.yaml"
    text = file.read_text(encoding="utf-8")
    assert "  custom_data: null\n" in text
    file.write_text(text.replace("custom_data: null", f"custom_data: {given}"), encoding="utf-8")
    assert is_synthetic(tmp_path / "bag") is synthetic


def test_a_recovered_recording_is_as_synthetic_as_before(tmp_path):
    recover(written(tmp_path / "made", SYNTHETIC), tmp_path / "clean")
    assert is_synthetic(tmp_path / "clean")
    recover(written(tmp_path / "measured", {"recorder": "tbm_monitor"}), tmp_path / "other")
    assert not is_synthetic(tmp_path / "other")
