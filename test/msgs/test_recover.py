"""`bag recover` and `bag info --scan`: a clean recording from a damaged one, and what is wrong with it."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bag_files import rewrite
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from sample_bag import BLOCKS, START_NS

from tbm_gsa.app.cli.bag.info import info
from tbm_gsa.app.cli.bag.recover import recover as recover_command
from tbm_msgs_py import Bag, RecordingError, read_recording
from tbm_msgs_py.bags.definitions import typestore
from tbm_msgs_py.bags.qos import offered_qos
from tbm_msgs_py.bags.recovery import recover

MESSAGES = BLOCKS * 6 + 1

RECORDER = """
import os, signal, sys
from sample_bag import fill
from tbm_msgs_py import BagWriter
writer = BagWriter(sys.argv[1])
writer.open()
for k in range(40):
    fill(writer, [k])
    if k == 29:
        writer.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


def command(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "tbm_gsa.app.cli.main", "bag", *map(str, arguments)],
        check=False,
        capture_output=True,
        text=True,
    )


def information(capsys, path, *, scan=False, json_wanted=True):
    info(path, scan=scan, mapping=None, json=json_wanted)
    text = capsys.readouterr().out
    return json.loads(text) if json_wanted else text


def cut(folder, path):
    data = (folder / "field.mcap").read_bytes()
    path.write_bytes(data[: int(len(data) * 0.6)])
    return path


def test_truncated_file_is_recovered_and_read_by_others(tmp_path, folder):
    broken, clean = cut(folder, tmp_path / "broken.mcap"), tmp_path / "clean.mcap"
    done = command("recover", broken, "--out", clean, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    document = json.loads(done.stdout)
    before = list(Bag(broken).messages())
    assert document == {
        "path": str(broken),
        "out": str(clean),
        "recovered": len(before),
        "lost": Bag(broken).info().lost,
        "damaged": 0,
        "truncated": True,
        "left_out": {},
        "encodings": {},
        "notes": [],
    }
    after = Bag(clean).info()
    assert (after.messages, after.lost, after.truncated, after.damaged) == (len(before), 0, False, 0)
    assert [m.data for m in Bag(clean).messages()] == [m.data for m in before]
    assert {t.name: offered_qos(t.qos) for t in after.topics} == {
        t.name: offered_qos(t.qos) for t in Bag(broken).info().topics
    }
    with AnyReader([clean], default_typestore=typestore()) as reader:
        assert [bytes(data) for _, _, data in reader.messages()] == [m.data for m in before]
    with clean.open("rb") as file:
        assert [m.data for _, _, m in make_reader(file).iter_messages()] == [m.data for m in before]


def test_recovering_is_told_in_words(tmp_path, folder, capsys):
    broken, clean = cut(folder, tmp_path / "broken.mcap"), tmp_path / "clean.mcap"
    recover_command(broken, clean, json=False)
    count, lost = len(list(Bag(broken).messages())), Bag(broken).info().lost
    told = f"{clean}: {count} messages recovered, {lost} lost or more, cut off before its end"
    assert " ".join(capsys.readouterr().out.split()) == told


def test_what_cannot_be_recovered_is_one_line_and_leaves_nothing(tmp_path):
    nothing = tmp_path / "nothing.mcap"
    nothing.write_bytes(b"\x89MCAP0\r\n" + bytes(500))
    done = command("recover", nothing, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert str(nothing) in done.stderr
    with pytest.raises(RecordingError, match="no such file"):
        recover(tmp_path / "none.mcap", tmp_path / "out")
    assert sorted(tmp_path.iterdir()) == [nothing]


def test_existing_output_is_not_overwritten(tmp_path, folder):
    with pytest.raises(RecordingError, match="exists already"):
        recover(cut(folder, tmp_path / "broken.mcap"), folder)


def test_killed_recorder_is_recovered_up_to_the_last_flush(tmp_path):
    bag = tmp_path / "bag"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    done = subprocess.run([sys.executable, "-c", RECORDER, str(bag)], check=False, env=environment)
    assert done.returncode == -signal.SIGKILL
    found = recover(bag, tmp_path / "clean")
    assert found.recovered >= 30 * 7  # an operating point, a block and five samples a turn
    assert found.truncated
    recording = read_recording(tmp_path / "clean")
    assert len(recording.points["cutterhead"].time) >= 30 * 100
    assert not recording.truncated


def test_types_that_are_not_known_keep_their_definition(tmp_path):
    types = {
        "example/msg/Own": (
            "ros2msg",
            "int64 a\nexample/msg/Part p\n" + "=" * 80 + "\nMSG: example/msg/Part\nint8 b\n",
        ),
        "example/srv/Add_Event": ("ros2msg", "service_msgs/msg/ServiceEventInfo info\n"),
        "example/msg/Idl": (
            "ros2idl",
            "=" * 80 + "\nIDL: example/msg/Idl\nmodule example { module msg { struct Idl { long a; }; }; };\n",
        ),
        "geometry_msgs/msg/Vector3": ("ros2msg", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"),  # of another version
    }
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros2", "test")
        for k, (name, (encoding, text)) in enumerate(types.items()):
            schema = writer.register_schema(name, encoding, text.encode())
            channel = writer.register_channel(f"/topic{k}", "cdr", schema)
            writer.add_message(channel, START_NS + k, bytes([0, 1, 0, 0, k]), START_NS + k)
        json_channel = writer.register_channel("/json", "json", writer.register_schema("J", "jsonschema", b"{}"))
        writer.add_message(json_channel, START_NS, b"{}", START_NS)
        writer.finish()
    found = recover(tmp_path / "a.mcap", tmp_path / "out")
    assert (found.recovered, found.lost, found.left_out) == (4, 1, {"/json": 1})
    assert found.encodings == {"/json": "json"}
    (path,) = (tmp_path / "out").glob("*.mcap")
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert {s.name: (s.encoding, s.data.decode()) for s in summary.schemas.values()} == types
    with Reader(tmp_path / "out") as reader:
        assert reader.message_count == 4


def test_info_scans_for_damage_and_faults(tmp_path, folder, capsys):
    path = rewrite(folder, tmp_path / "field.mcap", CompressionType.NONE)
    data = bytearray(path.read_bytes())
    with path.open("rb") as file:
        index = make_reader(file).get_summary().chunk_indexes[2]
    data[index.chunk_start_offset + 500] ^= 1
    path.write_bytes(data)
    quick = information(capsys, path)
    assert (quick["messages"], quick["damaged"]) == (MESSAGES, 0)  # as the index says
    deep = information(capsys, path, scan=True)
    assert deep["damaged"] == 1
    assert deep["messages"] + deep["lost"] == MESSAGES
    cutterhead = deep["points"]["cutterhead"]
    assert (cutterhead["gaps"], cutterhead["rate_hz"]) == (1, pytest.approx(2000.0))
    assert cutterhead["missing_s"] == pytest.approx((4000 - cutterhead["samples"]) / 2000, abs=0.001)
    assert set(deep["points"]["shield"]["stuck_s"]) == {"x", "y"}
    table = information(capsys, path, scan=True, json_wanted=False)
    assert "damaged" in table
    assert "cutterhead" in table


def test_info_of_a_recording_without_sensors_says_so(tmp_path, capsys):
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros2", "test")
        schema = writer.register_schema("std_msgs/msg/Empty", "ros2msg", b"")
        writer.add_message(writer.register_channel("/a", "cdr", schema), 1, b"", 1)
        writer.finish()
    document = information(capsys, tmp_path / "a.mcap", scan=True)
    assert (document["messages"], document["points"]) == (1, {})
    assert "no topic" in document["problems"][""]
    assert np.isfinite(document["duration"])
