"""Recorded torque and speed of the drives against the model's."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from compare_bags import noise, plc_values, write_bag, write_drives
from scipy.signal import butter, sosfiltfilt

from tbm_dynamics import load_machine, simulate
from tbm_gsa.app.cli.compare import print_tables
from tbm_gsa.app.report.compare_page import compare_page
from tbm_gsa.comparison import ComparisonResult
from tbm_gsa.comparison.drive_moments import DriveBand, DriveMoments, drive_moments
from tbm_gsa.comparison.drive_sides import DriveReducer, field_drives
from tbm_gsa.comparison.drives import compare_drives
from tbm_gsa.comparison.levels import machine_history, recorded_history
from tbm_gsa.comparison.live_drives import LiveDrives
from tbm_gsa.comparison.workflow import compare_recording
from tbm_gsa.signals.settings import Settings
from tbm_msgs_py import OperatingPoint, RecordingError
from tbm_msgs_py.base.drive_state import DriveState
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.recordings.drives import DriveRecord
from tbm_msgs_py.recordings.mapping import DriveMapping
from tbm_msgs_py.recordings.operating import OperatingRecord

DZ101 = load_machine("dz101")
RATIO = DZ101.description.driveshaft.gearbox.ratio
DURATION = 5.0
NAN = math.nan
TORQUE = np.full((800, 10), 32e3)
SPEED = 152 / 16 * 5.6 * math.pi / 30
SENSOR = {"point": "shield", "units": "m/s2", "gravity": "removed", "frame": "fixed"}


def pinion_torques():
    """Torques of the pinions of dz101, (n, p) at 10 kHz: force times base radius."""
    gear = DZ101.description.driveshaft.gear
    radius = 0.5 * gear.module * gear.pinion_teeth * math.cos(math.radians(gear.pressure_angle_deg))
    return simulate(DZ101, DURATION, 0).mesh_force * radius


def held(torque, rate=100.0, *, speed=None, model=32e3, history=None):
    """Recorded torques (n, p) held against constant ones of the model."""
    speed = np.full_like(torque, NAN) if speed is None else speed
    record = DriveRecord(0, np.arange(len(torque)) / rate, torque, speed)
    seconds = round(len(torque) / rate * 1e9)
    field = field_drives(record, DZ101, history or machine_history(DZ101, 0, seconds), None, Settings())
    values = np.hstack([np.ones((400, 10)) * model, np.full((400, 10), SPEED)])
    values = values[:, [k - 1 + side for side in (0, 10) for k in field.numbers]]
    levels = {level: drive_moments(np.arange(400) // 200, values, field.band) for level in field.levels}
    return compare_drives(record, field, levels, DZ101, DriveMapping())


def test_the_models_own_drives_are_found_again(tmp_path):
    """At 20 Hz behind a filter of 3 Hz, which leaves enough of the mesh frequency to be folded back."""
    rate, corner = 20, 3.0
    torque, path = plc_values(pinion_torques(), rate, corner), tmp_path / "bag"
    turning = np.full_like(torque, SPEED)
    write_bag(path, {"shield": noise(DURATION)}, more=lambda one: write_drives(one, torque, rate, speed=turning))
    mapping = {"topics": {"/tbm/field/shield/block": SENSOR}, "drives": {"low_pass_hz": corner}}
    (path / "mapping.yaml").write_text(json.dumps(mapping))
    result = compare_recording(path, model_duration=DURATION).result
    drives = result.drives
    assert (drives.rate_hz, drives.high_hz, drives.low_pass_hz) == pytest.approx((rate, 0.4 * rate, corner))
    assert (drives.window_s, drives.windows, drives.model_windows) == (2.0, 2, 2)
    field, own = drives.field, drives.model
    assert (field.running, own.running) == (10, 10)
    # The begin of the run is left out of the model only.
    assert own.torque == pytest.approx(field.torque, rel=0.01)
    assert own.sharing_factor == pytest.approx(field.sharing_factor, abs=0.01)
    for name, one in drives.drives.items():
        assert one.model.speed == pytest.approx(one.field.speed, rel=0.01), name
    assert own.fluctuation == pytest.approx(field.fluctuation, rel=0.15)
    assert own.scatter == pytest.approx(field.scatter, rel=0.15)
    assert drives.findings == ()
    assert ComparisonResult.model_validate_json(result.model_dump_json()) == result


def test_odd_drives_are_named():
    torque = TORQUE.copy()
    torque[:, 1] *= 1.2
    torque[:, 3] *= -0.01
    running = 32e3 * (np.arange(10) != 7)
    found = held(torque, model=running)
    assert [line.split(",")[0] for line in found.findings] == [
        "drive_2 carries 1.174 of the mean torque",
        "drive_4 is off in the recording",
        "drive_8 runs in the recording",
    ]
    assert (found.field.running, found.model.running) == (9, 9)
    assert found.field.sharing_factor == pytest.approx(1.2 * 9 / 9.2)
    assert found.field.scatter == pytest.approx(torque[0, np.arange(10) != 3].std() / (32e3 * 9.2 / 9))
    assert found.drives["drive_4"].field.share == pytest.approx(-0.01 * 9 / 9.2)


def test_a_drive_without_one_quantity_is_named_and_kept():
    torque, speed = TORQUE.copy(), np.full_like(TORQUE, SPEED)
    torque[:, 4], speed[:, 3] = NAN, NAN
    found = held(torque, speed=speed)
    assert {name: why.split(",")[0] for name, why in found.skipped.items()} == {
        "drive_4": "0% of its speeds are numbers",
        "drive_5": "0% of its torques are numbers",
    }
    assert (found.drives["drive_5"].field.torque, found.drives["drive_4"].field.speed) == (None, None)
    assert found.drives["drive_5"].field.speed == pytest.approx(SPEED)
    assert found.field.torque == pytest.approx(9 * 32e3)
    assert found.model.torque == pytest.approx(9 * 32e3)
    assert found.findings == ()


def test_drives_that_rest_and_speeds_alone_are_said():
    assert held(0.0 * TORQUE).findings == ("no drive carries torque in the recording",)
    alone = held(NAN * TORQUE, speed=np.full_like(TORQUE, SPEED))
    assert (alone.findings, alone.skipped, alone.field.running) == ((), {}, 0)
    assert alone.drives["drive_1"].field.speed == pytest.approx(SPEED)


@pytest.mark.parametrize(
    ("change", "skipped"),
    [
        (lambda torque: torque[:, :8], dict.fromkeys(["drive_9", "drive_10"], "not in the recording")),
        (
            lambda torque: np.hstack([torque, torque[:, :2]]),
            dict.fromkeys(["drive_11", "drive_12"], "machine dz101 has 10 drives"),
        ),
        (
            lambda torque: np.where((np.arange(10) == 4) & (np.arange(800) % 2 == 0)[:, None], NAN, torque),
            {"drive_5": "50% of its torques are numbers, allowed: 90% or more"},
        ),
        (lambda torque: np.where(np.arange(10) == 4, NAN, torque), {"drive_5": "not in the recording"}),
    ],
)
def test_drives_that_are_lacking_are_named(change, skipped):
    found = held(change(TORQUE))
    assert found.skipped == skipped
    assert len(found.drives) == found.field.running == 10 - len(skipped) % 2 - 2 * ("drive_9" in skipped)
    assert found.findings == ()


@pytest.mark.parametrize(
    ("torque", "rate", "problem"),
    [
        (TORQUE * NAN, 100.0, "drive_1: not in the recording; "),
        (TORQUE[:1], 100.0, "a sampling rate needs at least two samples"),
        (np.where(np.arange(10) == np.arange(10)[:, None], NAN, TORQUE[:10]), 100.0, "no time at which every drive"),
    ],
)
def test_drives_that_cannot_be_compared_are_one_line(torque, rate, problem):
    with pytest.raises(InputError, match=problem):
        held(torque, rate)


def test_drives_faster_than_the_model_are_one_line(tmp_path):
    write_bag(tmp_path / "bag", {}, more=lambda writer: write_drives(writer, TORQUE[:40], 20_000))
    with pytest.raises(RecordingError, match="a rate of 20000 Hz, allowed: up to that of the model, 10000 Hz"):
        compare_recording(tmp_path / "bag", model_duration=1.0)


def test_a_record_of_nothing_is_a_doubt_of_the_comparison(tmp_path):
    torque = np.full((4, 10), NAN)
    write_bag(tmp_path / "bag", {"shield": noise(4.0)}, more=lambda writer: write_drives(writer, torque, 1))
    result = compare_recording(tmp_path / "bag", model_duration=1.0).result
    assert result.drives is None
    assert "drives /tbm/field/drives: 4 messages cannot be used: drives: neither efforts nor velocities" in str(
        result.doubts
    )
    assert "drives" not in json.loads(result.model_dump_json())


@pytest.mark.parametrize("dead", [False, True])
def test_drives_alone_are_compared(tmp_path, capsys, dead):
    points = {"shield": np.full((2000, 3), NAN)} if dead else {}
    share = np.array([0.985, 1.03, 0.99, 0.0, 1.0, 1.01, 0.98, 0.0, 1.0, 1.005])
    torque = 32e3 * share * np.random.default_rng(2).normal(1.0, 0.03, (100, 1))
    write_bag(tmp_path / "bag", points, more=lambda writer: write_drives(writer, torque, 10))
    compared = compare_recording(tmp_path / "bag", model_duration=1.0)
    result = compared.result
    assert (result.points, list(result.skipped)) == ({}, ["shield"] if dead else [])
    assert (result.drives.samples, result.recording.duration) == (100, pytest.approx(9.9))
    assert "the run of the model holds no window of 3.1 s" in result.drives.findings[0]
    assert result.drives.field.sharing_factor == pytest.approx(1.03, rel=1e-3)
    assert result.drives.field.correlation == pytest.approx(1.0)
    assert ComparisonResult.model_validate_json(result.model_dump_json()) == result
    with pytest.raises(ValueError, match="points: none, allowed: at least one, or drives"):
        ComparisonResult.model_validate(dict(result) | {"drives": None})
    print_tables(result)
    assert "8 drives run, sharing factor 1.030, lowest share 0.980" in capsys.readouterr().out
    if not dead:
        page = compare_page(compared)
        assert "<h2>Drives</h2>" in page
        assert "Axial acceleration" not in page


def test_a_sensor_and_drives_that_are_both_of_no_use_are_one_line(tmp_path):
    points, torque = {"shield": np.full((2000, 3), NAN)}, TORQUE[:1]
    write_bag(tmp_path / "bag", points, more=lambda writer: write_drives(writer, torque, 10))
    with pytest.raises(RecordingError, match=r"test point shield: .* no finite sample.*; drives .*: not compared: a "):
        compare_recording(tmp_path / "bag", model_duration=1.0)


def test_gaps_and_lost_values_are_counted():
    torque = np.tile(TORQUE, (2, 1))
    torque[100:103, 2] = NAN
    found = held(torque)
    assert (found.samples, found.invalid, found.windows) == (1597, 3, 8)


@pytest.mark.parametrize(
    ("torque", "speed", "texts"),
    [
        (-TORQUE / RATIO, SPEED * RATIO, ["-0.038 of the model's: another sign", "0.038 of", "26.4 times the model's"]),
        (TORQUE / 1e3, SPEED, ["0.001 of the model's: values in kN·m where"]),
        (TORQUE / 1.4, SPEED, []),
    ],
)
def test_units_signs_and_sides_are_said(torque, speed, texts):
    found = held(torque, speed=np.full_like(torque, speed)).findings
    assert len(found) == len(texts)
    for line, text in zip(found, texts, strict=True):
        assert text in line


def test_only_levels_of_operation_are_compared():
    torque = np.concatenate([TORQUE, TORQUE, 0.5 * TORQUE])
    full, half = OperatingPoint(0.59, 3.04e6, 1.2e7), OperatingPoint(0.59, 1.52e6, 1.2e7)
    record = OperatingRecord(0, np.array([0.0, 16.0]), (full, half))
    found = held(torque, history=recorded_history(record, 0, 24_000_000_000))
    assert found.samples == 1600  # 8 s are no level
    assert found.drives["drive_2"].field.torque == pytest.approx(32e3, rel=1e-3)


def live_window(seconds, rate, *, away_ns=0, drives=10):
    """First window of a live stream whose third drive is off, beside a model of 100 Hz that is not."""
    live, period = LiveDrives(DZ101, DriveMapping(), 2.0), round(1e9 / rate)
    found = []
    for stamp in range(0, round(seconds * 1e9), 10_000_000):
        found.append(live.add("model", stamp + away_ns, DriveState((32e3,) * drives, (SPEED,) * drives)))
        if stamp % period == 0:
            wave = 32e3 * (1.0 + 0.1 * math.sin(stamp * 1e-9))
            found.append(live.add("field", stamp, DriveState((wave, wave, 0.0), (NAN,) * 3)))
    return next(filter(None, found))


@pytest.mark.parametrize("rate", [10, 50, 100])
def test_live_drives_are_compared_window_by_window(rate):
    window = live_window(6.0, rate)
    assert (window.begin_ns, window.end_ns) == (0, round(max(2.0, 30 / rate) * 1e9))
    found = window.result
    assert (found.field.running, found.model.running, found.windows, found.model_windows) == (2, 3, 1, 1)
    assert found.findings == ("drive_3 is off in the recording, with 0.00% of the mean, and runs in the model",)
    assert found.skipped.keys() == {f"drive_{number}" for number in range(4, 11)}


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({"away_ns": 10**12}, "no signal of the model in the window"),
        ({"drives": 2}, "the model has 2 drives, allowed: 3 or more"),
    ],
)
def test_live_drives_without_a_model_say_so(given, problem):
    assert live_window(4.0, 50, **given).problem == problem


@pytest.mark.parametrize("rate", [7.0, 100.0, 3000.0])
def test_the_models_samples_do_not_depend_on_the_pieces(rate):
    record = DriveRecord(0, np.arange(200) / rate, TORQUE[:200, :2], TORQUE[:200, :2])
    field = field_drives(record, DZ101, machine_history(DZ101, 0, 10**11), None, Settings())
    time, (numbers,) = np.arange(30_000) / 10_000, np.random.default_rng(3).normal(1.0, 0.1, (1, 30_000, 10))
    angle = np.zeros((30_000, 10, 6))
    angle[:, :, 3] = 0.01 * time[:, None]

    def reduced(*cuts):
        reducer = DriveReducer(DZ101, field, 3.0)
        for part in np.split(np.arange(30_000), cuts):
            chunk = SimpleNamespace(first_step=777 + part[0], mesh_force=numbers[part], displacement=angle[part])
            reducer.feed(chunk)
        return reducer.finish()

    whole, pieces = reduced(), reduced(1, 5, 1234, 29_999)
    assert whole.samples == pieces.samples == pytest.approx(3.0 * rate - max(rate, 2.0 / 0.4), abs=1.0)
    np.testing.assert_allclose(pieces.torque, whole.torque, rtol=1e-12)
    np.testing.assert_allclose(whole.speed, SPEED + 0.01, rtol=1e-6)


def test_moments_are_those_of_numpy():
    rng = np.random.default_rng(5)
    band = DriveBand.of(10.0, None, Settings())
    torque = rng.normal(100.0, 5.0, (93, 3)) + rng.normal(0.0, 3.0, (93, 1))
    speed = rng.normal(5.0, 0.1, (93, 3))
    window = np.repeat([0, 1, 7], 31)
    moments = drive_moments(window, np.hstack([torque, speed]), band)
    assert (moments.samples, moments.windows) == (93, 3)
    parts = np.split(torque, 3)
    np.testing.assert_allclose(moments.covariance, np.mean([np.cov(part.T, ddof=0) for part in parts], axis=0))
    np.testing.assert_allclose(moments.peak_factor, np.mean([part.max(0) / part.mean(0) for part in parts], axis=0))
    joined = DriveMoments.joined({0: moments, 1: moments}, {0: 0.25, 1: 0.75})
    np.testing.assert_allclose(joined.torque, torque.mean(axis=0))
    np.testing.assert_allclose(joined.speed_variance, np.mean([part.var(0) for part in np.split(speed, 3)], axis=0))


def test_the_low_pass_keeps_the_mean_and_the_band():
    band = DriveBand.of(100.0, None, Settings())
    time = np.arange(1000)[:, None] / 100
    values = 7.0 + np.sin(2 * np.pi * 5.0 * time) + np.sin(2 * np.pi * 49.0 * time)
    low = band.low_passed(values)
    assert low.mean() == pytest.approx(7.0, abs=1e-3)
    assert low[100:-100].std() == pytest.approx(math.sqrt(0.5), rel=1e-2)
    expected = sosfiltfilt(butter(4, 40.0, fs=100.0, output="sos"), values, axis=0)
    np.testing.assert_allclose(low[100:-100], expected[100:-100], atol=1e-6)
