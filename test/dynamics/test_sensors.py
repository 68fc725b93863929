import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from tbm_dynamics.streaming.sensors import GRAVITY, SensorModel, SensorPacket, SensorParameters

INPUT = 10_000
WIRELESS = SensorParameters(
    range=60.0,
    noise_density=0.02,
    quantisation=0.01,
    bias=(0.1, -0.2, 0.3),
    rate_hz=1000,
    anti_alias_hz=400.0,
    clock_offset=0.0123,
    clock_drift=20.0,
    dropout_probability=0.2,
    packet_samples=16,
    mounting_rotation=(10.0, 20.0, 30.0),
    gravity=True,
)
SIGNAL = np.random.default_rng(0).standard_normal((4000, 3)) * 20.0


def model(seed: int = 1, stream_id: str = "cutterhead", **parameters: object) -> SensorModel:
    return SensorModel(SensorParameters.model_validate(parameters), INPUT, seed, stream_id)


def values(packets: list[SensorPacket]) -> np.ndarray:
    return np.concatenate([packet.values for packet in packets])


def test_off_is_plain_decimation():
    sensor = model(rate_hz=2500)
    packets = sensor.process(0, SIGNAL)
    assert [len(packet.time) for packet in packets] == [250] * 4
    np.testing.assert_array_equal(values(packets), SIGNAL[::4])
    assert [packet.stamp_ns for packet in packets] == [0, 100_000_000, 200_000_000, 300_000_000]
    np.testing.assert_allclose(packets[0].time, np.arange(250) / 2500)


def test_samples_lie_on_absolute_steps():
    packets = model(rate_hz=1000, packet_samples=10).process(95, SIGNAL[:200])
    np.testing.assert_array_equal(values(packets), SIGNAL[5:200:10][: len(values(packets))])
    assert packets[0].stamp_ns == 10_000_000
    assert [len(packet.time) for packet in packets] == [10, 10]


@settings(max_examples=30)
@given(
    first=st.integers(0, 10**9),
    cuts=st.lists(st.integers(0, len(SIGNAL)), max_size=8).map(sorted),
)
def test_chunks_do_not_matter(first, cuts):
    whole_sensor, sensor = (SensorModel(WIRELESS, INPUT, 5, "shield") for _ in range(2))
    whole = whole_sensor.process(first, SIGNAL) + whole_sensor.flush()
    pieces = []
    for start, end in zip([0, *cuts], [*cuts, len(SIGNAL)], strict=True):
        pieces += sensor.process(first + start, SIGNAL[start:end])
    pieces += sensor.flush()
    assert [packet.stamp_ns for packet in pieces] == [packet.stamp_ns for packet in whole]
    assert sensor.lost_packets == whole_sensor.lost_packets
    for piece, packet in zip(pieces, whole, strict=True):
        np.testing.assert_array_equal(piece.values, packet.values)
        np.testing.assert_array_equal(piece.time, packet.time)


def test_noise_has_the_density_asked_for_and_is_white():
    noise = values(model(noise_density=0.02, rate_hz=5000).process(0, np.zeros((400_000, 3))))
    _, density = scipy.signal.welch(noise, 5000.0, nperseg=1000, axis=0)
    np.testing.assert_allclose(np.sqrt(density[1:-1].mean(axis=0)), 0.02, rtol=0.01)
    assert np.abs(np.corrcoef(noise.T) - np.eye(3)).max() < 0.02


def test_noise_differs_by_seed_and_sensor():
    def noise(**names) -> np.ndarray:
        return values(model(**names, noise_density=1.0).process(0, np.zeros((10_000, 3))))[:, 0]

    reference = noise()
    np.testing.assert_array_equal(noise(), reference)
    for other in (noise(seed=2), noise(stream_id="shield")):
        assert abs(np.corrcoef(reference, other)[0, 1]) < 0.07


def test_a_sensor_clips_and_rounds():
    seen = values(model(range=10.0, quantisation=0.25).process(0, SIGNAL))
    assert np.abs(seen).max() == 10.0
    np.testing.assert_array_equal(seen, np.round(np.clip(SIGNAL[::2], -10, 10) * 4) / 4)


def test_gravity_is_read_in_the_mounted_axes():
    still = np.zeros((500, 3))
    np.testing.assert_array_equal(values(model(gravity=True).process(0, still)), np.tile(GRAVITY, (250, 1)))
    # Rolled by 90°, the sensor's y axis points up.
    rolled = values(model(gravity=True, mounting_rotation=(90, 0, 0)).process(0, still))
    np.testing.assert_allclose(rolled, np.tile([0.0, 9.80665, 0.0], (250, 1)), atol=1e-12)


def test_mounting_rotation_keeps_lengths_and_yaw_turns_x_into_y():
    turned = values(model(mounting_rotation=(10, 20, 30)).process(0, SIGNAL))
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), np.linalg.norm(SIGNAL[::2], axis=1))
    forward = np.tile([1.0, 0.0, 0.0], (500, 1))
    yawed = values(model(mounting_rotation=(0, 0, 90)).process(0, forward))
    np.testing.assert_allclose(yawed[0], [0.0, -1.0, 0.0], atol=1e-12)


def test_anti_alias_removes_what_would_fold_and_keeps_a_constant():
    time = np.arange(20_000) / INPUT
    tone = np.repeat(np.sin(2 * np.pi * 900.0 * time)[:, None], 3, axis=1) + 5.0
    folded = values(model(rate_hz=1000).process(0, tone))
    clean = values(model(rate_hz=1000, anti_alias_hz=400.0).process(0, tone))
    assert folded.std() == pytest.approx(np.sqrt(0.5), rel=0.01)
    assert clean[250:].std() < 0.005
    assert clean.mean() == pytest.approx(5.0, abs=0.01)


def test_clock_offset_and_drift_show_in_the_stamps():
    packets = model(rate_hz=1000, packet_samples=100, clock_offset=0.5, clock_drift=1000.0).process(0, SIGNAL)
    stamps = [packet.stamp_ns for packet in packets]
    assert stamps == [500_000_000, 600_100_000, 700_200_000, 800_300_000]
    assert packets[0].time[-1] == pytest.approx(0.099 * 1.001)


def test_lost_packets_are_counted_and_come_as_often_as_asked():
    sensor = model(dropout_probability=0.2, rate_hz=1000, packet_samples=10)
    packets = sensor.process(0, np.zeros((200_000, 3)))
    assert len(packets) + sensor.lost_packets == 2000
    assert sensor.lost_packets == pytest.approx(400, abs=5 * np.sqrt(2000 * 0.16))


def test_a_jump_in_steps_sends_the_rest_and_starts_afresh():
    sensor = model(rate_hz=1000, anti_alias_hz=400.0, packet_samples=100)
    assert sensor.process(0, np.full((500, 3), 3.0)) == []
    short, *_ = sensor.process(10_000, np.full((1000, 3), 7.0))
    assert len(short.time) == 50
    np.testing.assert_allclose(short.values, 3.0)
    np.testing.assert_allclose(values(sensor.process(11_000, np.full((1000, 3), 7.0))), 7.0)


@pytest.mark.parametrize(
    "wrong", [{"rate_hz": 3000}, {"anti_alias_hz": 5000.0}, {"rate_hz": 0}, {"range": -1.0}, {"clock": 1.0}]
)
def test_impossible_parameters_are_refused(wrong):
    with pytest.raises(ValueError, match=r"rate_hz|anti_alias_hz|range|clock"):
        model(**wrong)


def test_a_step_larger_than_the_range_is_refused():
    with pytest.raises(ValidationError, match="must not exceed the range"):
        SensorParameters(range=1.0, quantisation=2.0)


def test_bad_input_is_refused():
    with pytest.raises(ValueError, match=r"shape \(n, 3\)"):
        model().process(0, np.zeros(3))
    with pytest.raises(ValueError, match="step 40 holds a value that is not finite"):
        model().process(40, np.full((2, 3), np.nan))
