"""Import: times are those of the file in a zone that is stated, never in that of this computer, and gaps are kept."""

import struct
import time
import zoneinfo
from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st
from import_files import POINT, START_NS, TOPIC, description, refused, without

from tbm_msgs_py import RecordingError, read_acceleration
from tbm_msgs_py.importing import describe, import_recording
from tbm_msgs_py.importing.moments import moment_ns, zone_of

BERLIN = ZoneInfo("Europe/Berlin")
DATES = {"points": {"shield": POINT}, "time": {"column": "t", "unit": "datetime"}}


@pytest.fixture
def far_away(monkeypatch):
    """Set a time zone of this computer that is none of the tests'."""
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


def write_dates(path, cells):
    path.write_text("t;ax;ay;az\n" + "".join(f"{cell};1;2;3\n" for cell in cells))
    return path


@pytest.mark.parametrize(
    ("cell", "zone", "expected"),
    [
        ("01.03.2026 08:00:00,000", "Europe/Berlin", 0),
        ("1.3.2026 08:00:00,25", "+01:00", 0.25),
        ("2026-03-01T08:00:00", "Europe/Berlin", 0),
        ("2026-03-01 07:00:00.5", "UTC", 0.5),
        ("2026-03-01T08:00:00+01:00", "America/New_York", 0),
        ("2026-03-01T07:00:00.000000001Z", None, 1e-9),
        ("2026-03-01T08:00:00", None, "without its zone, allowed: "),
        ("01.03.2026 08:00:00", None, "without its zone, allowed: "),
        ("2026-03-29 02:30:00", "Europe/Berlin", "clocks of Europe/Berlin show that never"),
        ("2026-10-25 02:30:00", "Europe/Berlin", "clocks of Europe/Berlin show that twice"),
        ("2026-03-01", "UTC", "no date and time"),
        ("03/01/2026 08:00:00", "UTC", "no date and time"),
        ("30.02.2026 08:00:00", "UTC", "day is out of range"),
        ("2026-03-01T25:00:00Z", None, "hour must be in 0..23"),
        ("2026-03-01T08:00:00+25:00", None, "+25:00: no offset"),
        ("\uff12026-03-01T08:00:00Z", None, "no date and time"),
        ("1772348400", "UTC", "no date and time"),
        ("1969-12-31T23:59:59Z", None, "line 2: its time is not after 1970"),
        ("1970-01-01T00:00:00Z", None, "line 2: its time is not after 1970"),
        ("2038-01-19T03:14:08Z", None, "line 2: its time is after January 2038"),
        ("9999-12-31T23:59:59Z", None, "allowed: a time of ROS"),
    ],
)
def test_dates_are_taken_in_their_zone_or_refused(tmp_path, far_away, cell, zone, expected):
    path = write_dates(tmp_path / "a.csv", [cell])
    stated = describe(None, DATES | {"csv": {"delimiter": ";"}} | ({"timezone": zone} if zone else {}))
    if isinstance(expected, str):
        message = refused(path, stated, tmp_path / "bag")
        assert "line 2" in message
        assert expected in message
    else:
        import_recording(path, stated, tmp_path / "bag")
        assert read_acceleration(tmp_path / "bag", TOPIC).start_ns == START_NS + round(expected * 1e9)


@settings(max_examples=60)
@given(
    clock=st.datetimes(datetime(1990, 1, 1), datetime(2037, 1, 1)),
    zone=st.sampled_from(["Europe/Berlin", "America/St_Johns", "Australia/Lord_Howe", "UTC"]),
)
def test_moments_are_those_of_the_standard_library(clock, zone):
    """By its tables, of every moment of UTC: what a clock shows leads back to it, unless it shows that twice."""
    moment = clock.replace(tzinfo=UTC)
    shown = moment.astimezone(ZoneInfo(zone))
    expected = (moment - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000
    text = shown.replace(tzinfo=None).isoformat()
    assert moment_ns(moment.isoformat()) == moment_ns(shown.strftime("%d.%m.%Y %H:%M:%S,%f%z")) == expected
    try:
        assert moment_ns(text, ZoneInfo(zone)) == expected
    except ValueError as error:
        assert "twice" in str(error)
        assert shown.replace(fold=0).utcoffset() != shown.replace(fold=1).utcoffset()


@settings(max_examples=100)
@given(text=st.text("0123456789-+:.,TZ eW", max_size=35))
def test_any_text_is_a_moment_or_one_line(text):
    try:
        moment_ns(text, BERLIN)
    except ValueError as error:
        assert "allowed: " in str(error)


@pytest.mark.parametrize(
    "changes",
    [
        {"timezone": "localtime"},
        {"timezone": "Factory"},
        {"timezone": "../etc/passwd"},
        {"timezone": "Mars/Olympus"},
        {"timezone": "+15:00"},
        {"timezone": 60},
        {"start": 1772348400},
        {"start": "1772348400000"},
        {"start": True},
        {"start": "2026-03-01"},
        {"start": "1969-12-31T23:59:59Z"},
        {"start": "2040-01-01T00:00:00Z"},
        {"start": "2026-10-25T02:30:00", "timezone": "Europe/Berlin"},
    ],
)
def test_a_start_or_a_zone_that_is_guesswork_is_refused(changes):
    with pytest.raises(RecordingError, match=r"start|timezone") as caught:
        description(**changes)
    assert "allowed: " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_start_without_a_zone_is_in_the_stated_one(tmp_path, far_away):
    (tmp_path / "a.csv").write_text("ax,ay,az\n1,2,3\n")
    (tmp_path / "a.yaml").write_text("timezone: Europe/Berlin\nstart: 2026-03-01 08:00:00\n")
    stated = {"points": {"shield": POINT}, "rate": 5}
    assert describe(tmp_path / "a.yaml", stated).start_ns == START_NS
    assert describe(tmp_path / "a.yaml", stated | {"start": "01.03.2026 08:00:00"}).start_ns == START_NS


@pytest.mark.parametrize(
    ("unit", "cells"),
    [
        ("s", ["0", "1e300"]),
        ("s", ["-1e300", "0"]),
        ("s", ["0", "3e9"]),
        ("ms", ["-2e12", "0"]),
        ("ns", ["0", "9223372036854775807"]),
        ("ns", ["0", "99999999999999999999"]),
        ("ns", ["0", "1_0"]),
        ("ns", ["0", "\uff11"]),
    ],
)
def test_a_time_that_ros_does_not_have_is_refused(tmp_path, unit, cells):
    path = write_dates(tmp_path / "a.csv", cells)
    stated = without("rate", points={"shield": POINT}, time={"column": "t", "unit": unit}, csv={"delimiter": ";"})
    assert "a.csv: line " in refused(path, stated, tmp_path / "bag")


@pytest.mark.parametrize("step", [0.001, 60, 7200, 86399, 1e6])
def test_samples_that_are_far_apart_are_read_back(tmp_path, step):
    path = write_dates(tmp_path / "a.csv", [k * step for k in range(100)])
    stated = without("rate", points={"shield": POINT}, time={"column": "t", "unit": "s"}, csv={"delimiter": ";"})
    import_recording(path, stated, tmp_path / "bag")
    assert read_acceleration(tmp_path / "bag", TOPIC).time.tolist() == pytest.approx([k * step for k in range(100)])


MDF_ZONES = [(None, "without its zone"), ("Europe/Berlin", START_NS), ("UTC", START_NS + 3600 * 10**9)]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_mdf_start_in_local_time_needs_its_zone(tmp_path, far_away):
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "a.mf4"
    with asammdf.MDF(version="4.10") as file:
        file.start_time = datetime(2026, 3, 1, 8)
        file.append([asammdf.Signal(np.arange(3.0), np.arange(3) / 8, name=name) for name in POINT["columns"]])
        file.append([asammdf.Signal(np.arange(3.0), np.array([0, np.nan, 1]), name="astray")])
        file.append([asammdf.Signal(np.arange(3.0), np.arange(3) / 8, name="angle")])
        file.groups[2].channels[0].sync_type = 2
        file.save(path)
    for zone, expected in MDF_ZONES:
        stated = {"points": {"shield": POINT}, "time": "file", "start": "file"} | ({"timezone": zone} if zone else {})
        if isinstance(expected, str):
            assert expected in refused(path, describe(None, stated), tmp_path / "bag")
        else:
            import_recording(path, describe(None, stated), tmp_path / zone.replace("/", "_"))
            assert read_acceleration(tmp_path / zone.replace("/", "_"), TOPIC).start_ns == expected
    for column, message in {"astray": "sample 2: its time is ", "angle": "has no times, allowed: a rate"}.items():
        stated = without("rate", points={"shield": POINT | {"columns": [column, None, None]}}, time="file")
        assert message in refused(path, stated, tmp_path / "bag")


RUN = {"wf_increment": 0.125, "wf_start_offset": 0.0, "wf_start_time": np.datetime64("2026-03-01T07:00:00")}
LATER = RUN | {"wf_start_time": np.datetime64("2026-03-01T07:10:00.25")}


@pytest.mark.parametrize(
    ("segments", "changes", "expected"),
    [
        ([(3, RUN), (2, LATER)], {}, [0, 0.125, 0.25, 600.25, 600.375]),
        ([(3, RUN), (2, RUN)], {}, [0, 0.125, 0.25, 0.375, 0.5]),
        ([(3, RUN), (2, LATER | {"wf_increment": 0.5})], {}, [0, 0.125, 0.25, 600.25, 600.75]),
        ([(3, {}), (0, RUN)], {}, [0, 0.125, 0.25]),
        ([(3, LATER), (2, RUN)], {}, "sample 4: the time steps back by 600.5 s"),
        ([(3, RUN), (2, LATER)], {"time": None, "rate": 8}, "channel g/x has 2 runs with a start of their own"),
        ([(3, RUN), (0, LATER)], {}, "a start is stated behind its last sample"),
        ([(3, RUN | {"wf_start_time": np.datetime64("1904-01-01")})], {}, "sample 1: its time is not after 1970"),
        ([(3, RUN | {"wf_increment": "0.125"})], {}, "wf_increment is '0.125'"),
        ([(3, RUN | {"wf_increment": np.nan})], {}, "wf_increment is nan"),
        ([(3, RUN | {"wf_start_time": "01.03.2026 08:00:00"})], {}, "without its zone"),
        ([(3, RUN | {"wf_start_time": "01.03.2026 08:00:00"})], {"timezone": "Europe/Berlin"}, [0, 0.125, 0.25]),
    ],
)
def test_runs_of_a_tdms_file_keep_what_is_between_them(tmp_path, far_away, segments, changes, expected):
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "a.tdms"
    for mode, (samples, stated) in zip("wa", segments, strict=False):
        with nptdms.TdmsWriter(path, mode) as writer:
            writer.write_segment([nptdms.ChannelObject("g", "x", np.arange(float(samples)), stated)])
    described = describe(
        None,
        {"points": {"shield": POINT | {"columns": ["g/x", None, None]}}, "time": "file", "start": "file"} | changes,
    )
    if isinstance(expected, str):
        assert expected in refused(path, described, tmp_path / "bag")
        return
    stream = import_recording(path, described, tmp_path / "bag").streams["shield"]
    record = read_acceleration(tmp_path / "bag", TOPIC)
    assert (record.start_ns, record.time.tolist()) == (START_NS, expected)
    assert (stream.gaps > 0) == (expected[-1] > 1)


def test_a_rate_other_than_that_of_the_file_is_named(tmp_path):
    nptdms, asammdf = pytest.importorskip("nptdms"), pytest.importorskip("asammdf")
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment([nptdms.ChannelObject("g", "1", np.arange(3.0), RUN)])
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(np.arange(3.0), np.arange(3) / 8, name="1")])
        file.save(tmp_path / "a.mf4")
    scipy.io.wavfile.write(tmp_path / "a.wav", 8, np.arange(3, dtype=np.int16))
    for name, column in {"a.tdms": "g/1", "a.mf4": "1", "a.wav": "1"}.items():
        point = POINT | {"columns": [column, None, None], "full_scale": 1}
        for rate, warned in {8.0: [], 50.0: [f"column {column}: the file says 8 Hz, the description 50"]}.items():
            out = tmp_path / f"{name}{rate}"
            warnings = import_recording(tmp_path / name, description(points={"shield": point}, rate=rate), out).warnings
            assert [warning.partition(": ")[2] for warning in warnings] == warned


@pytest.mark.parametrize(
    ("text", "zone", "expected"),
    [
        (b"2026-03-0108:00:00", "Europe/Berlin", START_NS),
        (b"2026-03-0108:00:00", None, "without its zone"),
        (b"2026-02-3008:00:00", "UTC", "in its bext chunk, allowed: a date and a time"),
        (b"\0" * 18, "UTC", "in its bext chunk, allowed: a date and a time"),
        (b"", "UTC", "states no moment"),
    ],
)
def test_the_start_of_a_broadcast_wav_needs_its_zone(tmp_path, far_away, text, zone, expected):
    bext = (b"\0" * 320 + text).ljust(602, b"\0")
    chunks = [(b"bext", bext)] * bool(text) + [
        (b"fmt ", struct.pack("<HHIIHH", 1, 1, 8, 16, 2, 16)),
        (b"data", b"\1\0"),
    ]
    content = b"WAVE" + b"".join(name + struct.pack("<I", len(data)) + data for name, data in chunks)
    (tmp_path / "a.wav").write_bytes(b"RIFF" + struct.pack("<I", len(content)) + content)
    point = POINT | {"columns": ["1", None, None], "full_scale": 1}
    stated = {"points": {"shield": point}, "time": "file", "start": "file"} | ({"timezone": zone} if zone else {})
    if isinstance(expected, str):
        assert expected in refused(tmp_path / "a.wav", describe(None, stated), tmp_path / "bag")
    else:
        import_recording(tmp_path / "a.wav", describe(None, stated), tmp_path / "bag")
        assert read_acceleration(tmp_path / "bag", TOPIC).start_ns == expected


def test_unix_times_after_another_start_are_called_that(tmp_path):
    (tmp_path / "a.csv").write_text("t,ax,ay,az\n1772348400,1,2,3\n1772348401,4,5,6\n")
    stated = {"points": {"shield": POINT}, "time": {"column": "t", "unit": "s"}}
    said = refused(tmp_path / "a.csv", without("rate", **stated), tmp_path / "bag")
    assert said.endswith("counted from 1970 it is 2026-03-01: start: 1970-01-01T00:00:00Z")
    since_1970 = without("rate", **stated, start="1970-01-01T00:00:00Z")
    assert import_recording(tmp_path / "a.csv", since_1970, tmp_path / "bag").warnings == []
    assert read_acceleration(tmp_path / "bag", TOPIC).start_ns == START_NS


def test_rows_that_begin_days_after_the_start_are_said(tmp_path):
    """As days of MATLAB's calendar do that are taken for seconds."""
    (tmp_path / "a.csv").write_text("t,ax,ay,az\n739676.5,1,2,3\n739676.6,4,5,6\n")
    stated = without("rate", points={"shield": POINT}, time={"column": "t", "unit": "s"})
    imported = import_recording(tmp_path / "a.csv", stated, tmp_path / "bag")
    assert imported.warnings == [
        f"{tmp_path / 'a.csv'}: line 2: its time is 8.56 days after the start, counted from there"
    ]


def test_zones_are_known_where_the_system_has_none():
    """As in a slim container: by the package of zones, which is a dependency."""
    zoneinfo.reset_tzpath(to=[])
    ZoneInfo.clear_cache()
    try:
        assert moment_ns("01.03.2026 08:00:00", zone_of("Europe/Berlin")) == START_NS
    finally:
        zoneinfo.reset_tzpath()
        ZoneInfo.clear_cache()
