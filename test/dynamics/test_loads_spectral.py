import pickle

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from tbm_dynamics.loads.description import LoadDescription
from tbm_dynamics.loads.noise import hashed_generator
from tbm_dynamics.loads.spectral import GRID_BLOCK, GRID_HZ, SpectralLoads, _interpolate

LOW, AXIAL, LATERAL = (0, 10), [(0, 10), (125, 135)], [(0, 20), (100, 110), (200, 210)]
TABLE_1 = {
    "fx": (-1.20e7, "thrust", AXIAL, (0.9, 130.3)),
    "fy": (3.091e4, "torque", LATERAL, (0.9, 106.2, 204.5)),
    "fz": (3.484e4, "torque", AXIAL, (0.9, 130.3)),
    "mx": (-3.04e6, "torque", AXIAL, (0.9, 130.3)),
    "my": (9.77e5, "thrust", AXIAL, (0.9, 130.3)),
    "mz": (8.27e5, "thrust", LATERAL, (0.9, 104.0, 205.7)),
}
DESCRIPTION = LoadDescription.model_validate(
    {
        name: {
            "mean": mean,
            "scales_with": quantity,
            "source": "table1",
            "regions": [{"band": band, "rms": 4e5, "source": "assumed"} for band in bands],
            "lines": [{"frequency": f, "amplitude": 3e5, "source": "assumed"} for f in lines],
        }
        for name, (mean, quantity, bands, lines) in TABLE_1.items()
    }
)
QUIET = LoadDescription.model_validate(
    {name: part.model_copy(update={"lines": ()}).model_dump() for name, part in DESCRIPTION}
)
RATE = 1000.0


@pytest.fixture(scope="module")
def loads() -> SpectralLoads:
    return SpectralLoads(DESCRIPTION, seed=11)


@pytest.fixture(scope="module")
def record(loads) -> np.ndarray:
    """400 s at 1 kHz, (n, 6)."""
    return loads.evaluate(np.arange(400_000) / RATE)


def block_edges() -> st.SearchStrategy[float]:
    seconds = GRID_BLOCK / GRID_HZ
    return st.integers(-2, 3).map(lambda k: k * seconds)


times = st.lists(st.floats(-40.0, 60.0) | block_edges(), min_size=1, max_size=40)


@settings(max_examples=25)
@given(times=times, cut=st.integers(0, 40), data=st.data())
def test_same_bits_in_any_chunks_and_any_order(loads, times, cut, data):
    time = np.array(times)
    whole = loads.evaluate(time)
    order = np.array(data.draw(st.permutations(range(time.size))))
    np.testing.assert_array_equal(loads.evaluate(time[order]), whole[order])
    np.testing.assert_array_equal(np.concatenate([loads.evaluate(time[:cut]), loads.evaluate(time[cut:])]), whole)


def test_live_blocks_and_offline_loads_have_the_same_bits(loads):
    time = 14.9 + np.arange(20_000) * 1e-4  # over the edge of a block
    whole = SpectralLoads(DESCRIPTION, seed=11).evaluate(time)
    for block in (1, 7, 500):
        pieces = [loads.evaluate(time[i : i + block]) for i in range(0, 2000, block)]
        np.testing.assert_array_equal(np.concatenate(pieces)[:2000], whole[:2000])
    copied = pickle.loads(pickle.dumps(loads))
    np.testing.assert_array_equal(copied.evaluate(time), whole)


def test_means_are_means(record):
    deviation = (record - DESCRIPTION.mean).std(axis=0)
    # No power below 0.5 Hz: the mean over T = 400 s misses by far less than white noise of the same band would.
    assert np.all(np.abs(record.mean(axis=0) - DESCRIPTION.mean) < 2e-3 * deviation)


def test_total_power_is_the_described_one(record):
    expected = [component.fluctuation_rms for component in DESCRIPTION.components]
    np.testing.assert_allclose(record.std(axis=0), expected, rtol=0.03)


def test_power_lies_in_the_regions_and_none_below_half_a_hertz():
    values = SpectralLoads(QUIET, seed=3).evaluate(np.arange(400_000) / RATE)
    frequency, density = scipy.signal.welch(values, RATE, "blackmanharris", 65536, detrend=False, axis=0)
    for column, component in enumerate(QUIET.components):
        power = density[:, column] / density[frequency > 0.1, column].sum()
        for region in component.regions:
            low, high = region.filled
            inside = power[(frequency >= low) & (frequency <= high)].sum()
            assert inside == pytest.approx(1.0 / len(component.regions), rel=0.06)
        regions = [(frequency >= r.filled[0]) & (frequency <= r.filled[1]) for r in component.regions]
        assert power[np.any(regions, axis=0)].sum() > 0.999
        assert power[(frequency > 0.1) & (frequency < 0.45)].sum() < 1e-6


def test_lines_are_where_table_1_puts_them(record):
    spectrum = np.abs(np.fft.rfft(record - DESCRIPTION.mean, axis=0)) * 2.0 / len(record)
    frequency = np.fft.rfftfreq(len(record), 1.0 / RATE)
    for column, component in enumerate(DESCRIPTION.components):
        for line in component.lines:
            near = np.abs(frequency - line.frequency) < 2.0
            at = frequency[near][np.argmax(spectrum[near, column])]
            assert abs(at - line.frequency) < 0.01
            assert spectrum[near, column].max() == pytest.approx(line.amplitude, rel=0.15)


def test_a_line_keeps_its_phase_for_months():
    single = {"mean": 0.0, "scales_with": "thrust", "source": "test"}
    line = {"lines": [{"frequency": 130.3, "amplitude": 1.0, "source": "test"}]}
    loads = SpectralLoads(LoadDescription.model_validate(dict.fromkeys(TABLE_1, single) | {"fx": single | line}))
    time = np.arange(0, 0.1, 1e-4)
    near = loads.evaluate(time)[:, 0]
    # 10^7 s is a whole number of periods of 130.3 Hz, up to the rounding of 130.3 and of the times themselves.
    np.testing.assert_allclose(loads.evaluate(time + 1e7)[:, 0], near, atol=1e-4 + 2 * np.pi * 130.3 * 2e-9)


def test_seeds_components_and_distant_windows_are_independent():
    time = np.arange(100_000) / RATE

    def noise(seed: int, start: float) -> np.ndarray:
        return SpectralLoads(QUIET, seed=seed).evaluate(start + time)

    signals = np.hstack([noise(1, 0.0), noise(2, 0.0), noise(1, 1e4), noise(1, -1e6)])
    correlation = np.corrcoef(signals.T) - np.eye(signals.shape[1])
    # About 2 B T = 3000 independent values in 100 s: 5 standard deviations.
    assert np.abs(correlation).max() < 5.0 / np.sqrt(3000.0)


def test_far_times_hold_the_same_statistics(loads):
    values = loads.evaluate(1e7 + np.arange(100_000) / RATE)
    expected = [component.fluctuation_rms for component in DESCRIPTION.components]
    np.testing.assert_allclose(values.std(axis=0), expected, rtol=0.1)


def test_no_jump_where_blocks_meet(loads):
    edge = GRID_BLOCK / GRID_HZ
    before, after = loads.evaluate([np.nextafter(edge, 0.0), edge])
    np.testing.assert_allclose(before, after, rtol=0, atol=1e-6 * 4e5)


def test_interpolation_is_exact_on_the_grid_and_close_between():
    points = np.arange(40) - 3.0
    wave = np.repeat(np.cos(2 * np.pi * 210.0 / GRID_HZ * points)[:, None], 6, axis=1)
    position = np.array([0.0, 5.0, 7.5, 20.25])
    values = _interpolate(wave, position, np.zeros(6), np.ones(6))
    np.testing.assert_array_equal(values[:2], wave[[3, 8]])
    np.testing.assert_allclose(values[:, 0], np.cos(2 * np.pi * 210.0 / GRID_HZ * position), atol=4e-5)


def test_scale_acts_on_mean_and_fluctuation_alike(loads):
    time = np.array([0.3, 17.0])
    scale = DESCRIPTION.scale(thrust_ratio=0.5, torque_ratio=2.0)
    scaled = loads.with_scale(scale)
    np.testing.assert_array_equal(scaled.evaluate(time), scale * loads.evaluate(time))
    np.testing.assert_array_equal(scaled.mean, scale * DESCRIPTION.mean)
    np.testing.assert_array_equal(loads.mean, DESCRIPTION.mean)


@pytest.mark.parametrize("time", [np.nan, np.inf, -np.inf, 1e10])
def test_times_that_are_none_are_refused(loads, time):
    with pytest.raises(ValueError, match="finite and within"):
        loads.evaluate([0.0, time])


def test_arrays_of_other_shapes_are_refused(loads):
    assert loads.evaluate([]).shape == (0, 6)
    with pytest.raises(ValueError, match="shape"):
        loads.evaluate(0.0)
    with pytest.raises(ValueError, match="6 finite factors"):
        loads.with_scale([1.0] * 5)


def test_hashed_generators_differ_by_seed_stream_and_block():
    names = [(0, "a", 0), (1, "a", 0), (0, "b", 0), (0, "a", 1), (0, "a", -1), (-1, "a", 0)]
    draws = {hashed_generator(*name).integers(2**63) for name in names}
    assert len(draws) == len(names)
    assert hashed_generator(5, "a", 7).random() == hashed_generator(5, "a", 7).random()
