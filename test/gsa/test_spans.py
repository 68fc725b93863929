"""Spectra of live signals minute by minute, against scipy's Welch, and what is read of them."""

import numpy as np
import pytest
import scipy.signal

from tbm_dynamics import load_machine
from tbm_gsa.comparison import WindowedComparison
from tbm_gsa.explanation.band_reading import Sensor
from tbm_gsa.explanation.live_reading import LiveReading
from tbm_gsa.signals.conditioning import Band, power_gain
from tbm_gsa.signals.spans import SpanCollector, SpanSpectrum
from tbm_gsa.signals.spectrum import SpectrumSum
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.recordings.mapping import SensorMapping

SECOND, MINUTE = 10**9, 60 * 10**9
RATE, BAND = 50, Band(0.5, 20.0)
START = 28_333_333 * MINUTE
BANDS = load_machine("dz101").description.loads.bands


def signal(seconds, seed=0):
    """Times (n,) in ns from a minute's begin on, white noise of unit density over 0 to 25 Hz, (n, 3)."""
    times = START + np.arange(seconds * RATE) * (SECOND // RATE)
    return times, np.random.default_rng(seed).standard_normal((len(times), 3)) * np.sqrt(0.5 * RATE)


def collected(times, values, pieces=7):
    collector = SpanCollector(MINUTE)
    for stamps, rows in zip(np.array_split(times, pieces), np.array_split(values, pieces), strict=True):
        collector.add(stamps, rows, BAND)
    return collector.pop()


@pytest.mark.parametrize("pieces", [1, 7, 500])
def test_a_minute_has_the_spectrum_of_its_own_samples(pieces):
    times, values = signal(130)
    found = collected(times, values, pieces)
    assert [(one.start_ns, one.length_ns, one.enough) for one in found] == [
        (START, MINUTE, True),
        (START + MINUTE, MINUTE, True),
    ]
    for number, one in enumerate(found):
        minute = values[60 * RATE * number : 60 * RATE * (number + 1)]
        _, density = scipy.signal.welch(minute, RATE, nperseg=4 * RATE, detrend=False, axis=0)
        np.testing.assert_allclose(one.density, density, rtol=1e-9)
        assert (one.rate_hz, one.step_hz, one.total.segments) == (pytest.approx(RATE), pytest.approx(0.25), 29)


@pytest.mark.parametrize(
    ("lost", "segments"), [(slice(0, 0), 29), (slice(1000, 1001), 27), (slice(500, 1200), 21), (slice(400, 2800), 4)]
)
def test_a_minute_with_gaps_is_as_good_as_its_segments(lost, segments):
    times, values = signal(70)
    kept = np.delete(np.arange(len(times)), lost)
    (found,) = collected(times[kept], values[kept], 60)
    assert (found.total.segments, found.coverage, found.enough) == (segments, segments / 29, segments > 7)


def test_stamps_that_jitter_make_the_same_spectrum():
    """Of sines of 1 to 3 Hz, stamps within a tenth of a period to either side."""
    times, _ = signal(64)
    uneven = times + np.random.default_rng(1).integers(-SECOND // 500, SECOND // 500, len(times))
    even, found = (
        collected(stamps, np.sin(2.0 * np.pi * np.outer((stamps - START) / SECOND, [1.0, 2.0, 3.0])))[0]
        for stamps in (times, uneven)
    )
    assert found.enough
    np.testing.assert_allclose(found.density.sum(axis=0), even.density.sum(axis=0), rtol=2e-3)


def test_another_band_rate_or_clock_begins_a_new_signal():
    times, values = signal(70)
    collector = SpanCollector(MINUTE)
    collector.add(times[:1500], values[:1500], BAND)
    collector.add(times[1500:], values[1500:], Band(0.5, 10.0))
    assert [one.total.segments for one in collector.pop()] == [14]  # of the new band alone
    collector.restart()
    collector.add(times - MINUTE, values, BAND)  # the clock was set back
    assert [one.start_ns for one in collector.pop()] == [START - MINUTE]
    collector.add(times[-1] + (times - START) // 2 + 1, values, BAND)  # twice the rate than was learnt
    assert not any(one.enough for one in collector.pop())


def test_a_live_sine_has_the_power_that_the_filters_leave():
    """Of 15 Hz with the amplitudes 1, 2 and 3, no model; that of a point that turns is read as y and z together."""
    comparison, rate = WindowedComparison(2.0, rotating=["head"]), 100
    for block in range(14):
        offsets = np.arange(10 * rate) / rate
        wave = np.sin(2.0 * np.pi * 15.0 * (10 * block + offsets))[:, None] * [1.0, 2.0, 3.0]
        for point in ("head", "girder"):
            comparison.feed(point, "field", START + block * 10 * SECOND, offsets, wave)
    found = comparison.pop_spans()
    spectra = {point: spans[-1] for point, spans in found.items()}
    assert {point: [one.enough for one in spans] for point, spans in found.items()} == {
        "head": [True, True],  # the filter settles in two seconds, two segments of 29
        "girder": [True, True],
    }
    sensors = {"head": sensor("head", frame="rotating"), "girder": sensor("girder")}
    live = LiveReading.of(spectra, sensors, BANDS)
    assert live.reading.bands == ((0.5, 20.0),)
    left = power_gain(100.0, live.reading.band, np.array([15.0]))
    powers = np.array([0.5, 0.5 * 13.0, 0.5, 2.0, 4.5]) * left
    np.testing.assert_allclose(np.exp(live.log_powers(spectra)), powers, rtol=2e-3)


def sensor(point, **given):
    return SensorMapping(**{"point": point, "units": "m/s2", "gravity": "removed", "frame": "fixed"} | given)


def flat(density=1.0, rate=1000.0, segments=29):
    """Spectrum of white noise of a density."""
    size = round(4.0 * rate)
    total = SpectrumSum(np.full((size // 2 + 1, 3), segments * density), segments, size)
    return SpanSpectrum(START, MINUTE, rate, Band(0.5, 0.4 * rate), total)


def test_what_a_sensor_does_not_measure_is_not_read():
    sensors = {
        "shield": sensor("shield", axes=("x", None, "z"), band_hz=(5.0, 128.0)),
        "head": sensor("head", frame="rotating", axes=("x", "y", None)),
    }
    live = LiveReading.of({point: flat() for point in sensors}, sensors, BANDS)
    names = [live.reading.statistics[place].name for place in live.used]
    assert names == [
        *(f"rms_{band}_hz_shield_{axis}" for axis in "xz" for band in ("0.5-20", "100-110")),
        *(f"rms_{band}_hz_head_x" for band in ("0.5-20", "100-110", "125-135", "200-210")),
    ]
    only = live.log_powers({"head": flat()})
    assert np.isnan(only[:4]).all()
    np.testing.assert_allclose(np.exp(only[4:]), [19.5, 10.0, 10.0, 10.0], rtol=0.02)
    assert np.isnan(live.log_powers({"head": flat(segments=7)})).all()


def test_noise_is_stated_or_found_and_holds_up_dead_channels():
    sensors = {"shield": sensor("shield", units="g", noise_density=1e-3), "girder": sensor("girder")}
    live = LiveReading.of({"shield": flat(1e-4), "girder": flat(3e-4)}, sensors, BANDS)
    stated = (1e-3 * 9.80665) ** 2
    assert live.noise[0] == pytest.approx(stated)
    assert live.noise[-1] == pytest.approx(3e-4, rel=0.05)
    dead = live.log_powers({"shield": flat(0.0), "girder": flat(3e-4)})
    assert np.exp(dead[1]) == pytest.approx(10.0 * stated)
    np.testing.assert_allclose(live.floor({"girder": flat(5e-4)})[[0, -1]], [stated, 5e-4], rtol=0.05)


def test_a_reading_covers_what_is_read_alike():
    sensors = {"shield": sensor("shield"), "girder": sensor("girder", offset=(0.0, 1.0, 0.0))}
    spectra = {point: flat() for point in sensors}
    live = LiveReading.of(spectra, sensors, BANDS)
    assert live.reading.sensors["girder"] == Sensor("fixed", (0.0, 1.0, 0.0))
    assert live.covers(spectra, sensors)
    assert live.covers({"girder": flat(rate=1004.0)}, sensors)
    assert not live.covers({"girder": flat(rate=900.0)}, sensors)
    assert not live.covers(spectra, sensors | {"girder": sensor("girder")})
    assert not live.covers(spectra | {"walkway": flat()}, sensors | {"walkway": sensor("walkway")})
    with pytest.raises(InputError, match="no band below 16 Hz"):
        LiveReading.of({"girder": flat(rate=40.0)}, sensors, BANDS)
    with pytest.raises(InputError, match="no axis of a sensor that measures in a band"):
        LiveReading.of({"girder": flat()}, {"girder": sensor("girder", band_hz=(300.0, 400.0))}, BANDS)
