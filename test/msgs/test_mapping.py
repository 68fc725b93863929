"""Mappings: axes, units and rotations are applied as stated, and a bad file names its key."""

import numpy as np
import pytest
from bag_files import write_accel
from sample_bag import START_NS

from tbm_msgs_py import BagWriter, RecordingError, SensorMapping, load_mapping, read_acceleration, read_recording
from tbm_msgs_py.recordings.mapping import contract_mapping

STATED = {"point": "girder", "units": "m/s2", "gravity": "removed", "frame": "fixed"}

FILE = """
topics:
  /imu:
    point: girder
    units: g
    gravity: included
    frame: rotating
    axes: ["-z", x, "-y"]
    range: 3.0
"""


@pytest.fixture
def bag(tmp_path):
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        for k in range(4):
            write_accel(writer, "/imu", START_NS + k * 10**6, (1.0, 2.0, float(k)))
    return path


def test_mapping_in_the_folder_is_the_default(bag):
    (bag / "mapping.yaml").write_text(FILE)
    record = read_recording(bag).points["girder"]
    np.testing.assert_allclose(record.values[3], 9.80665 * np.array([-3.0, 1.0, -2.0]))
    assert (record.gravity, record.frame, record.clipped) == ("included", "rotating", 1)
    assert read_acceleration(bag, "/imu").point == "girder"


def test_mapping_beside_the_folder_is_the_default(bag):
    (bag.parent / "mapping.yaml").write_text(FILE)
    assert set(read_recording(bag).points) == {"girder"}


def test_rotation_is_roll_pitch_yaw_in_the_machine():
    yaw = SensorMapping(**STATED, rotation=(0, 0, 90)).matrix()
    np.testing.assert_allclose(yaw @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    pitch = SensorMapping(**STATED, rotation=(0, 90, 0)).matrix()
    np.testing.assert_allclose(pitch @ [1, 0, 0], [0, 0, -1], atol=1e-12)
    general = SensorMapping(**STATED, rotation=(10, 20, 30)).matrix()
    np.testing.assert_allclose(general @ general.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(("units", "scale"), [("g", 9.80665), ("m/s2", 1.0)])
def test_noise_is_that_of_the_sensor_and_of_rounding(units, scale):
    sensor = SensorMapping(**{**STATED, "units": units}, noise_density=1e-4, resolution=1e-3)
    values = np.random.default_rng(1).uniform(-1.0, 1.0, 100_000)
    rounding = np.var(np.round(values / 1e-3) * 1e-3 - values) / 2500.0  # at 5000 Hz
    np.testing.assert_allclose(sensor.noise_power_density(5000.0), scale**2 * (1e-8 + rounding), rtol=1e-3)
    assert SensorMapping(**STATED, resolution=1e-3).noise_power_density(5000.0) is None


def test_block_goes_before_single_samples():
    chosen = contract_mapping(
        ["/tbm/field/shield/accel", "/tbm/field/shield/block", "/other", "/tbm/field/girder/accel"]
    )
    assert set(chosen.topics) == {"/tbm/field/shield/block", "/tbm/field/girder/accel"}


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("units: g", "units: mg", "units"),
        ("    units: g\n", "", "units"),
        ("gravity: included", "gravity: maybe", "gravity"),
        ('"-z"', "x", "axes"),
        ("range: 3.0", "range: -1", "range"),
        ("range: 3.0", "noise_density: -1", "noise_density"),
        ("range: 3.0", "range: 3.0\n    resolution: 4.0", "resolution"),
        ("range: 3.0", "band_hz: [20, 5]", "band_hz.*lower limit first"),
        ("range: 3.0", "offset: [0, .nan, 1]", "offset"),
        ("range: 3.0", "colour: red", "colour"),
        ("topics:", "topics: [", "YAML"),
        ("    units: g", "\tunits: g", "a tab, where lines begin with spaces"),
    ],
)
def test_bad_mapping_is_one_line_with_the_key(tmp_path, old, new, named):
    file = tmp_path / "mapping.yaml"
    file.write_text(FILE.replace(old, new))
    with pytest.raises(RecordingError, match=named) as caught:
        load_mapping(file)
    assert "\n" not in str(caught.value)
    assert str(file) in str(caught.value)
    assert "allowed: " in str(caught.value)


def test_missing_mapping_is_one_line(tmp_path):
    with pytest.raises(RecordingError, match="No such file"):
        load_mapping(tmp_path / "none.yaml")


def test_two_topics_of_one_point_are_refused(tmp_path):
    file = tmp_path / "mapping.yaml"
    file.write_text(FILE + FILE.split("topics:\n")[1].replace("/imu", "/imu2"))
    with pytest.raises(RecordingError, match="point girder: 2 topics, allowed: one"):
        load_mapping(file)
