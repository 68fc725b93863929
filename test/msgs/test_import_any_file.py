"""Whatever is in a file, its import ends in a recording that reads back, or in one line: a property test a format."""

import struct
import warnings

import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from import_files import POINT, START, TOPIC, write_hdf5

from tbm_msgs_py import RecordingError, read_acceleration
from tbm_msgs_py.importing import describe, import_recording
from tbm_msgs_py.importing.apart import import_apart

FEW, MANY = 12, 2000  # inputs of a format: always, and under `verify`
APART = 60  # of the formats whose libraries may crash, each in a process of its own
PLAIN = settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], deadline=None)

BYTES = st.sampled_from([0, 1, 2, 3, 127, 128, 254, 255]) | st.integers(0, 255)
FLIPS = st.lists(st.tuples(st.floats(0, 1, exclude_max=True), BYTES), max_size=5)
NUMBERS = st.sampled_from([0.0, -1.5, 1e39, 1e300, np.inf, -np.inf, np.nan]) | st.floats(-1e3, 1e3)
CLOCKS = st.fixed_dictionaries(
    {"start": st.sampled_from([START, START, "file", "1970-01-01T00:00:00Z", "2038-01-19T03:14:07Z", "1969-07-20"])}
).flatmap(
    lambda start: st.sampled_from(
        [
            {"rate": 1000.0, **start},
            {"rate": 1e-6, **start},
            {"time": "file", **start},
            {"time": {"column": "t", "unit": "s"}, **start},
            {"time": {"column": "t", "unit": "ns"}, **start},
            {"time": {"column": "t", "unit": "datetime"}},
        ]
    )
)


@pytest.fixture
def ends(tmp_path):
    """Import a file and read it back."""

    def run(path, column="a", importing=import_recording, **changes):
        point = {"shield": POINT | {"columns": [column, None, None], "full_scale": 1}}
        out = tmp_path / "bag.mcap"
        out.unlink(missing_ok=True)
        try:
            described = describe(None, {"points": point} | changes)
            imported = importing(path, described, out)
        except RecordingError as error:
            assert "\n" not in str(error)
            assert "allowed: " in str(error)
            assert not out.exists()
            return
        record = read_acceleration(out, TOPIC)
        assert len(record.time) == len(record.values) == imported.streams["shield"].samples > 0
        assert np.isfinite(record.values).all()

    return run


def damaged(content, flips, length):
    """Bytes with some of them replaced, and cut."""
    changed = bytearray(content)
    for place, byte in flips:
        changed[int(place * len(changed))] = byte
    return bytes(changed[: int(length * len(changed)) + 1])


CELLS = st.text("0123456789.,-+eE'\" \t_\0aNxT:Z\ufeff\uff11\r\n", max_size=12)


@given(
    rows=st.lists(st.lists(CELLS | NUMBERS.map(repr) | st.integers().map(str), min_size=1, max_size=3), max_size=6),
    layout=st.fixed_dictionaries(
        {"delimiter": st.sampled_from(",;\t "), "decimal": st.sampled_from(".,")},
        optional={
            "thousands": st.sampled_from([".", ",", " ", "'"]),
            "header": st.integers(0, 3),
            "first": st.integers(1, 4),
            "encoding": st.sampled_from(["utf-8", "latin-1", "utf-16", "ascii", "cp037"]),
        },
    ),
    ends_of_lines=st.sampled_from(["\n", "\r\n", "\r", "\n\n"]),
    clock=CLOCKS,
    flips=FLIPS,
    length=st.sampled_from([1.0, 1.0, 0.6]),
)
def any_csv(ends, path, rows, layout, ends_of_lines, clock, flips, length):
    lines = [layout["delimiter"].join(cells) for cells in [["a", "t"], *rows]]
    path.write_bytes(damaged(ends_of_lines.join(lines).encode("utf-8"), flips, length))
    ends(path, csv=layout, timezone="UTC", **clock)


@given(
    tag=st.sampled_from([1, 1, 3, 0xFFFE, 7]),
    channels=st.sampled_from([1, 1, 2, 0, 65535]),
    rate=st.sampled_from([0, 1, 1000, 2**32 - 1]),
    bits=st.sampled_from([8, 16, 16, 24, 32, 64, 0, 1, 12, 65535]),
    sizes=st.tuples(*[st.sampled_from([None, 0, 1, 2**31, 2**32 - 1])] * 2),
    data=st.binary(max_size=40),
    behind=st.binary(max_size=20),
    head=st.sampled_from([b"RIFF", b"RF64", b"BW64"]),
    clock=CLOCKS,
    flips=FLIPS,
    length=st.sampled_from([1.0, 1.0, 0.6]),
)
def any_wav(ends, path, tag, channels, rate, bits, sizes, data, behind, head, clock, flips, length):
    row = channels * bits // 8 % 2**16
    identifier = bytes.fromhex("1600100004000000") + bytes.fromhex("0100000000001000800000aa00389b71")
    fmt = struct.pack("<HHIIHH", tag, channels, rate, 0, row, bits) + (identifier if tag == 0xFFFE else b"\0\0")
    chunks = [(b"ds64", bytes(28), None)] * (head != b"RIFF") + [(b"fmt ", fmt, sizes[0]), (b"data", data, sizes[1])]
    content = b"".join(
        name + struct.pack("<I", len(inner) if size is None else size) + inner for name, inner, size in chunks
    )
    path.write_bytes(damaged(head + bytes(4) + b"WAVE" + content + behind, flips, length))
    ends(path, "1", timezone="UTC", **clock)


DTYPES = st.sampled_from(["f8", "f4", "i1", "i8", "u8", "?", "c16", "U3", "O"])
SHAPES = st.sampled_from([(5, 1), (1, 5), (3, 4), (0, 1), (0, 0), (1, 1), (2, 2, 2)])


def _array(dtype, shape, values):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.resize(np.array(values), shape).astype(dtype)


@given(
    arrays=st.lists(st.tuples(DTYPES, SHAPES, st.lists(NUMBERS, min_size=1, max_size=5)), min_size=2, max_size=2),
    inside=st.booleans(),
    column=st.sampled_from(["a", "a", "a(:,1)", "a(2,:)", "a.b", "a.b(:,1)", "q"]),
    clock=CLOCKS,
    flips=FLIPS,
    length=st.sampled_from([1.0, 1.0, 0.6]),
)
def any_mat(ends, path, arrays, inside, column, clock, flips, length):
    first, second = (_array(*array) for array in arrays)
    scipy.io.savemat(path, {"a": {"b": first} if inside else first, "t": second})
    if ends.apart:  # a damaged one may crash scipy
        path.write_bytes(damaged(path.read_bytes(), flips, length))
    ends(path, column, **clock)


@given(
    arrays=st.lists(st.tuples(DTYPES, SHAPES, st.lists(NUMBERS, min_size=1, max_size=5)), min_size=2, max_size=2),
    marks=st.dictionaries(
        st.sampled_from(["MATLAB_class", "MATLAB_empty", "MATLAB_sparse", "MATLAB_object_decode"]),
        st.sampled_from([b"double", b"char", b"logical", b"", 0, 1, 3]),
    ),
    column=st.sampled_from(["a", "a", "a(:,1)", "a(2,:)", "a.b"]),
    clock=CLOCKS,
    flips=FLIPS,
    length=st.sampled_from([1.0, 1.0, 0.6]),
)
def any_hdf5(ends, path, arrays, marks, column, clock, flips, length):
    h5py = pytest.importorskip("h5py")
    first, second = (_array(dtype if dtype not in ("U3", "O") else "S3", *rest) for dtype, *rest in arrays)
    write_hdf5(path, {"t": second})
    with h5py.File(path, "r+") as file:
        file["a"] = first
        file["a"].attrs.update(
            {key: np.bytes_(mark) if isinstance(mark, bytes) else mark for key, mark in marks.items()}
        )
    if ends.apart:
        path.write_bytes(damaged(path.read_bytes(), flips, length))
    ends(path, column, **clock)


PROPERTIES = st.fixed_dictionaries(
    {},
    optional={
        "wf_increment": st.sampled_from([0.001, 0.0, -1.0, np.nan, 1e300, "0.1", 1]),
        "wf_start_offset": st.sampled_from([0.0, 5.0, np.inf, "x"]),
        "wf_start_time": st.sampled_from(
            [np.datetime64("2026-03-01"), np.datetime64("1904-01-01"), "2026-03-01 08:00:00", 5]
        ),
        "unit_string": st.sampled_from(["g", "m/s2", 5]),
        "NI_Number_Of_Scales": st.integers(0, 2),
        "NI_Scale[0]_Scale_Type": st.sampled_from(["Linear", "Table", "Odd", 5]),
        "NI_Scaling_Status": st.sampled_from(["unscaled", "scaled"]),
    },
)


@given(
    segments=st.lists(st.tuples(st.lists(NUMBERS, max_size=4), PROPERTIES), min_size=1, max_size=3),
    dtype=st.sampled_from(["f8", "f8", "i2", "?", "c16", "U3"]),
    clock=CLOCKS,
    flips=FLIPS,
    length=st.sampled_from([1.0, 1.0, 0.6]),
)
def any_tdms(ends, path, segments, dtype, clock, flips, length):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as writer:
        for values, stated in segments:
            data = _array(dtype, (len(values),), values or [0.0])
            writer.write_segment([nptdms.ChannelObject("g", name, data, stated) for name in "at"])
    path.write_bytes(damaged(path.read_bytes(), flips, length))
    if isinstance(clock.get("time"), dict):
        clock = clock | {"time": clock["time"] | {"column": "g/t"}}
    ends(path, "g/a", timezone="UTC", **clock)


@given(
    values=st.lists(st.tuples(NUMBERS, NUMBERS), max_size=5),
    dtype=st.sampled_from(["f8", "f8", "i2", "u8", "S3"]),
    conversion=st.sampled_from(
        [None, {"a": 2.0, "b": 1.0}, {"val_0": 0, "text_0": b"off"}, {"formula": "2*X1"}, {"formula": "("}]
    ),
    clock=CLOCKS,
    flips=FLIPS,
    length=st.sampled_from([1.0, 1.0, 0.6]),
)
def any_mdf(ends, path, values, dtype, conversion, clock, flips, length):
    asammdf = pytest.importorskip("asammdf")
    data = _array(dtype, (len(values),), [value for value, _ in values] or [0.0])
    text = {"encoding": "utf-8"} if dtype == "S3" else {"conversion": conversion}
    with warnings.catch_warnings(), asammdf.MDF(version="4.10") as file:
        warnings.simplefilter("ignore")
        file.append([asammdf.Signal(data, np.array([time for _, time in values]), name="a", **text)])
        file.save(path, overwrite=True)
    if ends.apart:
        path.write_bytes(damaged(path.read_bytes(), flips, length))
    ends(path, **clock)


FORMATS = {
    "csv": any_csv,
    "wav": any_wav,
    "tdms": any_tdms,
    "mat": any_mat,
    "hdf5.mat": any_hdf5,
    "mf4": any_mdf,
}
CRASHING = ("mat", "hdf5.mat", "mf4")
UNRAISABLE = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # asammdf, see `apart`


@UNRAISABLE
@pytest.mark.parametrize("suffix", FORMATS)
def test_any_file_is_imported_or_refused_in_one_line(tmp_path, ends, suffix):
    ends.apart = False
    settings(PLAIN, max_examples=FEW)(FORMATS[suffix])(ends, tmp_path / f"a.{suffix}")


@UNRAISABLE
@pytest.mark.verify
@pytest.mark.parametrize("suffix", FORMATS)
def test_very_many_files_are_imported_or_refused(tmp_path, ends, suffix):
    ends.apart = False
    settings(PLAIN, max_examples=MANY)(FORMATS[suffix])(ends, tmp_path / f"a.{suffix}")


@UNRAISABLE
@pytest.mark.verify
@pytest.mark.parametrize("suffix", CRASHING)
def test_damage_that_may_crash_a_library_is_one_line(tmp_path, ends, suffix):
    def apart(path, column="a", **changes):
        ends(path, column, importing=import_apart, **changes)

    apart.apart = True
    settings(PLAIN, max_examples=APART)(FORMATS[suffix])(apart, tmp_path / f"a.{suffix}")
