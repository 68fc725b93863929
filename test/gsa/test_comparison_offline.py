import numpy as np
import pytest
import scipy.signal
import scipy.stats
from compared_signals import compared, conditioned, reduced, uniform

from tbm_gsa.comparison import Settings
from tbm_gsa.signals.conditioning import common_band
from tbm_msgs_py.base.units import STANDARD_GRAVITY as G

UPWARDS = np.array([0.0, 0.0, G])
RNG = np.random.default_rng(5)
FIELD_RATE, MODEL_RATE, DURATION = 1000.0, 5000.0, 30.0
ROUNDED = 1e-7  # columns of a result have eight digits


def record(values: np.ndarray, start: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    return uniform(values, FIELD_RATE, start)


def vibration(rate: float, amplitudes: tuple[float, float, float], mean: np.ndarray | float = 0.0) -> np.ndarray:
    time = np.arange(round(DURATION * rate)) / rate
    return np.sin(2 * np.pi * 130.3 * time)[:, None] * amplitudes + mean


def computed(amplitudes: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    return uniform(vibration(MODEL_RATE, amplitudes), MODEL_RATE)


@pytest.fixture(scope="module")
def point():
    field = record(vibration(FIELD_RATE, (2.0, 1.0, 4.0), UPWARDS), start=1.7e9)
    return compared(
        field, computed((1.0, 1.5, 4.0)), settings=Settings(bands=((125.0, 135.0),), expected_lines={"load": 130.3})
    )


def test_levels_and_equation_4(point):
    axes = point.axes
    assert [axes[a].field_rms for a in "xyz"] == pytest.approx(np.array([2.0, 1.0, 4.0]) / np.sqrt(2), rel=2e-3)
    assert [axes[a].relative_error for a in "xyz"] == pytest.approx([0.5, 0.5, 0.0], abs=5e-3)
    assert axes["x"].field_crest_factor == pytest.approx(np.sqrt(2), rel=0.07)  # the mirrored ends overshoot a little
    assert axes["x"].model_kurtosis == pytest.approx(1.5, rel=0.01)
    assert axes["x"].field_band_rms["125-135_hz"] == pytest.approx(np.sqrt(2), rel=5e-3)


def test_the_strongest_line_is_found_in_both_spectra(point):
    axis, spectra = point.axes["x"], point.spectra["x"]
    for (strongest, *_), spectrum in ((axis.field_lines, spectra.field), (axis.model_lines, spectra.model)):
        assert strongest.frequency_hz == pytest.approx(130.3, abs=0.25)
        assert strongest.match == "load"
        assert (len(spectrum.density) - 1) * spectrum.resolution_hz == pytest.approx(400.0)
    assert point.band.high_hz == pytest.approx(400.0)


def test_every_window_is_compared(point):
    windows = point.axes["x"].windows
    assert windows.start == tuple(2.0 * i for i in range(15))
    np.testing.assert_allclose(windows.field_rms, np.sqrt(2), rtol=0.02)
    np.testing.assert_allclose(windows.relative_error, 0.5, atol=0.02)
    np.testing.assert_array_equal(windows.coverage, 1.0)


def test_gaps_lower_the_coverage_of_their_windows_only():
    time, values = record(vibration(FIELD_RATE, (2.0, 1.0, 4.0)))
    kept = (time < 10.5) | (time >= 11.5)
    axis = compared((time[kept], values[kept]), computed((2.0, 1.0, 4.0))).axes["x"]
    assert axis.coverage == pytest.approx(29.0 / 30.0)
    expected = np.ones(15)
    expected[5] = 0.5
    np.testing.assert_allclose(axis.windows.coverage, expected, atol=2e-3)
    np.testing.assert_allclose(axis.windows.relative_error, 0.0, atol=0.03)


def test_windows_without_samples_cost_nothing():
    """Three bursts in sixty days: as many rows as windows that hold samples, at their exact times."""
    days = 86_400.0 * np.array([0.0, 29.0, 60.0])
    time, values = record(vibration(FIELD_RATE, (2.0, 1.0, 4.0))[:12_000])
    time = np.concatenate([begin + time[:4000] for begin in days])
    field = reduced(time, values, FIELD_RATE, common_band(FIELD_RATE), "fixed", Settings(window_s=0.25))
    assert field.windows.index.shape == field.level.shape == (48,)
    found = compared((time, values), computed((1.0, 1.0, 1.0)), settings=Settings(window_s=0.25)).axes["x"].windows
    assert {len(column) for column in vars(found).values() if isinstance(column, tuple)} == {48}
    assert found.start == tuple(begin + 0.25 * k for begin in days for k in range(16))
    assert min(found.coverage) == 1.0


def test_a_shorter_model_run_gives_every_window_an_error():
    time, values = computed((1.0, 1.0, 1.0))
    found = compared(record(vibration(FIELD_RATE, (1.0, 1.0, 1.0))), (time[:50_000], values[:50_000]))
    np.testing.assert_allclose(found.axes["y"].windows.relative_error, np.zeros(15), atol=0.03)


def test_a_turning_sensor_compares_the_length_of_y_and_z():
    values = RNG.standard_normal((round(DURATION * FIELD_RATE), 3))
    angle = 2 * np.pi * 5.6 / 60 * np.arange(len(values)) / FIELD_RATE
    turned = np.column_stack(
        [
            values[:, 0],
            np.cos(angle) * values[:, 1] + np.sin(angle) * (values[:, 2] + G),
            np.cos(angle) * (values[:, 2] + G) - np.sin(angle) * values[:, 1],
        ]
    )
    found = compared(record(turned), record(values), frame="rotating")
    assert list(found.axes) == ["x", "yz"]
    across, density = found.axes["yz"], found.spectra["yz"].field
    assert across.relative_error < 0.01
    assert across.model_rms == pytest.approx(np.sqrt(2 * 0.8), rel=0.03)
    assert np.sqrt(sum(density.density) * density.resolution_hz) == pytest.approx(across.field_rms, rel=0.02)


def test_a_chosen_band_is_used():
    field = record(vibration(FIELD_RATE, (1.0, 1.0, 1.0)))
    assert compared(field, computed((1.0, 1.0, 1.0)), settings=Settings(high_hz=50.0)).axes["x"].field_rms < 0.01


def test_a_signal_that_is_too_short_is_an_error():
    with pytest.raises(ValueError, match="no stretch of 1 s without a gap at 1000 Hz"):
        compared(record(np.zeros((5, 3))), computed((1.0, 1.0, 1.0)))


def test_the_result_of_one_level_is_that_of_all(point):
    axis = point.axes["x"]
    assert list(point.levels) == [0]
    assert point.levels[0]["x"].relative_error == axis.relative_error
    low, high = axis.intervals.relative_error
    assert low <= axis.relative_error <= high
    assert high - low < 0.05  # sines have no scatter but at their ends


def test_statistics_are_those_of_the_conditioned_signal():
    """Numbers of a whole comparison against numpy and scipy on the same conditioned samples."""
    values = RNG.standard_normal((round(DURATION * FIELD_RATE), 3)) ** 3  # heavy tails
    found = compared(record(values), computed((2.0, 1.0, 4.0)))
    axis, spectrum = found.axes["x"], found.spectra["x"].field
    time = np.arange(len(values)) / FIELD_RATE
    expected = conditioned(time, values, FIELD_RATE, common_band(FIELD_RATE, MODEL_RATE))[:, 0]
    assert axis.field_rms == pytest.approx(np.sqrt(np.mean(expected**2)), rel=1e-9)
    assert axis.field_peak == pytest.approx(np.abs(expected).max(), rel=1e-9)
    assert axis.field_crest_factor == pytest.approx(axis.field_peak / axis.field_rms)
    assert axis.field_kurtosis == pytest.approx(scipy.stats.kurtosis(expected, fisher=False), rel=1e-9)
    frequency, density = scipy.signal.welch(expected, FIELD_RATE, nperseg=4000, detrend=False)
    np.testing.assert_allclose(spectrum.density, density[frequency <= 400.0], rtol=ROUNDED)
    velocity = density[1:] / (2 * np.pi * frequency[1:]) ** 2 / (1 + (10.0 / frequency[1:]) ** 8)
    assert axis.field_velocity_rms == pytest.approx(np.sqrt(velocity.sum() * frequency[1]), rel=0.02)
    windows, seen = expected.reshape(15, 2000), axis.windows
    np.testing.assert_allclose(seen.field_rms, np.sqrt(np.mean(windows**2, axis=1)), rtol=ROUNDED)
    np.testing.assert_allclose(seen.field_peak, np.abs(windows).max(axis=1), rtol=ROUNDED)
    np.testing.assert_allclose(seen.field_kurtosis, scipy.stats.kurtosis(windows, axis=1, fisher=False), rtol=ROUNDED)
