"""Messages in order of log time, whatever the layout of the files: held against the mcap library's own sorting."""

import struct
import tracemalloc

import pytest
from bag_files import write_accel
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter

from tbm_msgs_py import Bag, BagWriter, RecordingError, open_recording, read_recording
from tbm_msgs_py.bags import mcap_file, ordering
from tbm_msgs_py.bags.definitions import typestore
from tbm_msgs_py.bags.recovery import recover

STEP = 10_000_000  # ns


def written(path, entries, **options):
    """File of (topic, log time) in this order; the data say which entry it is."""
    with path.open("wb") as file:
        writer = McapWriter(file, **{"chunk_size": 300, "compression": CompressionType.NONE, **options})
        writer.start("ros2", "test")
        channels = {}
        for k, (topic, log_ns) in enumerate(entries):
            if topic not in channels:
                schema = writer.register_schema("std_msgs/msg/Int64", "ros2msg", b"int64 data\n")
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], log_ns, struct.pack("<4Bq", 0, 1, 0, 0, k), log_ns)
        writer.finish()
    return path


def read(path, **options):
    return [(m.log_ns, m.data) for m in Bag(path).messages(**options)]


ONE_AFTER_THE_OTHER = [("/a", k * STEP) for k in range(150)] + [("/b", k * STEP) for k in range(150)]
LAYOUTS = {
    "one topic after the other": ONE_AFTER_THE_OTHER,
    "backwards": ONE_AFTER_THE_OTHER[::-1],
    "chunks that overlap by many": [("/a", (k * 37 % 150) * STEP) for k in range(150)],
    "all at one time": [("/a", 5)] * 100 + [("/b", 5)] * 100,
}
WRITERS = {
    "chunks": {},
    "zstd": {"compression": CompressionType.ZSTD},
    "no chunks": {"use_chunking": False},
    "no index": {"index_types": IndexType.NONE},
    "no statistics": {"use_statistics": False},
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("held", [1 << 20, 3000])
def test_every_layout_is_read_in_order_of_time(tmp_path, monkeypatch, layout, held):
    monkeypatch.setattr(ordering, "HELD", held)  # the second puts runs on the disk
    entries = LAYOUTS[layout]
    expected = [(entries[k][1], k) for k in sorted(range(len(entries)), key=lambda k: entries[k][1])]
    for name, options in WRITERS.items():
        path = written(tmp_path / f"{name}.mcap", entries, **options)
        for scan in (False, True):
            found = read(path, scan=scan)
            assert [(log, struct.unpack("<4xq", data)[0]) for log, data in found] == expected
        late = [entry for entry in expected if entry[0] >= 70 * STEP]
        assert [log for log, _ in read(path, start_ns=70 * STEP)] == [log for log, _ in late]
    with (tmp_path / "chunks.mcap").open("rb") as file:
        assert [m.log_time for _, _, m in make_reader(file).iter_messages()] == [log for log, _ in expected]


@settings(max_examples=25, deadline=None)
@given(
    entries=st.lists(st.tuples(st.sampled_from(["/a", "/b", "/c"]), st.integers(0, 50)), min_size=1, max_size=60),
    size=st.integers(1, 400),
    options=st.sampled_from(sorted(WRITERS)),
    held=st.sampled_from([0, 1000, 1 << 20]),
)
def test_order_of_anything_is_that_of_the_library(tmp_path_factory, entries, size, options, held):
    path = written(tmp_path_factory.mktemp("any") / "a.mcap", entries, **{"chunk_size": size, **WRITERS[options]})
    before, ordering.HELD = ordering.HELD, held
    try:
        found = read(path)
    finally:
        ordering.HELD = before
    with path.open("rb") as file:
        expected = [m.log_time for _, _, m in make_reader(file).iter_messages()]
    assert [log for log, _ in found] == expected or options in ("no index", "no chunks")
    assert found == sorted(found, key=lambda entry: entry[0])
    places = [(log, struct.unpack("<4xq", data)[0]) for log, data in found]
    assert places == sorted((log, k) for k, (_, log) in enumerate(entries))


def test_recovery_is_in_order_at_bounded_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(ordering, "HELD", 1 << 20)
    monkeypatch.setattr(mcap_file, "WINDOW", 1 << 18)
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = McapWriter(file, chunk_size=200_000, compression=CompressionType.NONE)
        writer.start("ros2", "test")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        for name in (f"/{k}" for k in range(30)):  # as many chunks overlap at any time
            channel = writer.register_channel(name, "cdr", schema)
            for k in range(20):
                writer.add_message(channel, k * STEP, bytes([0, 1, 0, 0]) + bytes(40_000), k * STEP)
        writer.finish()
    typestore().hash_rihs01("std_msgs/msg/String")  # definitions, which stay in memory
    tracemalloc.start()
    found = recover(tmp_path / "a.mcap", tmp_path / "out")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (found.recovered, found.lost) == (600, 0)
    assert peak < 10 << 20  # of 24 MB
    times = [message.log_ns for batch in Bag(tmp_path / "out").batches() for message in batch.raw()]
    assert times == [k * STEP for k in range(20) for _ in range(30)]
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.mcap", "out"]


def test_files_whose_times_go_backwards_are_one_recording(tmp_path):
    """Metadata name the files in the wrong order; samples over 10 s late would be dropped."""
    with BagWriter(tmp_path / "bag", max_seconds=20.0) as writer:
        for k in range(900):
            write_accel(writer, "/tbm/field/shield/accel", k * 10**8 + 10**18, (k, 0.0, 0.0))
    described = tmp_path / "bag" / "metadata.yaml"
    names = [f"bag_{k}.mcap" for k in range(5)]
    lines = described.read_text().splitlines()
    places = [lines.index(f"  - {name}") for name in names]
    for place, name in zip(places, names[::-1], strict=True):
        lines[place] = f"  - {name}"
    described.write_text("\n".join(lines))
    assert [m.log_ns for m in Bag(tmp_path / "bag").messages()] == [k * 10**8 + 10**18 for k in range(900)]
    record = read_recording(tmp_path / "bag")
    assert (record.lost, record.messages, record.points["shield"].faults.late) == (0, 900, 0)
    pieces = list(open_recording(tmp_path / "bag").pieces(30.0))
    assert [len(piece["shield"].time) for piece in pieces] == [300, 300, 300]


def test_wrong_times_in_the_index_cost_no_message(tmp_path):
    entries = [("/a", k * STEP) for k in range(100)]
    data = written(tmp_path / "a.mcap", entries).read_bytes()
    with (tmp_path / "a.mcap").open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    index = chunks[3]
    stated = struct.pack("<QQQ", index.message_start_time, index.message_end_time, index.chunk_start_offset)
    wrong = struct.pack("<QQQ", 90 * STEP, 99 * STEP, index.chunk_start_offset)
    assert data.count(stated) == 1
    (tmp_path / "b.mcap").write_bytes(data.replace(stated, wrong))
    by_index, by_reading = read(tmp_path / "b.mcap"), read(tmp_path / "b.mcap", scan=True)
    assert by_index != by_reading
    assert sorted(by_index) == by_reading == read(tmp_path / "a.mcap")


def test_no_room_for_runs_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(ordering, "HELD", 100)
    path = written(tmp_path / "a.mcap", ONE_AFTER_THE_OTHER)
    with pytest.raises(RecordingError, match=r"No such file.*allowed: room"):
        list(Bag(path).messages(folder=tmp_path / "none"))


def test_index_without_a_chunk_is_not_believed(tmp_path):
    """One chunk less, one that is named twice, one at another place: the file is read through instead."""
    path = written(tmp_path / "a.mcap", ONE_AFTER_THE_OTHER)
    data, expected = path.read_bytes(), read(path)
    with path.open("rb") as file:
        first, second = make_reader(file).get_summary().chunk_indexes[:2]
    number = struct.Struct("<Q").pack
    places = [number(index.chunk_start_offset) for index in (first, second)]
    start = data.rindex(places[0] + struct.pack("<Q", first.chunk_length))
    damaged = [data[:start] + wrong + data[start + 8 :] for wrong in (places[1], *map(number, (8, 2**63, len(data))))]
    beyond = data.rindex(b"\x0f" + number(4))  # the end of the data, of an absurd length
    for changed in (*damaged, data[:beyond] + b"\x0c" + number(2**63) + data[beyond + 9 :]):
        (tmp_path / "b.mcap").write_bytes(changed)
        bag = Bag(tmp_path / "b.mcap")
        assert [(m.log_ns, m.data) for m in bag.messages()] == expected
        assert bag.lost == 0


def sensors(path, entries):
    """One-sample messages of two sensors: (topic, header s, log s) in this order, a few a chunk."""
    with (path.with_suffix(".tmp")).open("wb") as file:
        writer = McapWriter(file, chunk_size=2000)
        writer.start("ros2", "test")
        name = "geometry_msgs/msg/AccelStamped"
        schema = writer.register_schema(name, "ros2msg", typestore().generate_msgdef(name, ros_version=2)[0].encode())
        channels = {topic: writer.register_channel(f"/tbm/field/{topic}/accel", "cdr", schema) for topic in "ab"}
        for topic, stamp, log in entries:
            data = struct.pack("<4BIII4x6d", 0, 1, 0, 0, 10**9 + stamp, 0, 0, *range(6))
            writer.add_message(channels[topic], log * 10**9, data, 0)
        writer.finish()
    return path.with_suffix(".tmp").rename(path)


def test_no_layout_costs_a_sample(tmp_path):
    """Topic after topic; chunks in any order; log times that were set back, while the stamps went on."""
    steady = [(topic, s, s) for topic in "ab" for s in range(300)]
    blocks = [steady[k : k + 60] for k in range(0, 300, 60)]
    shuffled = [entry for k in (3, 0, 4, 2, 1) for entry in blocks[k]]
    set_back = [("a", s, s if s < 150 else s - 120) for s in range(300)]
    no_log = [("a", s, 7) for s in range(300)]
    layouts = {"after": steady, "shuffled": shuffled, "back": set_back, "none": no_log}
    for name, entries in layouts.items():
        path = sensors(tmp_path / f"{name}.mcap", entries)
        reader = open_recording(path)
        lengths = {}
        for piece in reader.pieces(30.0):
            for point, record in piece.items():
                lengths[point] = lengths.get(point, 0) + len(record.time)
        assert lengths == dict.fromkeys({topic for topic, _, _ in entries}, 300), name
        assert {faults.late + faults.disordered for faults in reader.faults.values()} == {0}, name
        assert (reader.lost, reader.damaged, reader.messages) == (0, 0, len(entries)), name
