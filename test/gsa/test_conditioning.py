import numpy as np
import pytest
import scipy.signal
from compared_signals import conditioned, segments
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tbm_gsa.signals.clock import sampling_rate
from tbm_gsa.signals.conditioning import (
    Band,
    ZeroPhaseConditioner,
    causal_conditioner,
    common_band,
    compared_axes,
)

RATE = 1000.0
BAND = Band(0.5, 400.0)
TIME = np.arange(10_000) / RATE


def waves(time: np.ndarray, *frequencies: float) -> np.ndarray:
    return np.column_stack([np.sin(2 * np.pi * f * time) for f in frequencies])


def inner(values: np.ndarray) -> np.ndarray:
    return values[2000:-2000]


def test_the_common_band_is_what_both_rates_carry():
    assert common_band(1000.0, 5000.0) == Band(0.5, 400.0)
    assert common_band(5000.0, 10_000.0) == Band(0.5, 1000.0)
    with pytest.raises(ValueError, match="2 Hz leaves no band"):
        common_band(2.0)


def test_passes_the_band_with_zero_phase_and_stops_the_rest():
    signal = waves(TIME, 50.0, 0.05, 490.0)
    found = inner(conditioned(TIME, signal, RATE, BAND))
    np.testing.assert_allclose(found[:, 0], inner(signal)[:, 0], atol=1e-3)
    assert np.abs(found[:, 1:]).max() < 0.01


def test_gravity_and_drift_go():
    signal = waves(TIME, 50.0, 50.0, 50.0)
    tilted = signal + [9.81, -3.0, 0.0] + TIME[:, None] * [0.0, 0.0, 2.0]
    expected = conditioned(TIME, signal, RATE, BAND)
    np.testing.assert_allclose(conditioned(TIME, tilted, RATE, BAND), expected, atol=1e-8)


def test_gaps_are_not_bridged_and_short_parts_are_left_out():
    kept = (TIME < 3.0) | ((TIME >= 3.5) & (TIME < 4.0)) | (TIME >= 4.2)
    first, second = segments(TIME[kept], waves(TIME[kept], 50.0, 60.0, 70.0), RATE, BAND)
    assert [(part.time[0], len(part.acceleration)) for part in (first, second)] == [(0.0, 3000), (4.2, 5800)]
    alone = conditioned(TIME[:3000], waves(TIME[:3000], 50.0, 60.0, 70.0), RATE, BAND)
    np.testing.assert_array_equal(first.acceleration, alone)


@settings(max_examples=10)
@given(seed=st.integers(0, 100), jitter=st.floats(0.15, 0.4))
def test_jittered_stamps_are_put_on_a_uniform_clock(seed, jitter):
    stamps = TIME + np.random.default_rng(seed).uniform(-jitter, jitter, TIME.size) / RATE
    parts = segments(stamps, waves(stamps, 20.0, 50.0, 100.0), RATE, BAND)
    assert [part.joined for part in parts] == [False]
    expected = waves(parts[0].time, 20.0, 50.0, 100.0)
    np.testing.assert_allclose(inner(parts[0].acceleration), inner(expected), atol=0.01)


def test_a_drifting_clock_is_taken_as_it_is():
    signal = waves(TIME, 50.0, 380.0, 70.0)
    drifting = conditioned(TIME * (1.0 + 50e-6), signal, RATE, BAND)
    np.testing.assert_array_equal(drifting, conditioned(TIME, signal, RATE, BAND))


@pytest.mark.parametrize("rate", [500.0, 700.0])
def test_another_rate_than_the_stamps_say_is_an_error(rate):
    with pytest.raises(ValueError, match="does not fit the stamps, which say 1000 Hz"):
        segments(TIME, np.zeros((TIME.size, 3)), rate, Band(0.5, 200.0))


def test_less_than_a_second_makes_no_segment():
    assert segments(TIME[:999], np.zeros((999, 3)), RATE, BAND) == []


def test_sampling_rate_ignores_gaps():
    kept = np.r_[TIME[:400], TIME[700:1000]]
    assert sampling_rate(kept) == pytest.approx(RATE)
    with pytest.raises(ValueError, match="two samples"):
        sampling_rate([1.0])


@settings(max_examples=20)
@given(cuts=st.lists(st.integers(1000, 9999), max_size=6, unique=True).map(sorted))
def test_live_conditioning_carries_its_state(cuts):
    signal = np.random.default_rng(3).standard_normal((10_000, 3))
    whole, pieces = causal_conditioner(RATE, BAND), causal_conditioner(RATE, BAND)
    # The first batch sets the mean to start from, so it is the same.
    expected = np.concatenate([whole.process(signal[:1000]), whole.process(signal[1000:])])
    parts = [signal[a:b] for a, b in zip([0, 1000, *cuts], [1000, *cuts, 10_000], strict=True) if b > a]
    np.testing.assert_array_equal(np.concatenate([pieces.process(part) for part in parts]), expected)


@pytest.mark.parametrize("frequency", [0.5, 0.8, 3.0, 130.0, 390.0, 400.0, 450.0])
def test_live_and_offline_have_the_same_magnitude(frequency):
    time = np.arange(40_000) / RATE
    signal = waves(time, frequency, frequency, frequency)
    live = causal_conditioner(RATE, BAND).process(signal)[20_000:-5000]
    offline = conditioned(time, signal, RATE, BAND)[20_000:-5000]
    np.testing.assert_allclose(live.std(axis=0), offline.std(axis=0), rtol=2e-3, atol=1e-9)


def test_live_starts_without_a_gravity_transient():
    conditioner = causal_conditioner(RATE, BAND)
    assert np.abs(conditioner.process(np.full((200, 3), 9.81))).max() < 1e-9
    conditioner.reset()
    assert np.abs(conditioner.process(np.full((200, 3), -5.0))).max() < 1e-9


def test_rotating_sensors_compare_a_length_that_turning_keeps():
    assert compared_axes("fixed") == {"x": (0,), "y": (1,), "z": (2,)}
    assert compared_axes("rotating") == {"x": (0,), "yz": (1, 2)}


def test_no_transient_at_the_ends():
    time = TIME[:3127]  # ends near a crest
    found = conditioned(time, 5.0 + waves(time, 130.3, 60.0, 7.0), RATE, BAND)
    assert np.abs(found).max() < 1.15


def test_the_filter_is_scipys():
    # But for the ends, which each continues in its own way.
    time = np.arange(60_000) / RATE
    signal = np.random.default_rng(1).standard_normal((60_000, 3))
    once = np.vstack(
        [
            scipy.signal.butter(2, 0.5, "highpass", fs=RATE, output="sos"),
            scipy.signal.butter(4, 400.0, fs=RATE, output="sos"),
        ]
    )
    expected = scipy.signal.sosfiltfilt(once, scipy.signal.detrend(signal, axis=0), axis=0, padtype="even", padlen=2000)
    inside = slice(15_000, -15_000)
    found = conditioned(time, signal, RATE, BAND)
    np.testing.assert_allclose(found[inside], expected[inside], atol=1e-8)
    np.testing.assert_allclose(found, expected, atol=0.05)


@settings(max_examples=10)
@given(
    cuts=st.lists(st.integers(0, 150_000), max_size=8).map(sorted),
    jitter=st.sampled_from([0.0, 0.3]),
    gap=st.integers(1, 149_000),
)
@example(cuts=[93, 101], jitter=0.3, gap=1)
def test_pieces_give_what_one_filter_gives(cuts, jitter, gap):
    rng = np.random.default_rng(len(cuts))
    time = np.arange(150_000) / RATE + rng.uniform(-jitter, jitter, 150_000) / RATE
    # Gravity that tilts, a wandering mean and noise.
    signal = rng.standard_normal((150_000, 3)) + 1e-2 * rng.standard_normal((150_000, 3)).cumsum(axis=0)
    signal[:, 2] += 9.81 + 0.01 * time
    kept = (np.arange(150_000) < gap) | (np.arange(150_000) >= gap + 100)
    inside = [cut for cut in cuts if cut < kept.sum()]
    pieced = segments(time[kept], signal[kept], RATE, BAND, inside, block=None)
    whole = segments(time[kept], signal[kept], RATE, BAND)
    found, expected = (np.concatenate([part.acceleration for part in parts]) for parts in (pieced, whole))
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, expected, atol=1e-6)  # of a signal of RMS 1
    assert sum(not part.joined for part in pieced) == len(whole)
    stamps = [np.concatenate([part.time for part in parts]) for parts in (pieced, whole)]
    np.testing.assert_allclose(*stamps, atol=1e-3)


def test_blocks_bound_the_memory():
    conditioner = ZeroPhaseConditioner(RATE, BAND)
    for first in range(0, 300_000, 1000):
        time = (first + np.arange(1000)) / RATE
        for segment in conditioner.feed(time, waves(time, 50.0, 60.0, 70.0)):
            assert len(segment.time) <= 31 * RATE
        assert conditioner._count <= (30 + 2 * 10 + 1) * RATE


@pytest.mark.parametrize(("frequency", "share"), [(10.0, 0.5**0.5), (20.0, 1.0), (130.3, 1.0), (300.0, 1.0)])
def test_velocity_is_the_integral(frequency, share):
    time = np.arange(30_000) / RATE
    signal = 9.81 + waves(time, frequency, frequency, frequency)
    (segment,) = segments(time, signal, RATE, BAND)
    expected = share / (2 * np.pi * frequency) * -np.cos(2 * np.pi * frequency * time)
    np.testing.assert_allclose(
        segment.velocity[2000:-2000, 0], expected[2000:-2000], atol=0.004 * np.abs(expected).max()
    )


def test_a_slow_sensor_has_no_velocity():
    conditioner = ZeroPhaseConditioner(20.0, common_band(20.0))
    assert list(conditioner.feed(np.arange(2000) / 20.0, np.ones((2000, 3)))) == []
    (segment,) = conditioner.finish()
    assert segment.velocity is None


def test_a_sampling_rate_that_changes_is_an_error():
    conditioner = ZeroPhaseConditioner(RATE, BAND)
    list(conditioner.feed(TIME, waves(TIME, 50.0, 60.0, 70.0)))
    with pytest.raises(ValueError, match="1000 Hz does not fit the stamps, which say 2000 Hz"):
        list(conditioner.feed(TIME[-1] + TIME[1:] / 2, waves(TIME[1:], 50.0, 60.0, 70.0)))
