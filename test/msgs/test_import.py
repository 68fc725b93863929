"""Import: every value of a file of another system arrives where the description says."""

import csv
import math
import os
import struct
import wave
from datetime import UTC, datetime
from pathlib import Path

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
    SLOW_POINT,
    START,
    START_NS,
    TIME,
    TOPIC,
    VALUES,
    check,
    columns,
    description,
    refused,
    without,
    write_csv,
    write_hdf5,
)

from tbm_msgs_py import Bag, RecordingError, load_mapping, read_acceleration, read_recording
from tbm_msgs_py.bags.definitions import typestore
from tbm_msgs_py.base.operating_point import from_joint_state
from tbm_msgs_py.base.units import STANDARD_GRAVITY
from tbm_msgs_py.importing import describe, import_recording
from tbm_msgs_py.importing.description import same_unit


def test_csv_with_a_rate(tmp_path):
    imported = import_recording(write_csv(tmp_path / "a.csv", columns()), description(), tmp_path / "bag")
    check(read_acceleration(tmp_path / "bag", TOPIC))
    stream = imported.streams["shield"]
    assert (stream.samples, stream.rate_hz, stream.jitter, stream.gaps) == (ROWS, RATE, 0.0, 0)
    assert read_recording(tmp_path / "bag").lost == 0


@pytest.mark.parametrize(("unit", "factor"), [("s", 1), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_csv_with_a_time_column_keeps_gaps_and_jitter(tmp_path, unit, factor):
    time = np.round(TIME + np.random.default_rng(1).uniform(-2e-4, 2e-4, ROWS), 9)
    time[400:] += 0.5
    text = (lambda value: str(round(value))) if unit == "ns" else repr
    rows = columns(t=np.round(time * factor) if unit == "ns" else time * factor)
    path = write_csv(tmp_path / "a.csv", {"t": rows["t"]}, text=text)
    lines = path.read_text().splitlines()
    cells = [",".join(map(repr, map(float, row))) for row in VALUES]
    path.write_text("\n".join([f"{lines[0]},ax,ay,az", *(f"{a},{b}" for a, b in zip(lines[1:], cells, strict=True))]))
    stated = without("rate", points={"shield": POINT}, time={"column": "t", "unit": unit})
    stream = import_recording(path, stated, tmp_path / "bag").streams["shield"]
    record = read_acceleration(tmp_path / "bag", TOPIC)
    check(record, time)
    assert stream.gaps == len(record.gaps) == 1
    assert 0.1 < stream.jitter < 0.5
    assert stream.rate_hz == pytest.approx(RATE, rel=0.05)


def test_a_csv_file_with_dates_is_imported(tmp_path):
    path = tmp_path / "a.csv"
    moments = [datetime.fromtimestamp(START_NS / 1e9 + k / 8, UTC).isoformat() for k in range(20)]
    path.write_text("when,ax,ay,az\n" + "\n".join(f"{moment},{k},0,-{k}" for k, moment in enumerate(moments)))
    stated = describe(None, {"points": {"shield": POINT}, "time": {"column": "when", "unit": "datetime"}})
    import_recording(path, stated, tmp_path / "bag")
    check(read_acceleration(tmp_path / "bag", TOPIC), np.arange(20) / 8, np.outer(np.arange(20), [1, 0, -1]))
    path.write_text("when,ax,ay,az\n2026-03-01T08:00:00,1,2,3\n")
    assert "line 2, column when: '2026-03-01T08:00:00'" in refused(path, stated, tmp_path / "other")


def test_units_axes_and_sensor_go_into_the_mapping(tmp_path):
    point = POINT | {
        "columns": ["ax", None, "az"],
        "units": "g",
        "gravity": "included",
        "frame": "rotating",
        "axes": ["-z", "x", "-y"],
        "range": 2.5,
        "noise_density": 1e-4,
        "resolution": 1e-3,
        "band_hz": [0.5, 900.0],
        "offset": [0.0, 1.2, 0.0],
    }
    stated = description(points={"shield": point})
    imported = import_recording(write_csv(tmp_path / "a.csv", columns()), stated, tmp_path / "bag")
    assert imported.streams["shield"].unmeasured == ["y"]
    record = read_acceleration(tmp_path / "bag", TOPIC)
    x, z = (VALUES[:, k] * STANDARD_GRAVITY for k in (0, 2))
    np.testing.assert_allclose(record.values, np.column_stack([-z, x, 0 * x]), rtol=1e-6)
    assert (record.gravity, record.frame) == ("included", "rotating")
    assert record.clipped == np.count_nonzero((np.abs(VALUES[:, [0, 2]]) >= 2.5).any(axis=1))
    (sensor,) = load_mapping(tmp_path / "bag" / "mapping.yaml").topics.values()
    assert (sensor.band_hz, sensor.offset) == ((0.5, 900.0), (0.0, 1.2, 0.0))
    stated_noise = stated.points["shield"].noise_power_density(8.0)
    assert sensor.noise_power_density(8.0) == pytest.approx(stated_noise, rel=1e-12)
    assert "allowed: a new folder" in refused(tmp_path / "a.csv", stated, tmp_path / "bag.mcap")


def test_a_bare_file_is_all_that_is_written(tmp_path):
    import_recording(write_csv(tmp_path / "a.csv", columns()), description(), tmp_path / "bag.mcap")
    check(read_acceleration(tmp_path / "bag.mcap", TOPIC))
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.csv", "bag.mcap"]


def test_csv_of_a_german_logger(tmp_path):
    path = tmp_path / "a.txt"
    cells = [[f"{value:.17g}".replace(".", ",") for value in row] for row in VALUES]
    lines = ["Messung 1", "ax;ay;az", "g;g;g", *(";".join(row) for row in cells), "", ""]
    path.write_text("\n".join(lines), encoding="latin-1")
    layout = {"delimiter": ";", "decimal": ",", "header": 2, "first": 4, "encoding": "latin-1"}
    import_recording(path, description(csv=layout), tmp_path / "bag")
    check(read_acceleration(tmp_path / "bag", TOPIC))


def test_pieces_join_without_a_seam(tmp_path, monkeypatch):
    path = write_csv(tmp_path / "a.csv", columns(rpm=TIME, torque=TIME, thrust=TIME))
    stated = description(operating_point=OPERATING)
    import_recording(path, stated, tmp_path / "whole")
    monkeypatch.setattr("tbm_msgs_py.importing.csv_file.PIECE_ROWS", 250)
    import_recording(path, stated, tmp_path / "pieces")
    whole, pieces = ([tuple(m) for m in Bag(tmp_path / name).messages()] for name in ("whole", "pieces"))
    assert whole == pieces
    stamps = [m[1] for m in whole]
    assert stamps == sorted(stamps)


REAL = (
    Path(os.environ.get("TBM_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data")) / "tbm2_startup_cycles.csv"
)


@pytest.mark.skipif(not REAL.is_file(), reason=f"{REAL} is not there; TBM_SHARED_DATA names its folder")
def test_imported_operating_points_equal_those_of_the_csv(tmp_path):
    stated = describe(
        None,
        {
            "start": START,
            "time": {"column": "t_s", "unit": "s", "restart_gap": 60},
            "operating_point": {
                "speed": {"column": "rpm", "unit": "r/min"},
                "torque": {"column": "torque_kNm", "unit": "kN.m"},
                "thrust": {"column": "thrust_kN", "unit": "kN"},
                "advance": {"column": "advance_mm_min", "unit": "mm/min"},
            },
        },
    )
    stream = import_recording(REAL, stated, tmp_path / "bag").streams["operating_point"]
    assert (stream.samples, stream.restarts, stream.gaps, stream.rate_hz) == (1300, 19, 19, 1.0)
    found = [(m.log_ns, typestore().deserialize_cdr(m.data, m.topic.type)) for m in Bag(tmp_path / "bag").messages()]
    with REAL.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(found) == 1300
    for index, (row, (log, state)) in enumerate(zip(rows, found, strict=True)):
        point = from_joint_state(state)
        assert point.torque == float(row["torque_kNm"]) * 1e3
        assert point.thrust == float(row["thrust_kN"]) * 1e3
        assert point.speed == pytest.approx(float(row["rpm"]) * 2 * math.pi / 60, rel=1e-15)
        assert point.advance == pytest.approx(float(row["advance_mm_min"]) / 6e4, rel=1e-15)
        cycle, second = divmod(index, 65)
        assert (int(row["t_s"]), log) == (second, START_NS + (cycle * (64 + 60) + second) * 10**9)
    assert "line 67: the time steps back by 64 s" in refused(
        REAL,
        describe(
            None, {"start": START, "time": {"column": "t_s", "unit": "s"}} | {"operating_point": _real_operating()}
        ),
        tmp_path / "other",
    )


def _real_operating():
    names = {"speed": ("rpm", "r/min"), "torque": ("torque_kNm", "kN.m"), "thrust": ("thrust_kN", "kN")}
    return {key: {"column": column, "unit": unit} for key, (column, unit) in names.items()}


def write_tdms(path):
    """Acceleration in two segments, and slow channels of the operating point, the thrust in N."""
    nptdms = pytest.importorskip("nptdms")
    start = np.datetime64("2026-03-01T07:00:00")
    base = {"wf_increment": 1 / RATE, "wf_start_offset": 0.0, "wf_start_time": start, "unit_string": "g"}
    with nptdms.TdmsWriter(path) as writer:
        for piece in (slice(0, 700), slice(700, None)):
            channels = [
                nptdms.ChannelObject("Acc", name, VALUES[piece, k].astype(np.float32 if k else np.float64), base)
                for k, name in enumerate(("X", "Y", "Z"))
            ]
            writer.write_segment(channels)
        slow = {"wf_increment": 0.5, "wf_start_offset": 0.0, "wf_start_time": start}
        units = {"rpm": "1/min", "torque": "kN·m", "thrust": "N"}
        operating = {"rpm": np.arange(4) + 5.0, "torque": np.arange(4) * 10, "thrust": np.full(4, 12_000.0)}
        writer.write_segment(
            [
                nptdms.ChannelObject("PLC", name, data, slow | {"unit_string": units[name]})
                for name, data in operating.items()
            ]
        )


def test_a_tdms_file_is_imported(tmp_path):
    path = tmp_path / "a.tdms"
    write_tdms(path)
    named = {key: entry | {"column": f"PLC/{entry['column']}"} for key, entry in OPERATING.items()}
    stated = describe(
        None,
        {
            "points": {"shield": POINT | {"columns": ["Acc/X", "Acc/Y", "Acc/Z"]}},
            "operating_point": named,
            "time": "file",
            "start": "file",
        },
    )
    imported = import_recording(path, stated, tmp_path / "bag")
    check(read_acceleration(tmp_path / "bag", TOPIC))
    operating = read_recording(tmp_path / "bag").operating_point
    np.testing.assert_allclose(operating.time, [0, 0.5, 1, 1.5])
    assert operating.points[2] == SLOW_POINT
    assert imported.warnings == [
        *(f"{path}: column Acc/{axis}: the file says g, the description m/s2" for axis in "XYZ"),
        f"{path}: column PLC/thrust: the file says N, the description kN",
    ]
    wrong = description(points={"shield": POINT | {"columns": ["Acc/X", "Acc/Y", "PLC/rpm"]}})
    assert "Acc/Y 1700, PLC/rpm 4; allowed" in refused(path, wrong, tmp_path / "other")
    wrong = description(points={"shield": POINT | {"columns": ["Acc/X", "Acc/Q", None]}})
    assert "column Acc/Q is not there, allowed: Acc/X" in refused(path, wrong, tmp_path / "other")


def test_an_mdf_file_is_imported(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "a.mf4"
    with asammdf.MDF(version="4.10") as file:
        file.start_time = datetime(2026, 3, 1, 7, tzinfo=UTC)
        names = zip(("ax", "ay", "az"), VALUES.T, strict=True)
        file.append([asammdf.Signal(data, TIME + 0.25, name=name, unit="m/s2") for name, data in names])
        slow = np.arange(4) * 0.5
        raw = {"rpm": np.arange(4, dtype=np.uint8) + 5, "torque": np.arange(4) * 10.0, "thrust": np.full(4, 12_000)}
        units = {"rpm": "rpm", "torque": "kNm", "thrust": "kN"}
        file.append([asammdf.Signal(data, slow, name=name, unit=units[name]) for name, data in raw.items()])
        file.save(path)
    stated = describe(
        None, {"points": {"shield": POINT}, "operating_point": OPERATING, "time": "file", "start": "file"}
    )
    imported = import_recording(path, stated, tmp_path / "bag")
    assert imported.warnings == []
    check(read_acceleration(tmp_path / "bag", TOPIC), TIME + 0.25)
    assert read_recording(tmp_path / "bag").operating_point.points[2] == SLOW_POINT
    newton = OPERATING | {"thrust": {"column": "thrust", "unit": "N"}}
    stated = describe(None, {"operating_point": newton, "time": "file", "start": "file"})
    warnings = import_recording(path, stated, tmp_path / "newton").warnings
    assert warnings == [f"{path}: column thrust: the file says kN, the description N"]
    wrong = description(points={"shield": POINT | {"columns": ["ax", "ay", "rpm"]}})
    assert "ax and rpm have different times" in refused(path, wrong, tmp_path / "other")
    damaged = tmp_path / "damaged.mf4"
    damaged.write_bytes(path.read_bytes()[:100])
    assert "not an MDF file" in refused(damaged, stated, tmp_path / "other")


def test_mdf_sample_that_its_file_calls_invalid(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "a.mf4"
    with asammdf.MDF(version="4.10") as file:
        bits = np.arange(ROWS) == 41
        file.append([asammdf.Signal(VALUES[:, k], TIME, name=f"a{'xyz'[k]}", invalidation_bits=bits) for k in range(3)])
        file.save(path)
    assert "a.mf4: sample 42, column ax: marked as invalid, allowed: " in refused(path, description(), tmp_path / "bag")


@pytest.mark.parametrize(
    ("label", "unit", "same"),
    [
        ("m/s^2", "m/s2", True),
        ("m·s⁻²", "m/s2", True),
        ("g", "m/s2", False),
        ("KN", "kN", True),
        ("N m", "N.m", True),
        ("kNm", "kN", False),
        ("MN", "MN", True),
        ("mN", "MN", False),
        ("MN·m", "MN.m", True),
        ("mNm", "MN.m", False),
        ("RPM", "r/min", True),
        ("rad/s", "r/min", False),
        ("mm/s", "m/s", False),
    ],
)
def test_a_unit_is_known_however_a_file_writes_it(label, unit, same):
    assert same_unit(label, unit) is same


@pytest.mark.parametrize("width", [1, 2, 3, 4])
def test_wav_of_whole_numbers(tmp_path, width):
    """The file is made by the standard library, bit by bit."""
    path, full = tmp_path / "a.wav", 2 ** (8 * width - 1)
    counts = np.random.default_rng(3).integers(-full, full, (ROWS, 2))
    with wave.open(str(path), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(width)
        file.setframerate(RATE)
        stored = counts + (128 if width == 1 else 0)
        file.writeframes(b"".join(struct.pack("<q", value)[:width] for value in stored.ravel()))
    point = POINT | {"columns": ["2", "1", None], "units": "g", "full_scale": 50}
    stated = without("rate", points={"shield": point}, time="file")
    import_recording(path, stated, tmp_path / "bag")
    expected = counts[:, ::-1] / full * 50 * STANDARD_GRAVITY
    check(read_acceleration(tmp_path / "bag", TOPIC), values=np.column_stack([expected, np.zeros(ROWS)]), ulp=1)
    missing = without("rate", points={"shield": POINT | {"columns": ["1", "2", None]}}, time="file")
    assert "full_scale: missing" in refused(path, missing, tmp_path / "other")
    missing = without("rate", points={"shield": point | {"columns": ["3", "2", None]}}, time="file")
    assert "column 3 is not there, allowed: 1, 2" in refused(path, missing, tmp_path / "other")


def test_a_wav_file_of_floats_is_imported(tmp_path):
    scipy.io.wavfile.write(tmp_path / "a.wav", RATE, VALUES.astype(np.float32))
    point = POINT | {"columns": ["1", "2", "3"], "full_scale": 1}
    import_recording(tmp_path / "a.wav", without("rate", points={"shield": point}, time="file"), tmp_path / "bag")
    check(read_acceleration(tmp_path / "bag", TOPIC))
    (tmp_path / "b.wav").write_bytes(b"RIFF")
    assert "not a WAV file" in refused(tmp_path / "b.wav", description(points={"shield": point}), tmp_path / "other")


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_a_matlab_file_of_each_version_is_imported(tmp_path, version):
    path = tmp_path / "a.mat"
    content = {"acc": VALUES[:, :2], "z": VALUES[:, 2], "log": {"t": TIME, "note": "text"}}
    if version == "5":
        scipy.io.savemat(path, content)
    else:
        write_hdf5(path, content | {"log": {"t": TIME}})
    point = POINT | {"columns": ["acc(:,1)", "acc(:,2)", "z"]}
    stated = without("rate", points={"shield": point}, time={"column": "log.t", "unit": "s"})
    import_recording(path, stated, tmp_path / "bag")
    check(read_acceleration(tmp_path / "bag", TOPIC))
    for name, message in {
        "acc": "a matrix of 1700 x 2, allowed: one of its columns",
        "acc(:,3)": "acc is 1700 x 2",
        "q": "column q is not there, allowed: acc,",
    }.items():
        wrong = description(points={"shield": POINT | {"columns": [name, None, None]}})
        assert message in refused(path, wrong, tmp_path / "other")


def test_description_from_a_file_and_options(tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text("points: {shield: {columns: [a, b, ~], units: g, gravity: removed, frame: fixed}}\nrate: 5\n")
    described = describe(file, {"start": START, "rate": 7.0, "points": {"shield": {"units": "m/s2"}}})
    assert (described.rate, described.points["shield"].columns) == (7.0, ("a", "b", None))
    assert described.points["shield"].units == "m/s2"
    assert described.start_ns == START_NS
    file.write_text("points: [")
    with pytest.raises(RecordingError, match="not YAML"):
        describe(file)


NUMBERS = st.floats(-1e30, 1e30, allow_nan=False)


@settings(max_examples=60)
@given(
    rows=st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=40),
    steps=st.lists(st.integers(1, 10**12), min_size=40, max_size=40),
    delimiter=st.sampled_from([",", ";", "\t", "|"]),
    quoted=st.booleans(),
)
def test_any_csv_comes_back(tmp_path_factory, rows, steps, delimiter, quoted):
    folder = tmp_path_factory.mktemp("csv")
    times = np.cumsum(steps[: len(rows)])
    with (folder / "a.csv").open("w", newline="") as file:
        kind = csv.QUOTE_ALL if quoted else csv.QUOTE_MINIMAL
        writer = csv.writer(file, delimiter=delimiter, quoting=kind)
        writer.writerow(["note", "t", "ax", "ay", "az"])
        writer.writerows([[f"a{delimiter}b", int(t), *map(repr, row)] for t, row in zip(times, rows, strict=True)])
    stated = without("rate", points={"shield": POINT}, time={"column": "t", "unit": "ns"}, csv={"delimiter": delimiter})
    import_recording(folder / "a.csv", stated, folder / "bag")
    record = read_acceleration(folder / "bag", TOPIC)
    assert record.start_ns == START_NS + times[0]
    np.testing.assert_allclose(record.time * 1e9, times - times[0], rtol=1e-12, atol=1)
    np.testing.assert_array_equal(record.values, np.array(rows).astype(np.float32))
