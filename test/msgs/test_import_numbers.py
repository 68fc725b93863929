"""Import: a cell, a data set or a channel is a plain number in the stated format, or it is refused by its name."""

import struct
import uuid

import numpy as np
import pytest
import scipy.io
import scipy.sparse
from import_files import OPERATING, POINT, RATE, START, TOPIC, description, refused, without, write_hdf5

from tbm_msgs_py import RecordingError, read_acceleration
from tbm_msgs_py.importing import import_recording

NUMBERS = np.arange(12.0)


def of(column, **changes):
    """Description of one column at a stated rate."""
    return description(points={"shield": POINT | {"columns": [column, None, None]}}, **changes)


def taken(path, described):
    """Values of the one column of an import."""
    import_recording(path, described, path.parent / "bag")
    return read_acceleration(path.parent / "bag", TOPIC).values[:, 0].tolist()


@pytest.mark.parametrize(
    "cell",
    [
        *("1_0", "0x1p3", "1d3", "True", "1\u0662", "\uff11", "\u00bd", "1,5", "1 000", "1'000", "2 g", "1e", "--1"),
        *("1.2.3", "inf", "-nan", "1e999", "1\0", '"1"0', "", "#N/A", "1e39"),
    ],
)
def test_a_cell_that_is_no_plain_number_is_refused(tmp_path, cell):
    (tmp_path / "a.csv").write_text(f"ax;ay;az\n1;2;3\n{cell};5;6\n")
    message = refused(tmp_path / "a.csv", description(csv={"delimiter": ";"}), tmp_path / "bag")
    assert "a.csv: line 3" in message
    assert '"' in cell or "line 3, column ax: " in message


@pytest.mark.parametrize(
    ("cell", "layout", "value"),
    [
        ("1.234.567,5", {"delimiter": ";", "decimal": ",", "thousands": "."}, 1234567.5),
        ("1.234", {"delimiter": ";", "decimal": ",", "thousands": "."}, 1234),
        ("1234,5", {"delimiter": ";", "decimal": ",", "thousands": "."}, 1234.5),
        ('"-1,234.5e1"', {"thousands": ","}, -12345),
        ("1'234", {"thousands": "'"}, 1234),
        ("12.34,5", {"delimiter": ";", "decimal": ",", "thousands": "."}, None),
        ("1.2345", {"delimiter": ";", "decimal": ",", "thousands": "."}, None),
        ("1.234", {"delimiter": ";", "decimal": ","}, None),
        ("1'234", {"thousands": " "}, None),
    ],
)
def test_thousands_signs_are_read_where_they_are_stated(tmp_path, cell, layout, value):
    cells = layout.get("delimiter", ",").join((cell, "7"))
    (tmp_path / "a.csv").write_text(f"a{layout.get('delimiter', ',')}b\n{cells}\n")
    if value is None:
        assert "line 2, column a: " in refused(tmp_path / "a.csv", of("a", csv=layout), tmp_path / "bag")
    else:
        assert taken(tmp_path / "a.csv", of("a", csv=layout)) == [value]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"csv": {"delimiter": "1"}}, "csv.delimiter: part of a number"),
        ({"csv": {"delimiter": "e"}}, "csv.delimiter: part of a number"),
        ({"csv": {"thousands": "."}}, "thousands and decimal: both '.'"),
        ({"csv": {"header": True}}, "csv.header: True"),
        ({"rate": True}, "rate: True"),
        ({"rate": "1000"}, "rate: '1000'"),
        ({"rate": 2e9}, "rate: 2000000000.0"),
        ({"operating_point": OPERATING | {"thrust": {"value": -5.0, "unit": "kN"}}}, "value: -5 kN, allowed: 0 to"),
        ({"operating_point": OPERATING | {"speed": {"value": 1e30, "unit": "r/min"}}}, "value: 1e.30 r/min, allowed"),
        ({"points": {"shield": POINT | {"full_scale": "5"}}}, "full_scale: '5'"),
    ],
)
def test_a_description_holds_plain_numbers_too(changes, message):
    with pytest.raises(RecordingError, match=message.replace("(", r"\(")):
        description(**changes)


def test_a_value_too_large_for_its_message_is_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("ax,ay,az,rpm,torque,thrust\n1,2,3,4,5,1e308\n")
    point = POINT | {"units": "g", "full_scale": 1e300}
    assert "line 2, column ax: " in refused(path, description(points={"shield": point}), tmp_path / "bag")
    for text, unit in (("1e308", "MN"), ("1e13", "kN")):  # beyond any number, and beyond any machine
        path.write_text(f"ax,ay,az,rpm,torque,thrust\n1,2,3,4,5,6\n1,2,3,4,5,{text}\n")
        huge = OPERATING | {"thrust": {"column": "thrust", "unit": unit}}
        message = refused(path, description(points={}, operating_point=huge), tmp_path / "bag")
        assert f"a.csv: line 3, column thrust: {float(text):g} {unit}, allowed: up to 1e+15 in SI units" in message


def test_an_operating_value_below_zero_is_named(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("ax,ay,az,rpm,torque,thrust\n1,2,3,4,5,6\n1,2,3,4,-1,-2.5\n1,2,3,4,5,-1\n")
    imported = import_recording(path, description(operating_point=OPERATING), tmp_path / "bag")
    standstill = "no comparison is made with such an operating point"
    assert imported.warnings == [
        f"{path}: line 3, column torque: -1 kN.m, below 0: {standstill}",
        f"{path}: line 3, column thrust: -2.5 kN, and 1 more rows below 0: {standstill}",
    ]


MATLAB = {
    "char": ("12", "char"),
    "logical": (NUMBERS > 3, "logical"),
    "cell": (np.array([1.0, "b"], object), "cell"),
    "complex": (NUMBERS * 1j, "complex"),
    "sparse": (scipy.sparse.eye(3), "sparse"),
    "array of structs": (np.array([(1.0,), (2.0,)], dtype=[("f", "O")]), "struct array"),
    "struct": ({"b": NUMBERS, "flag": NUMBERS > 3}, "allowed: a.b, a.flag"),
    "empty": (np.zeros((0, 1)), "no row"),
}


@pytest.mark.parametrize("name", MATLAB)
def test_a_matlab_class_that_is_no_number_is_refused(tmp_path, name):
    value, message = MATLAB[name]
    scipy.io.savemat(tmp_path / "a.mat", {"a": value})
    assert message in refused(tmp_path / "a.mat", of("a"), tmp_path / "bag")
    if name == "struct":
        assert taken(tmp_path / "a.mat", of("a.b")) == NUMBERS.tolist()
        assert "logical" in refused(tmp_path / "a.mat", of("a.flag"), tmp_path / "other")


HDF5 = {  # as MATLAB marks them
    "char": (np.array([[97, 98]], np.uint16), {"MATLAB_class": b"char", "MATLAB_int_decode": 2}, "char"),
    "logical": (np.array([[1, 0]], np.uint8), {"MATLAB_class": b"logical", "MATLAB_int_decode": 1}, "logical"),
    "datetime": (np.array([[1, 3]], np.uint32), {"MATLAB_class": b"datetime", "MATLAB_object_decode": 3}, "datetime"),
    "empty": (np.array([0, 1], np.uint64), {"MATLAB_class": b"double", "MATLAB_empty": 1}, "no row"),
    "complex": (np.array([(1, 2)], [("real", "f8"), ("imag", "f8")]), {"MATLAB_class": b"double"}, "complex"),
    "enumeration": (np.array([[True, False]]), {}, "logical"),
    "int64": (np.array([[1, 2]]), {"MATLAB_class": b"int64"}, [1, 2]),
    "row of a matrix": (np.array([[1, 2], [3, 4], [5, 6]]), {"MATLAB_class": b"double"}, [2, 4, 6]),
}


@pytest.mark.parametrize("name", HDF5)
def test_a_class_of_matlab_7_3_that_is_no_number_is_refused(tmp_path, name):
    h5py = pytest.importorskip("h5py")
    value, marks, expected = HDF5[name]
    write_hdf5(tmp_path / "a.mat", {})
    with h5py.File(tmp_path / "a.mat", "r+") as file:
        file.create_dataset("a", data=value).attrs.update(
            {key: np.bytes_(mark) if isinstance(mark, bytes) else mark for key, mark in marks.items()}
        )
        file.create_group("s").attrs["MATLAB_sparse"] = 3
        file["s/data"] = NUMBERS
    column = "a(2,:)" if name == "row of a matrix" else "a"
    if isinstance(expected, list):
        assert taken(tmp_path / "a.mat", of(column)) == expected
    else:
        assert expected in refused(tmp_path / "a.mat", of(column), tmp_path / "bag")
    assert "class sparse" in refused(tmp_path / "a.mat", of("s"), tmp_path / "other")
    assert "s.data is not there" in refused(tmp_path / "a.mat", of("s.data"), tmp_path / "other")


def test_rows_of_a_matrix_can_be_named_and_no_variable_twice(tmp_path):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"a": NUMBERS.reshape(3, 4)})
    assert taken(path, of("a(2,:)")) == [4, 5, 6, 7]
    assert "a is 3 x 4" in refused(path, of("a(4,:)"), tmp_path / "other")
    path.write_bytes(path.read_bytes() + path.read_bytes()[128:])
    assert "variable a is there twice" in refused(path, of("a"), tmp_path / "other")


SCALE = {"NI_Number_Of_Scales": 1, "NI_Scaling_Status": "unscaled", "NI_Scale[0]_Scale_Type": "Reciprocal"}
LINEAR = {
    "NI_Number_Of_Scales": 1,
    "NI_Scale[0]_Scale_Type": "Linear",
    "NI_Scale[0]_Linear_Slope": 2.0,
    "NI_Scale[0]_Linear_Y_Intercept": 1.0,
    "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
}


@pytest.mark.parametrize(
    ("segments", "expected"),
    [
        ([(LINEAR, {})], [1, 3, 5]),
        ([(SCALE | {"NI_Scaling_Status": "scaled"}, {})], [0, 1, 2]),
        ([(SCALE, {})], "channel g/x: its scale is 'Reciprocal'"),
        ([({}, SCALE)], "channel g/x: its scale is 'Reciprocal'"),
        ([(LINEAR, {}), ({"NI_Scale[0]_Linear_Slope": 3.0}, {})], "Slope changes from 2.0 to 3.0 at sample 4"),
        ([({"NI_Scaling_Status": "unscaled"}, {})], "channel g/x: unscaled, and no scale is stated"),
        ([({"NI_Scaling_Status": "unscaled"}, LINEAR)], [1, 3, 5]),
        ([(LINEAR | {"NI_Number_Of_Scales": -1}, {})], "channel g/x: -1 scales, allowed: 0 to 1000"),
        ([(LINEAR | {"NI_Number_Of_Scales": 2**30}, {})], "channel g/x: 1073741824 scales"),
        ([(LINEAR | {"NI_Number_Of_Scales": "one"}, {})], "channel g/x: 'one' scales"),
        ([({**LINEAR, "NI_Scale[0]_Linear_Slope": "steep"}, {})], "channel g/x: its values cannot be read or scaled"),
        ([(LINEAR | {"NI_Number_Of_Scales": 3}, {})], "channel g/x: its values cannot be read or scaled"),
        ([({"unit_string": "g"}, {}), ({"unit_string": "m/s2"}, {})], "unit_string changes from 'g' to 'm/s2'"),
    ],
)
def test_a_tdms_scale_is_applied_or_the_file_is_refused(tmp_path, segments, expected):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        for of_channel, of_group in segments:
            channel = nptdms.ChannelObject("g", "x", np.arange(3, dtype=np.int32), of_channel)
            writer.write_segment([nptdms.GroupObject("g", of_group), channel])
    (tmp_path / "a.tdms_index").write_bytes(b"of an older file")
    if isinstance(expected, list):
        assert taken(tmp_path / "a.tdms", of("g/x")) == expected
    else:
        assert expected in refused(tmp_path / "a.tdms", of("g/x"), tmp_path / "bag")


def daqmx(properties):
    """Bytes of a TDMS file of three 16-bit counts 1, 2, 3 as DAQmx writes them, by NI's description of the format."""

    def text(of):
        return struct.pack("<I", len(of)) + of.encode()

    def stated(name, value):
        kinds = {
            str: (0x20, text),
            int: (3, lambda v: struct.pack("<i", v)),
            float: (10, lambda v: struct.pack("<d", v)),
        }
        kind, write = kinds[type(value)]
        return text(name) + struct.pack("<I", kind) + write(value)

    index = struct.pack("<IIIQI", 0x1269, 0xFFFFFFFF, 1, 3, 1) + struct.pack("<5I", 3, 0, 0, 0, 0)
    index += struct.pack("<II", 1, 2)  # one card, two bytes a sample
    empty = struct.pack("<II", 0xFFFFFFFF, 0)
    own = struct.pack("<I", len(properties)) + b"".join(stated(*one) for one in properties.items())
    metadata = struct.pack("<I", 3) + text("/") + empty + text("/'g'") + empty + text("/'g'/'x'") + index + own
    data = struct.pack("<3h", 1, 2, 3)
    contents = 2 | 4 | 8 | 128  # metadata, new objects, raw data, of DAQmx
    return b"TDSm" + struct.pack("<IIQQ", contents, 4713, len(metadata) + len(data), len(metadata)) + metadata + data


TIMES_TWO = {
    "NI_Scale[1]_Scale_Type": "Linear",
    "NI_Scale[1]_Linear_Slope": 2.0,
    "NI_Scale[1]_Linear_Y_Intercept": 0.0,
    "NI_Scale[1]_Linear_Input_Source": 0,
}
A_NAME = {"NI_Scale[1]_Scale_Type": "AdvancedAPI", "NI_Scale[1]_AdvancedAPI_Input_Source": 0}


@pytest.mark.parametrize(
    ("properties", "expected"),
    [
        ({"NI_Number_Of_Scales": 2, "NI_Scaling_Status": "unscaled", **TIMES_TWO}, [2, 4, 6]),
        ({"NI_Number_Of_Scales": 1, "NI_Scaling_Status": "unscaled"}, "counts of a converter (DAQmx) without a scale"),
        ({"NI_Number_Of_Scales": 2, **A_NAME}, "counts of a converter (DAQmx) without a scale"),
        ({}, "counts of a converter (DAQmx) without a scale"),
    ],
)
def test_counts_of_daqmx_are_scaled_or_refused(tmp_path, properties, expected):
    pytest.importorskip("nptdms")
    (tmp_path / "a.tdms").write_bytes(daqmx(properties))
    if isinstance(expected, list):
        assert taken(tmp_path / "a.tdms", of("g/x")) == expected
    else:
        assert expected in refused(tmp_path / "a.tdms", of("g/x"), tmp_path / "bag")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.array(["5", "6"]), "sample 1, column g/x: '5'"),
        (np.array([True, False]), "bool"),
        (np.array([1j]), "complex"),
        (np.array(["2026-01-01"], "M8[us]"), "column g/x: dates, allowed: numbers"),
        (np.zeros(0), "no sample"),
    ],
)
def test_a_tdms_channel_of_no_numbers_is_refused(tmp_path, values, message):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment([nptdms.ChannelObject("g", "x", values)])
    assert message in refused(tmp_path / "a.tdms", of("g/x"), tmp_path / "bag")


def test_tdms_names_with_slashes_are_told_apart(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment(
            [nptdms.ChannelObject("a/b", "c", np.array([1.0])), nptdms.ChannelObject("a", "b/c", np.array([2.0]))]
        )
    assert "is there 2 times, allowed: /'a" in refused(tmp_path / "a.tdms", of("a/b/c"), tmp_path / "other")
    assert taken(tmp_path / "a.tdms", of("/'a'/'b/c'")) == [2]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_mdf_conversions_groups_and_marks(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    time = np.arange(3) / RATE

    def signal(name, values=(0, 1, 2), **more):
        return asammdf.Signal(np.array(values), time, name=name, **more)

    texts = {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on", "val_2": 2, "text_2": b"lost"}
    with asammdf.MDF(version="4.10") as file:
        shared = [
            signal("status", conversion=texts),
            signal("double", conversion={"formula": "2*X1"}),
            signal("unknown", conversion={"formula": "nonsense(X1)"}),
            signal("text", (b"1", b"2", b"3"), encoding="utf-8"),
            signal("marked"),
        ]
        file.append([*shared, signal("x")], acq_name="front")
        file.groups[0].channels[-2].flags |= 1
        file.append([signal("x", (5, 6, 7))], acq_name="rear")
        file.append([asammdf.Signal(np.zeros(0), np.zeros(0), name="nothing")])
        file.save(tmp_path / "a.mf4")
    for column, expected in {
        "status": "sample 1, column status: 'off'",
        "double": [0, 2, 4],
        "unknown": "its formula 'nonsense(X1)' cannot be evaluated",
        "text": "sample 1, column text: '1'",
        "marked": "sample 1, column marked: marked as invalid",
        "nothing": "no sample",
        "x": "channel x is in 2 groups, allowed: 0/x, 1/x",
        "rear/x": [5, 6, 7],
        "0/x": [0, 1, 2],
        "middle/x": "column middle/x is not there",
    }.items():
        (tmp_path / column).mkdir(parents=True)
        (tmp_path / column / "a.mf4").symlink_to(tmp_path / "a.mf4")
        if isinstance(expected, list):
            assert taken(tmp_path / column / "a.mf4", of(column)) == expected
        else:
            assert expected in refused(tmp_path / column / "a.mf4", of(column), tmp_path / column / "bag")


def subformat(name, valid_bits=16):
    """End of an extensible format: the identifier of what samples are, as the standards write it."""
    return struct.pack("<HHI", 22, valid_bits, 4) + uuid.UUID(name).bytes_le


PCM_NAME = "00000001-0000-0010-8000-00aa00389b71"
PCM = subformat(PCM_NAME)
B_FORMAT_FLOAT = subformat("00000003-0721-11d3-8644-c8c1ca000000", 64)
OTHER = subformat("00000001-0000-0010-8000-00aa00389b72")


def wav(data=b"\1\0\2\0", tag=1, rate=RATE, channels=1, bits=16, size=None, head=b"RIFF", more=b"", wide_format=None):
    """Bytes of a WAV file, field by field."""
    row = channels * bits // 8
    fmt = struct.pack("<HHIIHH", tag, channels, rate, rate * row % 2**32, row, bits)
    fmt += wide_format or b""
    wide = b"ds64" + struct.pack("<IQQQI", 28, 0, len(data), 0, 0) if head in (b"RF64", b"BW64") else b""
    size = (0xFFFFFFFF if wide else len(data)) if size is None else size
    format_chunk = b"fmt " + struct.pack("<I", len(fmt)) + fmt
    content = b"WAVE" + wide + format_chunk + b"data" + struct.pack("<I", size) + data + more
    return head + struct.pack("<I", len(content)) + content


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (wav(), (2, "")),
        (wav(head=b"RF64"), (2, "")),
        (wav(head=b"BW64"), (2, "")),
        (wav(tag=65534, wide_format=PCM), (2, "")),
        (
            wav(tag=65534, wide_format=B_FORMAT_FLOAT, bits=64, data=struct.pack("<dd", 1 / 32768, 2 / 32768)),
            (2, ""),
        ),
        (wav(tag=65534, wide_format=subformat(PCM_NAME, 15)), (2, "the lowest 1 bits of readings are set")),
        (wav(tag=65534, wide_format=subformat(PCM_NAME, 17)), "17 valid bits of 16"),
        (wav(tag=65534, wide_format=OTHER), "format 65534 without the identifier"),
        (wav(tag=65534, wide_format=PCM[:8]), "format 65534 without the identifier"),
        (wav(tag=65534), "format 65534 without the identifier"),
        (wav(more=b"LIST" + struct.pack("<I", 4) + b"note"), (2, "")),
        (wav(size=0xFFFFFFFF), (2, "4294967295 bytes of data in its header, 2 whole rows of 2 bytes are there")),
        (wav(data=b"\1\0\2"), (1, "1 whole rows of 2 bytes are there")),
        (wav(more=b"\1\0" * 20), (2, "40 bytes behind the 4 of the data are no chunk")),
        (wav(size=0), "0 bytes of data, and 4 bytes follow"),
        (wav(data=b""), "no sample"),
        (wav(rate=0), "0 samples per second"),
        (wav(rate=4_000_000_000), "its header says 4000000000 samples per second, allowed: 1 to 1000000000"),
        (wav(channels=0), "0 channels"),
        (wav(tag=7), "format 7, allowed: 1"),
        (wav(tag=3, bits=32, data=struct.pack("<ff", 1, np.nan)), "sample 2, column 1: nan"),
        (wav(more=b"data" + struct.pack("<I", 2) + b"\1\0"), "two data chunks"),
        (wav()[:20], "no data chunk"),
        (b"", "not a WAV file"),
        (wav(head=b"RIFX"), "not a WAV file"),
    ],
)
def test_a_wav_header_is_believed_or_the_file_is_refused(tmp_path, content, expected):
    path = tmp_path / "a.wav"
    path.write_bytes(content)
    point = POINT | {"columns": ["1", None, None], "full_scale": 32768}
    stated = without("rate", points={"shield": point}, time="file", start=START)
    if isinstance(expected, str):
        assert expected in refused(path, stated, tmp_path / "bag")
        return
    samples, warning = expected
    imported = import_recording(path, stated, tmp_path / "bag")
    assert read_acceleration(tmp_path / "bag", TOPIC).values[:, 0].tolist() == [1, 2][:samples]
    assert [warning in text for text in imported.warnings] == [True] * bool(warning)


def test_a_wav_beyond_what_its_header_can_say_is_named(tmp_path):
    path = tmp_path / "a.wav"
    path.write_bytes(wav())
    with path.open("r+b") as file:
        file.truncate(2**32 + 1000)
    point = POINT | {"columns": ["1", None, None], "full_scale": 1}
    imported = import_recording(path, description(points={"shield": point}), tmp_path / "bag")
    assert (
        "bytes behind the 4 of the data are no chunk, and left out: 4294968296 bytes are more than a RIFF"
        in (imported.warnings[0])
    )


def test_empty_lines_end_a_csv_wherever_its_pieces_end(tmp_path, monkeypatch):
    monkeypatch.setattr("tbm_msgs_py.importing.csv_file.PIECE_ROWS", 4)
    for rows in range(1, 10):
        (tmp_path / "a.csv").write_text("a\n" + "5\n" * rows + "\n \n")
        imported = import_recording(tmp_path / "a.csv", of("a"), tmp_path / f"bag{rows}")
        assert imported.streams["shield"].samples == rows
        (tmp_path / "a.csv").write_text("a\n" + "5\n" * rows + "\n5\n")
        assert f"line {rows + 2}: 0 cells" in refused(tmp_path / "a.csv", of("a"), tmp_path / "other")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_byte_order_mark_is_no_part_of_a_name(tmp_path, encoding):
    (tmp_path / "a.csv").write_text("\ufeff" * (encoding == "utf-8") + "a\n5\n", encoding=encoding)
    assert taken(tmp_path / "a.csv", of("a", csv={"encoding": encoding})) == [5]


@pytest.mark.parametrize("encoding", ["hex", "undefined", "utf\0", "punycode", "klingon"])
def test_an_encoding_that_is_none_is_refused(tmp_path, encoding):
    (tmp_path / "a.csv").write_text("a,b\n5,6\n")
    assert "a.csv: encoding " in refused(tmp_path / "a.csv", of("a", csv={"encoding": encoding}), tmp_path / "bag")
