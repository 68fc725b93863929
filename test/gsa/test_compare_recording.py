"""From a recording on disk to the document, with a bag made of the model's own accelerations."""

import json
from functools import reduce

import numpy as np
import pytest
from compare_bags import RATE, START_NS, G, model_values, noise, write_bag
from pydantic import TypeAdapter

from tbm_dynamics import MachineError, load_machine
from tbm_gsa.app.cli.bag.info import info
from tbm_gsa.app.cli.compare import print_tables
from tbm_gsa.comparison import ComparisonResult, Settings
from tbm_gsa.comparison.workflow import compare_recording
from tbm_gsa.explanation.workflow import compared_machine
from tbm_gsa.reading import validated
from tbm_msgs_py import ACCELERATION, OperatingPoint, RecordingError
from tbm_msgs_py.bags.metadata import SYNTHETIC
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.files import json_text
from tbm_msgs_py.recordings.recording_health import COUNTS

SHORT = {"model_duration": 2.0}


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """The model's accelerations, as they are, scaled, and of other loads."""
    same, other = model_values(seed=0), model_values(seed=7)
    points = {"cutterhead": same["cutterhead"], "shield": 0.5 * same["shield"], "gripper": other["gripper"]}
    path = write_bag(tmp_path_factory.mktemp("own") / "bag", points, rate=10_000, custom_data=SYNTHETIC)
    return compare_recording(path, model_duration=10.0, seed=0).result


def errors(result, point):
    return [axis.relative_error for axis in result.points[point].values()]


def test_the_models_own_recording_has_no_error(own):
    assert errors(own, "cutterhead") == pytest.approx([0.0, 0.0, 0.0], abs=1e-4)


def test_a_sensor_off_its_node_is_compared_there(tmp_path, capsys):
    placed = load_machine("dz101").with_offsets({"shield": (0.0, 1.5, 0.5)})
    bag = write_bag(tmp_path / "bag", {"shield": model_values(0, 2.0, placed)["shield"]}, rate=10_000)
    sensor = {"point": "shield", "units": "m/s2", "gravity": "removed", "frame": "fixed", "offset": [0, 1.5, 0.5]}
    (bag / "mapping.yaml").write_text(json.dumps({"topics": {"/tbm/field/shield/block": sensor}}))
    result = compare_recording(bag, **SHORT).result
    assert errors(result, "shield") == pytest.approx([0.0, 0.0, 0.0], abs=1e-4)
    assert result.offsets == {"shield": (0.0, 1.5, 0.5)}
    print_tables(result)
    assert "sensors off their node: shield by (0, 1.5, 0.5) m" in capsys.readouterr().out
    assert ComparisonResult.model_validate_json(result.model_dump_json()) == result
    assert compared_machine(result).description.sensor_places == placed.description.sensor_places


def test_half_the_model_errs_by_one(own):
    assert errors(own, "shield") == pytest.approx([1.0, 1.0, 1.0], abs=1e-3)


def test_every_window_is_held_against_the_whole_model_run(own):
    axis = own.points["shield"]["y"]
    expected = [abs(field - axis.model_rms) / field for field in axis.windows.field_rms]
    assert axis.windows.relative_error == pytest.approx(expected)
    assert len(expected) == 5


def test_other_loads_err_by_the_ratio_of_their_levels(own):
    # Nearly all power lies in the compared band, so the plain standard deviations give the same ratio within 5 %.
    same, other = (model_values(seed=seed)["gripper"].std(axis=0) for seed in (0, 7))
    assert errors(own, "gripper") == pytest.approx(np.abs(other - same) / other, abs=0.05)


def test_the_document_follows_the_contract(own):
    document = json.loads(own.model_dump_json())
    assert list(document["points"]) == ["cutterhead", "shield", "gripper"]
    assert {"field_rms", "model_rms", "relative_error", "coverage", "windows"} <= set(
        document["points"]["gripper"]["x"]
    )
    recording = document["recording"]
    keys = {"path", "messages", "lost", "truncated", "damaged", "sha256", "begin", "duration", "points"}
    assert keys == set(recording)
    assert (recording["messages"], recording["lost"], recording["truncated"]) == (60, 0, False)
    assert recording["duration"] == pytest.approx(10.0, abs=0.01)
    assert {"topic", "gaps", "clipped", "duplicates", "invalid"} <= set(recording["points"]["shield"])
    assert (document["machine"], document["seed"], document["model_duration"]) == ("dz101", 0, 10.0)
    assert document["nodes"] == {"cutterhead": 3, "shield": 43, "gripper": 50}
    assert document["synthetic"] is True
    assert document["operating_point"]["source"] == "machine"
    assert {"python", "numpy"} <= set(document["versions"])


def test_a_result_is_read_back_as_it_was_written(own):
    assert ComparisonResult.model_validate_json(own.model_dump_json()) == own
    assert ComparisonResult.model_validate_json(json_text(own.model_dump(), indent=2)) == own


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("confidence", 2.0, "confidence: 2.0, allowed: less than 1"),
        ("machine", None, "machine: None, allowed: a "),
        ("points.shield.x.field_rms", 1e31, r"points.shield.x.field_rms: 1e\+31, allowed: less than or equal to 10"),
        ("points.shield.x.model_band_rms", {}, "points.shield.x: other bands of the field than of the model"),
        ("bands", {}, "bands: other test points than in points"),
        ("points", {}, "bands: other test points than in points"),
        ("spectra", {}, "spectra: other test points than in points"),
    ],
)
def test_what_is_no_result_is_one_line(own, path, value, message):
    document = json.loads(own.model_dump_json())
    *parents, key = path.split(".")
    reduce(dict.get, parents, document)[key] = value
    with pytest.raises(InputError, match=message) as caught:
        validated(TypeAdapter(ComparisonResult), json.dumps(document), "document", InputError)
    assert "\n" not in str(caught.value)


def test_the_rows_of_table_2(own):
    head, shield, _ = own.axial_rows
    assert (head.point, head.node) == ("cutterhead", 3)
    assert head.predicted_g == pytest.approx(own.points["cutterhead"]["x"].model_rms / G)
    assert shield.measured_g == pytest.approx(shield.predicted_g / 2.0, rel=1e-3)


def test_expected_lines_are_the_machines(own):
    lines = {line.name: line.frequency_hz for line in own.expected_lines}
    assert lines["load line 130.3 Hz"] == 130.3
    assert lines["mesh frequency"] == pytest.approx(152 * 5.6 / 60)
    assert lines["2 × mesh frequency"] == pytest.approx(2 * 152 * 5.6 / 60)
    axial = lines["axial natural frequency A1"]
    assert np.abs(load_machine("dz101").assemble().natural_frequencies() - axial).min() < 1e-9
    assert own.points["cutterhead"]["x"].field_lines[0].match == "load line 130.3 Hz"


def test_a_known_sine_has_its_rms(tmp_path):
    time = np.arange(4 * RATE) / RATE
    sine = np.sin(2 * np.pi * 130.3 * time)[:, None] * [2.0, 1.0, 4.0]
    path = write_bag(tmp_path / "bag", {"girder": sine})
    (path / "README.md").write_text("Not a synthetic recording.\n")
    result = compare_recording(path, **SHORT).result
    axes = result.points["girder"]
    assert [axes[axis].field_rms for axis in "xyz"] == pytest.approx(np.array([2.0, 1.0, 4.0]) / np.sqrt(2), rel=5e-3)
    assert "synthetic" not in result.model_dump()


def test_the_recorded_operating_point_is_used(tmp_path):
    def level(name, *entries):
        points = [(at, OperatingPoint(speed, torque, 1.0e7)) for at, speed, torque in entries]
        path = write_bag(tmp_path / name, {"shield": noise(4.0)}, operating=points)
        result = compare_recording(path, **SHORT).result
        return result.operating_point, list(result.points["shield"]["x"].field_band_rms)

    one, bands = level("one", (0.0, 0.5, 2.0e6))
    assert one.source == "recording"
    assert one.speed_r_min == pytest.approx(0.5 * 30 / np.pi)
    assert (one.torque_kn_m, one.thrust_kn) == pytest.approx((2000.0, 10000.0))
    # The first entry is older than the recording and holds for 1 s of it, the second for 1 s, the third to the end.
    several, _ = level("several", (-100.0, 0.5, 2.0e6), (1.0, 0.5, 4.0e6), (2.0, 0.0, 0.0), (3.0, 0.5, 6.0e6))
    assert several.torque_kn_m == pytest.approx(4000.0, rel=1e-3)
    # The stages mesh at 0.853 of 76.26 and 361.3 Hz.
    assert bands == ["0.5-20_hz", "58-72_hz", "100-110_hz", "125-135_hz", "200-210_hz", "277-341_hz"]
    assert several.note == "never steady for 10 s: time-weighted mean of 3 stretches"


def test_a_machine_that_never_turned_is_an_error(tmp_path):
    path = write_bag(tmp_path / "bag", {"shield": noise(4.0)}, operating=[(0.0, OperatingPoint(0.0, 0.0, 0.0))])
    with pytest.raises(
        RecordingError, match=r"bag: operating point: never driven, allowed: positive .* at most 0 r/min, 0 kN·m, 0 kN"
    ):
        compare_recording(path, **SHORT)


def test_a_level_scales_the_model(tmp_path):
    path = write_bag(
        tmp_path / "bag", {"cutterhead": noise(4.0)}, operating=[(0.0, OperatingPoint(0.586, 3.04e6, 1.8e7))]
    )
    bare = write_bag(tmp_path / "bare", {"cutterhead": noise(4.0)})
    more, own = (compare_recording(bag, **SHORT).result.points["cutterhead"]["x"] for bag in (path, bare))
    assert more.model_rms == pytest.approx(1.5 * own.model_rms, rel=0.02)


def test_points_that_cannot_be_compared_are_named(tmp_path):
    path = write_bag(tmp_path / "bag", {"shield": noise(4.0), "belt": noise(4.0), "gripper": noise(0.5)})
    result = compare_recording(path, **SHORT).result
    assert list(result.points) == ["shield"]
    assert result.skipped == {
        "belt": "machine dz101 has no such test point",
        "gripper": "no stretch of 1 s without a gap at 2000 Hz; 1000 samples in 0.4995 s, 2000 Hz on average",
    }
    assert set(result.recording.points) == {"shield", "belt", "gripper"}


def test_a_turning_sensor_compares_across(tmp_path):
    path = write_bag(tmp_path / "bag", {"cutterhead": noise(4.0)})
    mapping = tmp_path / "turning.yaml"
    sensor = "{point: cutterhead, units: m/s2, gravity: removed, frame: rotating}"
    mapping.write_text(f"topics:\n  /tbm/field/cutterhead/block: {sensor}\n")
    assert list(compare_recording(path, mapping=mapping, **SHORT).result.points["cutterhead"]) == ["x", "yz"]


def test_what_cannot_be_compared_is_one_line(tmp_path):
    with BagWriter(tmp_path / "empty"):
        pass
    belt, dead = (write_bag(tmp_path / name, {name: noise(0.5)}) for name in ("belt", "shield"))
    with BagWriter(tmp_path / "unmapped") as writer:
        writer.write_operating_point(START_NS, OperatingPoint(0.5, 3e6, 1e7))
    for path, message in (
        (tmp_path / "nowhere", "no such file or folder"),
        (tmp_path / "empty", "no message could be read"),
        (tmp_path / "unmapped", "no topic of the mapping is in the recording"),
        (belt, "'belt': none is one of machine dz101, allowed: cutterhead"),
        (dead, "test point shield: no stretch of 1 s"),
    ):
        with pytest.raises(RecordingError, match=message) as caught:
            compare_recording(path, **SHORT)
        assert "\n" not in str(caught.value)
        assert str(path) in str(caught.value)


@pytest.mark.parametrize("duration", [0.0, -1.0, 0.5, 3601.0, float("nan")])
def test_lengths_of_the_model_run_are_bounded(duration):
    with pytest.raises(ValueError, match=r"model_duration .* allowed: 1 to 3600 s"):
        compare_recording("nowhere", model_duration=duration)


@pytest.mark.parametrize("window", [0.0, -2.0, 1e-9, 1e300, float("nan"), float("inf")])
def test_lengths_of_windows_are_bounded(window):
    with pytest.raises(ValueError, match=r"window .* allowed: 0.01 to 86400 s"):
        compare_recording("nowhere", settings=Settings(window_s=window))


def test_an_unknown_machine_is_named():
    with pytest.raises(MachineError, match="dz999"):
        compare_recording("nowhere", "dz999")


def test_it_says_of_the_sensors_what_bag_info_says(tmp_path, monkeypatch, capsys):
    """Three pieces; the second rate is another, the clock drifts, and the shield ends in values that are no numbers."""
    monkeypatch.setattr("tbm_msgs_py.bags.mcap_file.WINDOW", 1 << 14)  # the bad end is read after the last good piece
    random, stamp = np.random.default_rng(5), START_NS
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(300):
            step = 5_000_000 if k < 120 else 5_050_000  # ns
            values = random.standard_normal((100, 3))
            late = round((stamp - START_NS) * -30e-6 + random.exponential(2e6))
            for point, rows in {"girder": values, "shield": values if k < 237 else np.nan * values}.items():
                topic = f"/tbm/field/{point}/block"
                writer.write_block(topic, stamp, ACCELERATION, np.arange(100) * step * 1e-9, rows, log_ns=stamp + late)
            writer.flush()
            stamp += 100 * step
    info(tmp_path / "bag", scan=True, mapping=None, json=True)
    said = json.loads(capsys.readouterr().out)["points"]
    recorded = compare_recording(tmp_path / "bag", **SHORT).result.recording.points
    shared = {"topic", "samples", "rate_hz", "clock_offset", "clock_drift", *COUNTS}
    for point in ("girder", "shield"):
        assert {key: said[point][key] for key in shared} == recorded[point].model_dump(include=shared)
        assert said[point]["gaps"] == len(recorded[point].gaps)
    assert said["shield"]["invalid"] == 6300
