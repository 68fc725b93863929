"""The noise of a sensor is found in a recording: its stated density, whatever else is in the signal."""

import numpy as np
import pytest
import scipy.signal

from tbm_gsa.signals.conditioning import common_band
from tbm_gsa.signals.noise_floor import noise_floor
from tbm_gsa.signals.reduction import SignalReducer
from tbm_gsa.signals.settings import Settings
from tbm_msgs_py.base.errors import InputError

RATE_HZ, DENSITY = 1000.0, 1e-3  # m/s²/√Hz


def reduced(values, rate=RATE_HZ):
    reducer = SignalReducer(rate, common_band(rate), "fixed", Settings(bands=((0.5, 20.0),)))
    reducer.feed(np.arange(len(values)) / rate, values)
    return reducer.finish()


def white(seconds, seed, density=DENSITY):
    rows = round(seconds * RATE_HZ)
    return np.random.default_rng(seed).standard_normal((rows, 3)) * density * np.sqrt(0.5 * RATE_HZ)


def machine(kind, rows):
    """What a machine adds: many lines, a broad band, or one over all but the last 60 Hz that are read."""
    time, rng = np.arange(rows) / RATE_HZ, np.random.default_rng(9)
    lines = sum(0.05 * np.sin(2 * np.pi * f * time + f) for f in np.arange(7.0, 400.0, 4.3))
    shaped = {"lines": (1.0, 2.0), "band": (5.0, 180.0), "nearly all": (0.1, 320.0)}[kind]
    sections = scipy.signal.ellip(8, 0.5, 90.0, shaped, "bandpass", fs=RATE_HZ, output="sos")
    noise = scipy.signal.sosfilt(sections, rng.standard_normal(rows))
    return (noise + (lines if kind == "lines" else 0.0))[:, None]


@pytest.mark.parametrize(("seconds", "within"), [(10.0, 0.2), (60.0, 0.06)])
def test_density_of_white_noise_is_found(seconds, within):
    for seed in range(3):
        np.testing.assert_allclose(noise_floor(reduced(white(seconds, seed))), DENSITY**2, rtol=within)


@pytest.mark.parametrize("kind", ["lines", "band", "nearly all"])
def test_what_the_machine_adds_is_not_taken_for_noise(kind):
    values = white(30.0, 4)
    found = noise_floor(reduced(values + machine(kind, len(values))))
    np.testing.assert_allclose(found, DENSITY**2, rtol=0.25)


def test_rounding_is_found_as_a_twelfth_of_its_square():
    step = 0.02
    values = np.round(white(30.0, 5, 0.0) + machine("band", 30_000) / step) * step
    np.testing.assert_allclose(noise_floor(reduced(values)), step**2 / 12.0 / (0.5 * RATE_HZ), rtol=0.25)


def test_noise_is_looked_for_where_the_sensor_measures():
    values = white(30.0, 6)
    falling = scipy.signal.sosfilt(scipy.signal.butter(4, 150.0, fs=RATE_HZ, output="sos"), values, axis=0)
    signal = reduced(falling)
    assert (noise_floor(signal) < 0.1 * DENSITY**2).all()
    np.testing.assert_allclose(noise_floor(signal, within_hz=(1.0, 100.0)), DENSITY**2, rtol=0.15)
    with pytest.raises(InputError, match="no 10 Hz"):
        noise_floor(signal, within_hz=(600.0, 900.0))
