"""Sums per window and spectra against scipy and exact signals; Parseval for any signal."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.signal
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tbm_gsa.signals.conditioning import Segment
from tbm_gsa.signals.reduction import one_level
from tbm_gsa.signals.spectrogram import SpectrogramCollector
from tbm_gsa.signals.spectrum import WelchCollector, mixed_spectrum
from tbm_gsa.signals.statistics import (
    SpectralLine,
    Spectrum,
    coverage,
    kurtosis,
    match_lines,
    periodograms,
    relative_error,
    rms,
    strongest_lines,
)
from tbm_gsa.signals.windows import WindowCollector

RATE = 1000.0
TIME = np.arange(20_000) / RATE
SINE = 3.0 * np.sin(2 * np.pi * 50.0 * TIME)
NOISE = np.random.default_rng(7).standard_normal((20_000, 3))
XYZ = [(0,), (1,), (2,)]


def segment(values, start=0.0, joined=False, rate=RATE):
    return Segment(start + np.arange(len(values)) / rate, values, 0.1 * values, joined)


def windows(*segments, axes=XYZ, bands=((0.0, 100.0),), length=2.0):
    collector = WindowCollector(RATE, length, axes, bands)
    for part in segments:
        collector.add(part)
    return collector.finish()


@pytest.mark.parametrize("samples", [0.1, 1.0])
def test_windows_too_short_for_a_spectrum_have_none(samples):
    table = windows(segment(NOISE[:100]), length=samples / RATE)
    assert len(table) == 100
    assert np.isnan(table.bands).all()
    assert np.isnan(table.line).all()
    np.testing.assert_allclose(np.sqrt(table.moments[:, 1]), np.abs(NOISE[:100]))


def spectrum(*segments, resolution=0.25, axis=(0,)):
    collector = WelchCollector(RATE, resolution, one_level())
    for part in segments:
        collector.add(part)
    return mixed_spectrum([(collector.finish()[0], 1.0)], axis, RATE)


def totals(table):
    return table.count.sum(), table.moments.sum(axis=0)


def test_statistics_of_a_sine_are_exact():
    table = windows(segment(np.column_stack([SINE, SINE, 0.0 * SINE])))
    assert len(table) == 10
    np.testing.assert_allclose(rms(table.count, table.moments)[:, 0], 3.0 / np.sqrt(2.0))
    np.testing.assert_allclose(kurtosis(table.count, table.moments)[:, 0], 1.5)
    np.testing.assert_allclose(table.peak[:, 0], 3.0)
    np.testing.assert_allclose(table.line[:, 0], 50.0)
    np.testing.assert_allclose(np.sqrt(table.velocity[:, 0] / table.count), 0.3 / np.sqrt(2.0))
    np.testing.assert_allclose(np.sqrt(table.bands[:, 0, 0] / table.count), 3.0 / np.sqrt(2.0), rtol=1e-6)


def test_a_signal_that_is_zero_has_no_kurtosis_and_no_line():
    table = windows(segment(np.zeros((2000, 3))))
    assert np.isnan(kurtosis(table.count, table.moments)).all()
    assert np.isnan(table.line).all()
    assert not table.bands.any()


def test_moments_are_scipys():
    skewed = NOISE**2 + [0.0, 1.0, -3.0]
    count, moments = totals(windows(segment(skewed)))
    np.testing.assert_allclose(rms(count, moments), np.sqrt(np.mean(skewed**2, axis=0)))
    np.testing.assert_allclose(kurtosis(count, moments), scipy.stats.kurtosis(skewed, fisher=False))


def test_two_columns_are_taken_as_the_length_of_their_vector():
    table = windows(segment(NOISE), axes=[(0,), (1, 2)])
    length = np.hypot(NOISE[:, 1], NOISE[:, 2]).reshape(10, -1)
    np.testing.assert_allclose(rms(table.count, table.moments)[:, 1], np.sqrt(np.mean(length**2, axis=1)))
    np.testing.assert_allclose(table.peak[:, 1], length.max(axis=1))


@given(
    values=arrays(float, (2000, 3), elements=st.floats(-1e3, 1e3), fill=st.floats(-1.0, 1.0)),
    cuts=st.lists(st.floats(0.0, 501.0), max_size=4).map(sorted),
)
def test_bands_that_cover_everything_add_up_to_the_mean_square(values, cuts):
    limits = [0.0, *cuts, 502.0]
    table = windows(segment(values), bands=list(pairwise(limits)), length=1.0)
    power = np.square(values).reshape(2, 1000, 3).sum(axis=1)
    np.testing.assert_allclose(table.moments[:, 1], power, rtol=1e-9, atol=1e-9)
    heard = np.isfinite(table.line)  # what a Hann window leaves of a single sample at its edge is nothing
    np.testing.assert_allclose(table.bands.sum(axis=1)[heard], power[heard], rtol=1e-9, atol=1e-9)


@given(values=arrays(float, st.tuples(st.integers(16, 300), st.just(2)), elements=st.floats(-1e3, 1e3)))
def test_parseval_of_a_periodogram(values):
    # The integral of the density is the mean square of the signal under the window, whatever its length.
    (density,) = periodograms(values, RATE, len(values))
    window = scipy.signal.get_window("hann", len(values))
    expected = np.square(values * window[:, None]).sum(axis=0) / np.square(window).sum()
    np.testing.assert_allclose(density.sum(axis=0) * RATE / len(values), expected, rtol=1e-9, atol=1e-9)


@given(cuts=st.lists(st.integers(1, 19_999), max_size=6, unique=True).map(sorted))
def test_windows_and_spectra_do_not_depend_on_the_pieces(cuts):
    pieces = [
        segment(part, first / RATE, first > 0) for part, first in zip(np.split(NOISE, cuts), [0, *cuts], strict=True)
    ]
    whole, cut = windows(segment(NOISE)), windows(*pieces)
    for name in ("index", "count", "moments", "peak", "bands", "line"):
        np.testing.assert_allclose(getattr(cut, name), getattr(whole, name), rtol=1e-12, err_msg=name)
    np.testing.assert_allclose(spectrum(*pieces).density, spectrum(segment(NOISE)).density, rtol=1e-12)


@pytest.mark.parametrize("size", [1000, 4000, 777])
def test_welch_is_scipys(size):
    found = spectrum(segment(NOISE), resolution=RATE / size, axis=(1, 2))
    frequency, density = scipy.signal.welch(NOISE, RATE, nperseg=size, detrend=False, axis=0, noverlap=size // 2)
    np.testing.assert_allclose(found.frequency, frequency)
    np.testing.assert_allclose(found.density, density[:, 1:].sum(axis=1))
    assert found.segments == (len(NOISE) - size) // (size - size // 2) + 1


def test_welch_averages_all_segments_and_falls_back_on_seconds():
    parts = [segment(NOISE[:9000]), segment(NOISE[9000:13000], 20.0), segment(NOISE[13000:15000], 30.0)]
    three, one = (spectrum(part).density for part in parts[:2])
    np.testing.assert_allclose(spectrum(*parts).density, (3 * three + one) / 4)
    short = spectrum(parts[2])
    assert short.frequency[1] == 1.0
    assert short.segments == 3
    np.testing.assert_allclose(spectrum(parts[2], parts[0]).density, three)


def test_levels_have_spectra_of_their_own():
    signal = NOISE * np.where(TIME < 10.0, 1.0, 5.0)[:, None]
    collector = WelchCollector(RATE, 1.0, lambda begin, end: np.where(end <= 10.0, 0, np.where(begin >= 10.0, 1, -1)))
    collector.add(segment(signal))
    sums = collector.finish()
    assert [sums[level].segments for level in (0, 1)] == [19, 19]  # the one across the change belongs to none
    mixed = mixed_spectrum([(sums[0], 0.25), (sums[1], 0.75)], (0,), RATE)
    low, high = (mixed_spectrum([(sums[level], 1.0)], (0,), RATE) for level in (0, 1))
    np.testing.assert_allclose(mixed.density, 0.25 * low.density + 0.75 * high.density)
    assert low.density.mean() == pytest.approx(2.0 / RATE, rel=0.05)
    assert high.density.mean() == pytest.approx(50.0 / RATE, rel=0.05)
    assert mixed.segments == pytest.approx(19 / (0.25**2 + 0.75**2))


def test_a_spectrogram_is_the_mean_of_scipys_and_empty_in_gaps():
    collector = SpectrogramCollector(RATE, 200.0)  # 1 Hz, half a second a column
    parts = [segment(NOISE[:7000]), segment(NOISE[7000:], 7.0, joined=True), segment(NOISE, 180.0)]
    for part in parts:
        collector.add(part)
    found = collector.finish()
    frequency, _, density = scipy.signal.spectrogram(NOISE[:, 0], RATE, "hann", 1000, 500, detrend=False)
    mean = density[:, :38].reshape(501, 19, 2).mean(axis=2)  # 400 columns became 200
    assert (found.column_s, found.resolution_hz, found.density.shape) == (1.0, frequency[1], (201, 200))
    np.testing.assert_allclose(found.density[:, :19], mean[:201])
    np.testing.assert_allclose(found.density[:, 180:199], mean[:201])
    assert np.isnan(found.density[:, 20:180]).all()


def test_strongest_lines_with_their_rms():
    signal = SINE + np.sin(2 * np.pi * 130.3 * TIME) + 0.01 * NOISE[:, 0]
    lines = strongest_lines(spectrum(segment(np.column_stack([signal] * 3))), 2)
    assert [line.frequency for line in lines] == [50.0, 130.25]
    assert [line.rms for line in lines] == pytest.approx([3.0 / np.sqrt(2), 1.0 / np.sqrt(2)], rel=0.02)


def test_a_flat_spectrum_has_no_lines():
    assert strongest_lines(Spectrum(np.arange(10.0), np.ones(10), 1.0), 3) == ()


def test_lines_match_the_nearest_expected_one():
    lines = [SpectralLine(130.0, 1.0), SpectralLine(14.5, 1.0), SpectralLine(50.0, 1.0)]
    matched = match_lines(lines, {"load": 130.3, "other": 129.6, "mesh": 14.19})
    assert [line.match for line in matched] == ["load", "mesh", ""]


def test_relative_error_is_equation_4_and_gives_table_2():
    measured, computed = [0.93, 0.40, 0.08], [1.10, 0.56, 0.04]
    np.testing.assert_allclose(relative_error(measured, computed), [0.18, 0.40, 0.50], atol=0.005)


def test_relative_error_of_a_dead_sensor():
    errors = relative_error([0.0, 0.0, np.nan], [1.0, 0.0, 1.0])
    assert errors[0] == np.inf
    assert np.isnan(errors[1:]).all()


def test_coverage_is_at_most_one():
    assert coverage(500, 1000.0, 1.0) == 0.5
    assert coverage(1001, 1000.0, 1.0) == 1.0


def test_gaps_leave_windows_out_and_the_rest_as_it_is():
    table = windows(segment(NOISE[:3000]), segment(NOISE[9000:], 9.0))
    assert table.index.tolist() == [0, 1, 4, 5, 6, 7, 8, 9]
    assert table.count.tolist() == [2000, 1000, 1000, *[2000] * 5]
    whole = windows(segment(NOISE))
    np.testing.assert_allclose(table.moments[[0, 3]], whole.moments[[0, 5]])


def test_a_part_too_short_for_a_transform_has_no_bands():
    table = windows(segment(NOISE[:2500]))
    assert np.isfinite(table.bands[0]).all()
    assert np.isnan(table.bands[1]).all()
    assert np.isfinite(table.moments[1]).all()
