"""Input without an end, or far beyond what anybody means: refused in one short line, or shown in part."""

import re
from importlib import resources

import pytest
from mcap.writer import CompressionType, Writer

from tbm_dynamics import MachineError, load_machine
from tbm_dynamics.loads.cutters.description import CutterError
from tbm_dynamics.loads.cutters.layout import COLUMNS, read_layout
from tbm_dynamics.streaming.schedule import read_schedule
from tbm_gsa.sensitivity.study.definition import read_definition
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_msgs_py import Bag, RecordingError, load_mapping
from tbm_msgs_py.bags import chunks
from tbm_msgs_py.base.files import LARGEST_TABLE, LARGEST_TEXT
from tbm_msgs_py.base.texts import listed, quoted
from tbm_msgs_py.importing.description import describe

LONG = "a" * 100_000
KEY = "a" * 1000  # the longest that YAML takes is 1024
SENSOR = "{point: shield, units: g, gravity: removed, frame: fixed}"
LONG_TEXTS = {
    "title": (load_machine, MachineError, "title"),
    "name": (load_machine, MachineError, "name"),
    "source": (load_machine, MachineError, "source"),
    "topic": (load_mapping, RecordingError, f"topics: {{{KEY}: {SENSOR}}}"),
    "point": (load_mapping, RecordingError, f"topics: {{/a: {SENSOR.replace('shield', LONG)}}}"),
    "unit": (load_mapping, RecordingError, f"topics: {{/a: {SENSOR.replace('units: g', f'units: {LONG}')}}}"),
    "key": (load_mapping, RecordingError, f"topics: {{/a: {SENSOR[:-1]}, {KEY}: 1}}}}"),
    "column": (describe, RecordingError, f"points: {{shield: {SENSOR[:-1]}, columns: [{LONG}, b, c]}}}}\nrate: 1"),
    "encoding": (describe, RecordingError, f"csv: {{encoding: {LONG}}}"),
    "group": (read_definition, StudyError, f"inputs: {{x1: }}\ngroups: {{{KEY}: [x1]}}"),
    "output": (read_definition, StudyError, f"inputs: {{x1: }}\noutputs: [{LONG}]"),
    "input": (read_definition, StudyError, f"inputs: {{{KEY}: }}"),
    "law": (read_definition, StudyError, f"inputs: {{x1: {{distribution: {LONG}}}}}"),
    "number": (read_definition, StudyError, f"inputs: {{x1: {{lower: 1{'0' * 400}, upper: 2}}}}"),
    "cell": (read_schedule, MachineError, f"time_s,speed_r_min,torque_kn_m,thrust_kn\n0,1,1,{LONG}"),
    "field": (read_schedule, MachineError, f"time_s,speed_r_min,torque_kn_m,thrust_kn\n0,1,1,{LONG}{LONG}"),
}


@pytest.mark.parametrize("kind", LONG_TEXTS)
def test_a_long_text_is_one_short_line(tmp_path, kind):
    read, error, text = LONG_TEXTS[kind]
    if read is load_machine:
        shipped = (resources.files("tbm_dynamics") / "machines" / "dz101.yaml").read_text("utf-8")
        text, changed = re.subn(rf"^(\s*){text}: .*$", rf"\1{text}: {LONG}", shipped, count=1, flags=re.MULTILINE)
        assert changed == 1
    (tmp_path / "file").write_text(text)
    with pytest.raises(error) as caught:
        read(tmp_path / "file")
    assert len(str(caught.value).splitlines()) == 1
    assert len(str(caught.value)) < 1000
    assert "YAML" not in str(caught.value)


@pytest.mark.parametrize(
    ("read", "error", "largest"),
    [
        (load_machine, MachineError, LARGEST_TEXT),
        (load_mapping, RecordingError, LARGEST_TEXT),
        (describe, RecordingError, LARGEST_TEXT),
        (read_definition, StudyError, LARGEST_TEXT),
        (read_schedule, MachineError, LARGEST_TABLE),
        (lambda path: read_layout(path, 4.0), CutterError, LARGEST_TEXT),
    ],
)
def test_a_large_file_is_not_read(tmp_path, read, error, largest):
    with (tmp_path / "file").open("wb") as file:
        file.truncate(largest + 1)
    with pytest.raises(error, match=f"larger than {largest >> 20} MiB"):
        read(tmp_path / "file")


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (["9" * 5000 + ",face,1,0,0"], "is no number of a cutter"),
        (["1,face,1,0," + LONG + LONG], "field larger than field limit"),
        (["1,face,1,0,0"] * 1001, "1001 cutters; allowed are up to 1000"),
    ],
)
def test_a_layout_has_bounds(tmp_path, rows, told):
    (tmp_path / "layout.csv").write_text("\n".join([",".join(COLUMNS), *rows]))
    with pytest.raises(CutterError, match=told) as caught:
        read_layout(tmp_path / "layout.csv", 4.0)
    assert len(str(caught.value)) < 1000


def test_a_long_cell_of_an_import_is_one_short_line(tmp_path, command):
    (tmp_path / "a.csv").write_text("ax,ay,az\n1,2," + "9" * (1 << 21) + "\n")
    (tmp_path / "a.yaml").write_text(
        f"points: {{shield: {SENSOR.replace('point: shield, ', '')[:-1]}, columns: [ax, ay, az]}}}}\n"
        "rate: 1\nstart: 2026-03-01T08:00:00+01:00\n"
    )
    code, _, err = command("bag", "import", "a.csv", "--out", "bag", "--map", "a.yaml")
    assert (code, len(err.splitlines())) == (2, 1)
    assert "a line of more than" in err
    assert not (tmp_path / "bag").exists()


def recording(path, topics, data=b"\0\1\0\0\2\0\0\0a\0", **options):
    """One message on each of so many topics, as the mcap library writes it."""
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start("ros2", "test")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        for number in range(topics):
            channel = writer.register_channel(f"/topic{number}", "cdr", schema)
            writer.add_message(channel, 10**18 + number, data, 10**18 + number)
        writer.finish()
    return path


def test_many_topics_are_shown_in_part(tmp_path, command):
    recording(tmp_path / "many.mcap", 300)
    code, out, _ = command("bag", "info", "many.mcap")
    assert (code, out.count("std_msgs/msg/String")) == (0, 200)
    assert out.splitlines()[-1] == "and 100 more topics, which --json lists"
    code, out, err = command("compare", "many.mcap")
    assert (code, len(err.splitlines())) == (2, 1)
    assert err.endswith("and 280 more\n")
    assert len(err) < 2000


@pytest.mark.parametrize("folder", [False, True])
def test_a_recording_that_unpacks_without_an_end_is_refused(tmp_path, monkeypatch, folder):
    monkeypatch.setattr(chunks, "SPARE", 5 << 20)
    (tmp_path / "bag").mkdir()
    for number in range(3):  # of 2 MiB of zeros each
        recording(tmp_path / "bag" / f"bag_{number}.mcap", 1 if folder else 3, bytes(2 << 20), chunk_size=1)
    path = tmp_path / "bag" if folder else tmp_path / "bag" / "bag_0.mcap"
    with pytest.raises(RecordingError, match="unpacks to far more than it holds, allowed: chunks of up to 256 times"):
        list(Bag(path).batches())
    assert Bag(path).info().messages == 3  # the index needs nothing unpacked
    monkeypatch.setattr(chunks, "SPARE", 7 << 20)
    assert sum(map(len, Bag(path).batches())) == 3


def test_lz4_cannot_say_more_than_is_allowed(tmp_path, monkeypatch):
    monkeypatch.setattr(chunks, "SPARE", 0)
    path = recording(tmp_path / "lz4.mcap", 3, bytes(2 << 20), chunk_size=1, compression=CompressionType.LZ4)
    assert sum(map(len, Bag(path).batches())) == 3


def test_what_is_quoted_and_listed_has_bounds():
    assert quoted("abc") == "'abc'"
    assert quoted(LONG).endswith("… (100002 characters)")
    assert len(quoted(LONG)) < 110
    assert listed(map(str, range(3))) == "0, 1, 2"
    assert listed(map(str, range(60_000))).endswith("18, 19 and 59980 more")
