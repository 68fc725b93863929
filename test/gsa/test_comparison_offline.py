from types import SimpleNamespace

import numpy as np
import pytest
import scipy.signal
import scipy.stats

from tbm_gsa.comparison import Settings, compare_records
from tbm_gsa.signals.conditioning import common_band, condition
from tbm_msgs_py.base.units import STANDARD_GRAVITY as G

UPWARDS = np.array([0.0, 0.0, G])
RNG = np.random.default_rng(5)
FIELD_RATE, MODEL_RATE, DURATION = 1000.0, 5000.0, 30.0


def record(values: np.ndarray, rate: float = FIELD_RATE, start: float = 0.0) -> SimpleNamespace:
    return SimpleNamespace(time=start + np.arange(len(values)) / rate, values=values, rate_hz=rate, gaps=[])


def vibration(rate: float, amplitudes: tuple[float, float, float], mean: np.ndarray | float = 0.0) -> np.ndarray:
    time = np.arange(round(DURATION * rate)) / rate
    return np.sin(2 * np.pi * 130.3 * time)[:, None] * amplitudes + mean


def computed(amplitudes: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    values = vibration(MODEL_RATE, amplitudes)
    return np.arange(len(values)) / MODEL_RATE, values


@pytest.fixture(scope="module")
def comparison():
    field = {"cutterhead": record(vibration(FIELD_RATE, (2.0, 1.0, 4.0), UPWARDS), start=1.7e9)}
    model = {"cutterhead": computed((1.0, 1.5, 4.0)), "shield": computed((1.0, 1.0, 1.0))}
    return compare_records(field, model, settings=Settings(expected_lines={"load": 130.3}))


def test_levels_and_equation_4(comparison):
    axes = comparison.points["cutterhead"].axes
    assert [axes[a].field.rms for a in "xyz"] == pytest.approx(np.array([2.0, 1.0, 4.0]) / np.sqrt(2), rel=2e-3)
    assert [axes[a].relative_error for a in "xyz"] == pytest.approx([0.5, 0.5, 0.0], abs=5e-3)
    assert axes["x"].field.crest_factor == pytest.approx(np.sqrt(2), rel=0.07)  # the mirrored ends overshoot a little
    assert axes["x"].model.kurtosis == pytest.approx(1.5, rel=0.01)
    assert axes["x"].field.band_rms["125-135_hz"] == pytest.approx(np.sqrt(2), rel=5e-3)


def test_lines_and_spectra(comparison):
    axis = comparison.points["cutterhead"].axes["x"]
    for side in (axis.field, axis.model):
        assert side.lines[0].frequency == pytest.approx(130.3, abs=0.25)
        assert side.lines[0].match == "load"
        assert side.spectrum.frequency[-1] == 400.0
    assert comparison.points["cutterhead"].band.high == 400.0


def test_windows(comparison):
    windows = comparison.points["cutterhead"].axes["x"].windows
    assert windows.start.tolist() == [2.0 * i for i in range(15)]
    np.testing.assert_allclose(windows.field_rms, np.sqrt(2), rtol=0.02)
    np.testing.assert_allclose(windows.relative_error, 0.5, atol=0.02)
    np.testing.assert_array_equal(windows.coverage, 1.0)


def test_gaps_lower_the_coverage_of_their_windows_only():
    whole = record(vibration(FIELD_RATE, (2.0, 1.0, 4.0)))
    kept = (whole.time < 10.5) | (whole.time >= 11.5)
    holed = SimpleNamespace(time=whole.time[kept], values=whole.values[kept], rate_hz=FIELD_RATE, gaps=[(10.5, 11.5)])
    point = compare_records({"girder": holed}, {"girder": computed((2.0, 1.0, 4.0))}).points["girder"]
    assert point.coverage == pytest.approx(29.0 / 30.0)
    expected = np.ones(15)
    expected[5] = 0.5
    np.testing.assert_allclose(point.axes["x"].windows.coverage, expected, atol=2e-3)
    np.testing.assert_allclose(point.axes["x"].windows.relative_error, 0.0, atol=0.03)


def test_a_model_run_that_is_shorter_still_gives_every_window_an_error():
    time, values = computed((1.0, 1.0, 1.0))
    short = {"gripper": (time[:50_000], values[:50_000])}
    comparison = compare_records({"gripper": record(vibration(FIELD_RATE, (1.0, 1.0, 1.0)))}, short)
    windows = comparison.points["gripper"].axes["y"].windows
    np.testing.assert_allclose(windows.relative_error, np.zeros(15), atol=0.03)


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
    model = {"cutterhead": (np.arange(len(values)) / FIELD_RATE, values)}
    comparison = compare_records({"cutterhead": record(turned)}, model, frames={"cutterhead": "rotating"})
    axes = comparison.points["cutterhead"].axes
    assert list(axes) == ["x", "yz"]
    assert axes["yz"].relative_error < 0.01
    assert axes["yz"].model.rms == pytest.approx(np.sqrt(2 * 0.8), rel=0.03)
    total = axes["yz"].field.spectrum
    assert np.sqrt(total.density.sum() * total.frequency[1]) == pytest.approx(axes["yz"].field.rms, rel=0.02)


def test_a_chosen_band_is_used():
    field = {"shield": record(vibration(FIELD_RATE, (1.0, 1.0, 1.0)))}
    comparison = compare_records(field, {"shield": computed((1.0, 1.0, 1.0))}, settings=Settings(high_hz=50.0))
    assert comparison.points["shield"].axes["x"].field.rms < 0.01


def test_errors_name_the_test_point():
    with pytest.raises(ValueError, match="no test point walkway; it has shield"):
        compare_records({"walkway": record(np.zeros((5, 3)))}, {"shield": computed((1.0, 1.0, 1.0))})
    with pytest.raises(ValueError, match="test point shield: no stretch"):
        compare_records({"shield": record(np.zeros((5, 3)))}, {"shield": computed((1.0, 1.0, 1.0))})


def test_the_document_of_one_level_is_that_of_all(comparison):
    axis = comparison.points["cutterhead"].axes["x"]
    assert list(axis.levels) == [0]
    assert axis.levels[0].relative_error == axis.relative_error
    low, high = axis.error_interval
    assert low <= axis.relative_error <= high
    assert high - low < 0.05  # sines have no scatter but at their ends


def test_statistics_are_those_of_the_conditioned_signal():
    """Numbers of a whole comparison against numpy and scipy on the same conditioned samples."""
    values = RNG.standard_normal((round(DURATION * FIELD_RATE), 3)) ** 3  # heavy tails
    axis = compare_records({"girder": record(values)}, {"girder": computed((2.0, 1.0, 4.0))}).points["girder"].axes["x"]
    time = np.arange(len(values)) / FIELD_RATE
    conditioned = condition(time, values, FIELD_RATE, common_band(FIELD_RATE, MODEL_RATE)).values[:, 0]
    found = axis.field
    assert found.rms == pytest.approx(np.sqrt(np.mean(conditioned**2)), rel=1e-9)
    assert found.peak == pytest.approx(np.abs(conditioned).max(), rel=1e-9)
    assert found.crest_factor == pytest.approx(found.peak / found.rms)
    assert found.kurtosis == pytest.approx(scipy.stats.kurtosis(conditioned, fisher=False), rel=1e-9)
    frequency, density = scipy.signal.welch(conditioned, FIELD_RATE, nperseg=4000, detrend=False)
    np.testing.assert_allclose(found.spectrum.density, density[frequency <= 400.0], rtol=1e-9)
    velocity = density[1:] / (2 * np.pi * frequency[1:]) ** 2 / (1 + (10.0 / frequency[1:]) ** 8)
    assert found.velocity_rms == pytest.approx(np.sqrt(velocity.sum() * frequency[1]), rel=0.02)
    windows = conditioned.reshape(15, 2000)
    np.testing.assert_allclose(axis.windows.field_rms, np.sqrt(np.mean(windows**2, axis=1)), rtol=1e-9)
    np.testing.assert_allclose(axis.windows.field_peak, np.abs(windows).max(axis=1), rtol=1e-9)
    np.testing.assert_allclose(
        axis.windows.field_kurtosis, scipy.stats.kurtosis(windows, axis=1, fisher=False), rtol=1e-9
    )
