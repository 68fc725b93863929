"""A CSV that is not as described is refused with what it seems to use; nothing is read by a guess."""

import pytest
from import_files import START, TOPIC, description, refused

from tbm_msgs_py import read_acceleration
from tbm_msgs_py.importing import describe, import_recording

NAMED = "it is there by csv: "
IS = "it is one by csv: "
NO_NAMES = "; line 1 holds numbers, no names: csv: {header: 0} says that there are none, and columns are called 1, 2, …"


def of(column="ax", **layout):
    point = {"columns": [column, None, None], "units": "m/s2", "gravity": "removed", "frame": "fixed"}
    return description(points={"shield": point}, csv=layout)


@pytest.mark.parametrize(
    ("content", "layout", "hint"),
    [
        ("t;ax\n0;1\n", {}, NAMED + '{delimiter: ";"}'),
        ("t,ax\n0,1\n", {"delimiter": ";"}, NAMED + '{delimiter: ","}'),
        ("t\tax\n0\t1\n", {}, NAMED + r'{delimiter: "\t"}'),
        ("sep=;\nt;ax\n0;1\n", {}, NAMED + '{header: 2, delimiter: ";"}'),
        ("Rig 3\n\nt,ax\n0,1\n", {}, NAMED + "{header: 3}"),
        ("0.0;0,5\n0.1;0,6\n", {"delimiter": ";"}, NO_NAMES),
        ("0.0;0,5\n0.1;0,6\n", {}, NO_NAMES),
        ("01.03.2026 08:00:00,0.5\n", {}, NO_NAMES),
        ("t,ay\n0,1\n", {}, "allowed: t, ay"),
        ("t   ax\n0   1\n", {}, NAMED + '{delimiter: " "}'),
        ("t;ax\n0;0,5\n", {"delimiter": ";"}, IS + '{decimal: ","}'),
        ("t;ax\n0;0.5\n", {"delimiter": ";", "decimal": ","}, IS + '{decimal: "."}'),
        ("t;ax\n0;1,234\n", {"delimiter": ";"}, IS + '{decimal: ","} or csv: {thousands: ","}'),
        ("t;ax\n0;1.234,5\n", {"delimiter": ";"}, IS + '{decimal: ",", thousands: "."}'),
        ("t;ax\n0;1 234\n", {"delimiter": ";"}, IS + '{thousands: " "}'),
        (
            "t,ax\n0,0,5\n",
            {},
            "the 2 of the header; numbers with decimal commas need another delimiter in the file",
        ),
        ("t,ax\ns,g\n0,0.5\n", {}, "numbers begin in line 3: csv: {first: 3}"),
        ("t,ax\n0,0.5\n", {"header": 0}, "numbers begin in line 2: csv: {header: 1}"),
        ("t,ax\n0,broken\n0,1\n", {}, "allowed: a finite number, decimal sign '.', no thousands signs"),
        ("t,ax\n0,\u22125\n0,1\n", {}, "'\u2212' is MINUS SIGN, which is no part of a plain number"),
    ],
)
def test_what_a_csv_seems_to_use_is_named(tmp_path, content, layout, hint):
    (tmp_path / "a.csv").write_text(content)
    column = "2" if layout.get("header") == 0 else "ax"
    assert refused(tmp_path / "a.csv", of(column, **layout), tmp_path / "bag").endswith(hint)


@pytest.mark.parametrize(
    ("content", "encoding", "hint"),
    [
        ("t,ä\n0,1\n".encode("utf-16"), {}, 'it begins as UTF-16 does: csv: {encoding: "utf-16"}'),
        ("t,ä\n0,1\n".encode("cp1252"), {}, 'csv: {encoding: "cp1252"}'),
        ("t,ä\n0,1\n".encode(), {"encoding": "cp1252"}, NAMED + '{encoding: "utf-8-sig"}'),
        (b"PK\3\4\xff", {}, "it is a zip archive, as .xlsx files are"),
    ],
)
def test_another_encoding_is_named(tmp_path, content, encoding, hint):
    (tmp_path / "a.csv").write_bytes(content)
    assert hint in refused(tmp_path / "a.csv", of("ä", **encoding), tmp_path / "bag")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_csv_without_names_has_numbered_columns(tmp_path, encoding):
    (tmp_path / "a.csv").write_text("note\n0,0;5,0;7\n0,5;6,0;8\n", encoding=encoding)
    point = {"columns": [2, None, None], "units": "m/s2", "gravity": "removed", "frame": "fixed"}
    layout = {"delimiter": ";", "decimal": ",", "header": 0, "first": 2, "encoding": encoding}
    time = {"column": 1, "unit": "s"}
    described = describe(None, {"points": {"shield": point}, "time": time, "start": START, "csv": layout})
    import_recording(tmp_path / "a.csv", described, tmp_path / "bag")
    record = read_acceleration(tmp_path / "bag", TOPIC)
    assert record.time.tolist() == [0.0, 0.5]
    assert record.values[:, 0].tolist() == [5.0, 6.0]
