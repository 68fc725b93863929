import numpy as np
import pytest
import scipy.signal
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tbm_gsa.comparison.statistics import (
    Line,
    band_rms,
    coverage,
    crest_factor,
    kurtosis,
    match_lines,
    peak,
    relative_error,
    rms,
    strongest_lines,
    welch_spectrum,
)

RATE = 1000.0
TIME = np.arange(20_000) / RATE
SINE = 3.0 * np.sin(2 * np.pi * 50.0 * TIME)
NOISE = np.random.default_rng(7).standard_normal((200_000, 2))
signals = arrays(float, st.integers(1, 50), elements=st.floats(-1e3, 1e3))


def test_a_sine():
    assert rms(SINE) == pytest.approx(3.0 / np.sqrt(2.0))
    assert peak(SINE) == pytest.approx(3.0)
    assert crest_factor(SINE) == pytest.approx(np.sqrt(2.0))
    assert kurtosis(SINE) == pytest.approx(1.5)


def test_gaussian_noise():
    np.testing.assert_allclose(rms(NOISE), 1.0, atol=5 / np.sqrt(2 * len(NOISE)))
    np.testing.assert_allclose(kurtosis(NOISE), 3.0, atol=5 * np.sqrt(24 / len(NOISE)))
    np.testing.assert_allclose(kurtosis(NOISE), scipy.stats.kurtosis(NOISE, fisher=False))


def test_zero_has_no_crest_and_no_kurtosis():
    assert np.isnan(crest_factor(np.zeros(5)))
    assert np.isnan(kurtosis(np.ones(5)))


@given(values=signals, cut=st.floats(0.0, RATE / 2))
def test_parseval_bands_add_up_to_the_rms(values, cut):
    low, high = (band_rms([values], RATE, *band) for band in [(0.0, cut), (cut, RATE)])
    np.testing.assert_allclose(np.hypot(low, high), rms(values), rtol=1e-9, atol=1e-9)


def test_parseval_over_segments_of_any_length():
    pieces = [NOISE[:1000], NOISE[1000:1777], NOISE[1777:4000]]
    np.testing.assert_allclose(band_rms(pieces, RATE, 0.0, RATE), rms(NOISE[:4000]), rtol=1e-12)


def test_band_rms_finds_the_sine_in_its_band_only():
    assert band_rms([SINE], RATE, 45.0, 55.0) == pytest.approx(rms(SINE))
    assert band_rms([SINE], RATE, 55.0, 500.0) == pytest.approx(0.0, abs=1e-9)


def test_welch_is_scipys_and_sums_columns():
    spectrum = welch_spectrum([NOISE], RATE, 1.0)
    frequency, density = scipy.signal.welch(NOISE, RATE, nperseg=1000, detrend=False, axis=0)
    np.testing.assert_allclose(spectrum.frequency, frequency)
    np.testing.assert_allclose(spectrum.density, density.sum(axis=1))


def test_welch_weighs_segments_and_leaves_short_ones_out():
    pieces = [NOISE[:3000], NOISE[3000:4000], NOISE[4000:4100]]
    one, two = (welch_spectrum([piece], RATE, 1.0).density for piece in pieces[:2])
    np.testing.assert_allclose(welch_spectrum(pieces, RATE, 1.0).density, 0.75 * one + 0.25 * two)
    assert welch_spectrum([NOISE[:100]], RATE, 1.0).frequency[1] == 10.0


def test_strongest_lines_with_their_rms():
    signal = SINE + np.sin(2 * np.pi * 130.3 * TIME) + 0.01 * NOISE[: len(TIME), 0]
    lines = strongest_lines(welch_spectrum([signal[:, None]], RATE, 0.25), 2)
    assert [line.frequency for line in lines] == [50.0, 130.25]
    assert [line.rms for line in lines] == pytest.approx([3.0 / np.sqrt(2), 1.0 / np.sqrt(2)], rel=0.02)


def test_lines_match_the_nearest_expected_one():
    lines = [Line(130.0, 1.0), Line(14.5, 1.0), Line(50.0, 1.0)]
    matched = match_lines(lines, {"load": 130.3, "other": 129.6, "mesh": 14.19})
    assert [line.match for line in matched] == ["load", "mesh", ""]


def test_relative_error_is_equation_4_and_gives_table_2():
    measured, computed = [0.93, 0.40, 0.08], [1.10, 0.56, 0.04]
    np.testing.assert_allclose(relative_error(measured, computed), [0.18, 0.40, 0.50], atol=0.005)


def test_relative_error_of_a_dead_sensor():
    errors = relative_error([0.0, 0.0, np.nan], [1.0, 0.0, 1.0])
    assert errors[0] == np.inf
    assert np.isnan(errors[1:]).all()


def test_coverage():
    assert coverage(500, 1000.0, 1.0) == 0.5
    assert coverage(1001, 1000.0, 1.0) == 1.0


@pytest.mark.parametrize("function", [rms, peak, crest_factor, kurtosis])
@pytest.mark.parametrize("values", [[], 3.0])
def test_no_samples_is_an_error(function, values):
    with pytest.raises(ValueError, match="at least one sample"):
        function(values)
