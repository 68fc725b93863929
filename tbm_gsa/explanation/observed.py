"""What a comparison says of a recording: its band powers, and which of them say anything."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Self

import numpy as np

from tbm_dynamics import Machine
from tbm_dynamics.loads.description import LoadFactors
from tbm_gsa.comparison.change_times import SHORTEST_S
from tbm_gsa.comparison.results import ComparisonResult, SpectrumResult
from tbm_gsa.explanation.band_reading import BandReading, Sensor
from tbm_gsa.explanation.curve_cache import rounded
from tbm_gsa.explanation.load_posterior import LEAST_OVER_NOISE, BandObservation, telling
from tbm_gsa.explanation.load_scatter import LoadScatter
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.signals.conditioning import Band, power_gain
from tbm_gsa.signals.noise_floor import spectrum_floor
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError

FEWEST_POINTS: Final = 2
"""Of one point nothing tells the machine from its sensor."""
FEWEST_TELLING: Final = 4
ALIKE: Final = 10.0
"""Sensors whose noise is not stated are alike: a density so much above the median of all is a fault."""
_LEAST_NOISE: Final = 1e-14
"""Density that any sensor has, m²/s⁴/Hz: 0.01 µg/√Hz, and far more than rounding."""
_QUIETER: Final = 2.0
"""Standard deviations of the loads' prior by which a channel that should be heard may be quieter than expected."""
ROUNDED: Final = 3
"""Digits of the rate and band of a reading, so that clocks that differ by parts per million share one."""


@dataclass(frozen=True, eq=False)
class Observed:
    """Band powers of a recording; k statistics.

    Attributes
    ----------
    reading : BandReading
    bands : BandObservation
        With the noise that is expected of the sensors.
    floor : ndarray, shape (k,)
        Noise as it was found in the recording, m²/s⁴/Hz; NaN of a statistic that was not measured.
    """

    reading: BandReading
    bands: BandObservation
    floor: Array

    @classmethod
    def of(
        cls,
        reading: BandReading,
        powers: Array,
        floor: Array,
        stated: Array,
        duration_s: float,
        coverage: Array | None = None,
    ) -> Self:
        """From band powers (k,), the noise found in the recording and that stated, NaN where it is not.

        Powers and noise found are NaN along axes that were not measured.
        """
        floor = np.maximum(floor, _LEAST_NOISE)
        noise = np.where(np.isfinite(stated), stated, np.fmin(floor, ALIKE * float(np.nanmedian(floor))))
        noise = np.maximum(noise, _LEAST_NOISE)
        # A dead channel has no power at all: it is given that of its noise, as is one that there is not.
        bands = BandObservation(np.fmax(powers, reading.widths * noise), noise, duration_s, coverage)
        return cls(reading, bands, floor)

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Channel of each statistic."""
        return tuple(f"{one.point}_{one.axis}" for one in self.reading.statistics)

    def used(self, scatter: LoadScatter, prior: LoadFactors) -> Integers:
        """Statistics (u,) that say something, of silent channels those that a machine as it stands would show.

        Raises
        ------
        StudyError
            Too few.
        """
        heard = telling(self.bands, scatter)
        quiet = scatter.transfer.predict(prior.values * math.exp(-_QUIETER * prior.log_sigma))
        loud = quiet > LEAST_OVER_NOISE * scatter.width * self.bands.noise
        loud &= np.isfinite(self.floor)  # and measured
        speaking = {self.channels[place] for place in heard}
        missed = [place for place in np.flatnonzero(loud) if self.channels[place] not in speaking]
        if len(heard) < FEWEST_TELLING:
            raise StudyError(
                f"a verdict needs {FEWEST_TELLING} band powers above the sensors' noise, the recording has {len(heard)}"
            )
        return np.union1d(heard, missed).astype(np.int64)

    def weightless(self, used: Integers, scatter: LoadScatter) -> dict[str, str]:
        """Statistics that are not used, by name, and why."""
        noisy = self.bands.powers <= LEAST_OVER_NOISE * scatter.width * self.bands.noise
        reasons = np.where(noisy, "noise of the sensor", "leakage of stronger bands")
        reasons = np.where(np.isnan(self.floor), "not measured", reasons)
        return {one.name: str(reasons[place]) for place, one in enumerate(self.reading.statistics) if place not in used}


def observed(comparison: ComparisonResult, machine: Machine) -> Observed:
    """Read the band powers of a comparison with a machine: of its loads' bands, or of others that were asked for.

    Raises
    ------
    StudyError
        What is missing for a verdict: an operating point, test points, time without a gap, bands.
    """
    if comparison.operating_point.source == "machine":
        raise StudyError(
            "a verdict needs the operating point: the recording holds none, allowed: its topic, or that of the mapping"
        )
    if len(comparison.points) < FEWEST_POINTS:
        raise StudyError(
            f"a verdict needs {FEWEST_POINTS} test points, for of one nothing tells the machine from its sensor; "
            f"the comparison has {', '.join(comparison.points) or 'none'}"
        )
    reading = _reading(comparison, machine.driven_loads.bands)
    spectra = [comparison.spectra[point][axis].field for point in reading.sensors for axis in comparison.spectra[point]]
    recorded = np.array([0.5 * reading.segment_s * (one.segments + 1.0) for one in spectra])
    if recorded.min() < SHORTEST_S:
        raise StudyError(
            f"a verdict needs {SHORTEST_S:g} s without a gap at one level, the recording has {recorded.min():g} s"
        )
    duration, count = max(comparison.operating_point.seconds, float(recorded.max())), len(reading.bands)
    powers = np.concatenate([reading.band_powers(one.resolution_hz, _density(one)[1]) for one in spectra])
    columns = np.repeat(reading.columns.sum(axis=1), count)
    floor = np.repeat([_floor(one, reading) for one in spectra], count) / columns
    points = [comparison.recording.points.get(one.point) for one in reading.statistics]
    limits = [None if one is None else one.band_hz for one in points]
    outside = [not one.within(band) for one, band in zip(reading.statistics, limits, strict=True)]
    powers[outside] = floor[outside] = math.nan
    stated = np.array([math.nan if one is None or one.noise_power is None else one.noise_power for one in points])
    return Observed.of(reading, powers, floor, stated, duration, np.repeat(recorded / duration, count))


def _reading(comparison: ComparisonResult, loaded: tuple[tuple[float, float], ...]) -> BandReading:
    limits = comparison.bands.values()
    high_hz = min(band.high_hz for band in limits)
    first = next(iter(next(iter(comparison.points.values())).values()))
    bands = [_limits(name) for name in first.field_band_rms]
    bands = [band for band in bands if band[1] <= high_hz]
    own = [band for band in loaded if band[1] <= high_hz]
    if own and set(own) <= set(bands):
        bands = own  # what lies between them is of the gears, for the eye
    if not bands:
        raise StudyError(f"a verdict needs a band below {high_hz:g} Hz, up to which the signals were compared")
    lowest = max(band.low_hz for band in limits)
    rate = min(min(band.field_rate_hz, band.model_rate_hz) for band in limits)
    return BandReading(
        sensors=_sensors(comparison),
        bands=tuple(bands),
        rate_hz=rounded(rate, ROUNDED),
        band=Band(rounded(lowest, ROUNDED), rounded(high_hz, ROUNDED)),
        segment_s=_segment(comparison),
    )


def _sensors(comparison: ComparisonResult) -> Mapping[str, Sensor]:
    return {point: Sensor(frame="rotating" if "yz" in axes else "fixed") for point, axes in comparison.points.items()}


def _segment(comparison: ComparisonResult) -> float:
    """Length of the segments, s; that of the shortest point."""
    found = {1.0 / one.field.resolution_hz for axes in comparison.spectra.values() for one in axes.values()}
    if max(found) > 1.01 * min(found) or min(found) < 0.99 * BandReading.segment_s:
        raise StudyError(f"a verdict needs {BandReading.segment_s:g} s without a gap at one level at every test point")
    return BandReading.segment_s


def _limits(name: str) -> tuple[float, float]:
    low, high = name.removesuffix("_hz").split("-")
    return float(low), float(high)


def _density(spectrum: SpectrumResult) -> tuple[Array, Array]:
    """Frequencies and densities, NaN along an axis that was not measured."""
    density = np.array([math.nan if value is None else value for value in spectrum.density])
    return spectrum.resolution_hz * np.arange(len(density), dtype=np.float64), density


def _floor(spectrum: SpectrumResult, reading: BandReading) -> float:
    frequency, density = _density(spectrum)
    if np.isnan(density).all():
        return math.nan
    gain = power_gain(reading.rate_hz, reading.band, frequency)
    try:
        return float(spectrum_floor(frequency, density[:, None], gain, max(spectrum.segments, 1.0))[0])
    except InputError as error:
        raise StudyError(f"a verdict needs the sensors' noise: {error}") from error
