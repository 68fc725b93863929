"""Import: a file or a description that is wrong is refused in one line, and nothing is left behind."""

import csv
import sys

import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st
from import_files import (
    OPERATING,
    POINT,
    RATE,
    ROWS,
    TIME,
    TOPIC,
    VALUES,
    description,
    refused,
    without,
    write_hdf5,
)

from tbm_msgs_py import RecordingError, read_acceleration
from tbm_msgs_py.importing import import_recording


@pytest.mark.parametrize(("suffix", "module"), [(".tdms", "nptdms"), (".mf4", "asammdf"), (".mat", "h5py")])
def test_missing_library_names_the_extra(tmp_path, monkeypatch, suffix, module):
    path = tmp_path / f"a{suffix}"
    if suffix == ".mat":
        write_hdf5(path, {"ax": TIME})
    else:
        path.touch()
    monkeypatch.setitem(sys.modules, module, None)
    assert "pip install 'tbm_monitor[import]'" in refused(path, description(), tmp_path / "bag")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ax,ay,az\n1,2,3\n4,,6\n", "line 3, column ay: ''"),
        ("ax,ay,az\n1,2,3\n4,5,n/a\n", "line 3, column az: 'n/a'"),
        ("ax,ay,az\n1,2,3\nnan,5,6\n", "line 3, column ax: 'nan'"),
        ("ax,ay,az\n1,2,3\n1e999,5,6\n", "line 3, column ax: '1e999'"),
        ("ax,ay,az\n1,2,3\n4,5\n", "line 3: 2 cells, allowed: the 3 of the header"),
        ("ax,ay,az\n1,5,2,5,3,5\n", "line 2: 6 cells"),
        ("ax,ay,az\n1,2,3\n\n4,5,6\n", "line 3: 0 cells"),
        ("ax,ay,az\n", "no row after line 1"),
        ("", "line 1: empty"),
        ("ax,ay,ax,az\n1,2,3,4\n", "column ax occurs twice"),
        ("ax,ay\n1,2\n", "column az is not there, allowed: ax, ay"),
        ("ax,ay,az\n1,2,3\n1_0,5,6\n", "line 3, column ax: '1_0'"),
        pytest.param(
            "ax,ay,az\n1,2,3\n4,5," + 200_000 * "9" + "\n", "line 3: field larger than field limit", id="long cell"
        ),
    ],
)
def test_bad_csv_is_refused_with_row_and_column(tmp_path, text, message):
    (tmp_path / "a.csv").write_text(text)
    assert message in refused(tmp_path / "a.csv", description(), tmp_path / "bag")


def test_bad_time_is_refused_with_its_row(tmp_path):
    stated = without("rate", points={"shield": POINT}, time={"column": "t", "unit": "s"})
    for times, message in {
        (0, 1, 1): "line 4: the time repeats",
        (0, 2, 1): "line 4: the time steps back by 1 s",
    }.items():
        (tmp_path / "a.csv").write_text("t,ax,ay,az\n" + "".join(f"{t},1,2,3\n" for t in times))
        assert message in refused(tmp_path / "a.csv", stated, tmp_path / "bag")
    assert "a CSV file states no time" in refused(
        tmp_path / "a.csv", without("rate", points={"shield": POINT}, time="file"), tmp_path / "bag"
    )
    assert "states no moment" in refused(tmp_path / "a.csv", description(start="file"), tmp_path / "bag")


def test_undecodable_text_is_refused(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"ax,ay,az\n1,2,\xff\n")
    assert "encoding utf-8-sig" in refused(tmp_path / "a.csv", description(), tmp_path / "bag")


def test_suffix_and_missing_file(tmp_path):
    assert "suffix .xlsx, allowed: .csv" in refused(tmp_path / "a.xlsx", description(), tmp_path / "bag")
    assert "no such file" in refused(tmp_path / "a.csv", description(), tmp_path / "bag")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"points": {"shield": {k: v for k, v in POINT.items() if k != "units"}}},
            "points.shield.units: missing, allowed: ",
        ),
        ({"points": {"shield": POINT | {"units": "G"}}}, "points.shield.units: 'G'"),
        ({"points": {"shield": POINT | {"columns": ["a", "b"]}}}, "points.shield.columns"),
        ({"points": {"shield": POINT | {"columns": ["a", "a", "b"]}}}, "none of them twice"),
        ({"points": {"a/b": POINT}}, "point 'a/b'"),
        ({"points": {}}, "points, operating_point or drives"),
        ({"rate": 0}, "rate: 0"),
        ({"time": "file"}, "time or rate"),
        ({"start": "2026-03-01T08:00:00"}, "'2026-03-01T08:00:00': without its zone, allowed: "),
        ({"start": None}, "start: missing, allowed: the moment of time 0"),
        (
            {"sensors": 1},
            "sensors: unknown key, allowed: time, rate, start, timezone, csv, points, operating_point, drives, files",
        ),
        ({"points": {"shield": POINT | {"unit": "g"}}}, "points.shield.unit: unknown key, allowed: point, units, "),
        ({"csv": {"decimals": ","}}, "csv.decimals: unknown key, allowed: delimiter, decimal, encoding, header, first"),
        (
            {"operating_point": OPERATING | {"speed": {"column": "rpm", "unit": "r/min", "scale": 2}}},
            "operating_point.speed.scale: unknown key, allowed: column, unit",
        ),
        ({"operating_point": {"speed": {"column": "rpm", "unit": "rpm"}}}, "operating_point.speed.unit: 'rpm'"),
        ({"csv": {"decimal": ","}}, "delimiter and decimal: both ','"),
        (
            {"rate": None, "time": "flie"},
            "time: 'flie', allowed: a mapping with keys of column, unit, restart_gap, or 'f",
        ),
        ({"rate": None, "time": {"column": "", "unit": "s"}}, "description: time.column: '', allowed: at least 1"),
        ({"csv": ";"}, "csv: ';', allowed: a mapping with keys of delimiter, decimal, encoding, header, first"),
        (
            {"points": {"shield": POINT | {"columns": "ax"}}},
            "points.shield.columns: 'ax', allowed: a list, as [a, b, c]",
        ),
        ({"timezone": 600}, "timezone: 600, allowed: a text; what YAML reads as something else, such as a number, in"),
    ],
)
def test_wrong_description_is_one_line(changes, message):
    with pytest.raises(RecordingError) as caught:
        description(**changes)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "allowed: " in str(caught.value)


@settings(max_examples=60)
@given(text=st.text("0123456789.,-+eEnaif \"'\n\r;x", max_size=120))
def test_any_text_is_imported_or_refused_in_one_line(tmp_path_factory, text):
    folder = tmp_path_factory.mktemp("text")
    (folder / "a.csv").write_text("ax,ay,az\n" + text, newline="")
    try:
        import_recording(folder / "a.csv", description(), folder / "bag")
    except RecordingError as error:
        assert "\n" not in str(error)
        return
    rows = [row for row in csv.reader((folder / "a.csv").read_text().splitlines()[1:]) if row]
    record = read_acceleration(folder / "bag", TOPIC)
    np.testing.assert_array_equal(record.values, np.array(rows, float).astype(np.float32))


def write_tdms(path):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as writer:
        channels = [nptdms.ChannelObject("A", name, VALUES[:, k]) for k, name in enumerate("XYZ")]
        writer.write_segment(channels)


def write_mdf(path):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(VALUES[:, k], TIME, name=name) for k, name in enumerate("XYZ")])
        file.save(path)


CUT = {
    ".tdms": (write_tdms, ["A/X", "A/Y", "A/Z"]),
    ".mf4": (write_mdf, ["X", "Y", "Z"]),
    ".wav": (lambda path: scipy.io.wavfile.write(path, RATE, VALUES), ["1", "2", "3"]),
    ".mat": (lambda path: scipy.io.savemat(path, dict(zip("XYZ", VALUES.T, strict=True))), ["X", "Y", "Z"]),
}


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # asammdf, see `apart`
@pytest.mark.parametrize("suffix", CUT)
def test_file_that_was_cut_is_refused_or_says_what_is_missing(tmp_path, suffix):
    write, names = CUT[suffix]
    path = tmp_path / f"a{suffix}"
    write(path)
    whole = path.read_bytes()
    stated = description(points={"shield": POINT | {"columns": names, "full_scale": 1}})
    for share in np.linspace(0, 0.99, 15):
        path.write_bytes(whole[: int(share * len(whole))])
        out = tmp_path / f"bag{share}"
        try:
            imported = import_recording(path, stated, out)
        except RecordingError as error:
            assert "\n" not in str(error)
            assert not out.exists()
        else:
            assert imported.streams["shield"].samples < ROWS
            assert imported.warnings
