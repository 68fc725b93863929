"""What is read of live signals: band powers of spans of time, and the noise of the sensors."""

# Annotations as they are, no texts: documents with these classes in them look names up elsewhere with pydantic 2.5.
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from tbm_gsa.explanation.band_reading import BandReading, BandStatistic, Sensor
from tbm_gsa.explanation.curve_cache import rounded
from tbm_gsa.explanation.observed import ROUNDED, Observed
from tbm_gsa.signals.conditioning import Band, compared_axes, power_gain
from tbm_gsa.signals.noise_floor import spectrum_floor
from tbm_gsa.signals.spans import SpanSpectrum
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.recordings.mapping import SensorMapping

_ALIKE = 0.01  # relative, of the rates and bands of signals that share a reading

Sensors = Mapping[str, SensorMapping]
"""By test point."""
Spectra = Mapping[str, SpanSpectrum]
"""Of one span of time, by test point."""


@dataclass(frozen=True)
class LiveReading:
    """Which band powers are read of live signals; k statistics.

    Attributes
    ----------
    reading : BandReading
    used : tuple of int
        Statistics that the sensors measure.
    noise : tuple of float, k
        Density of the noise of each statistic's sensor, m²/s⁴/Hz.
    coverage : tuple of float, k
        Share of a span that each statistic's sensor has segments of: it may lose packets.
    """

    reading: BandReading
    used: tuple[int, ...]
    noise: tuple[float, ...]
    coverage: tuple[float, ...]

    @classmethod
    def of(cls, spectra: Spectra, sensors: Sensors, bands: Sequence[tuple[float, float]]) -> Self:
        """Return the reading of the points of a span in bands (Hz); noise that a mapping does not state is the span's.

        Raises
        ------
        InputError
            No band below the end of what the signals hold, or none that a sensor measures.
        """
        first = next(iter(spectra.values()))
        rate, high = (min(values) for values in zip(*((s.rate_hz, s.band.high) for s in spectra.values()), strict=True))
        below = tuple(limits for limits in bands if limits[1] <= high)
        if not below:
            raise InputError(f"no band below {high:g} Hz, where the slowest sensor ends: nothing to watch")
        low = max(one.band.low for one in spectra.values())
        places = {point: _place(sensors[point]) for point in spectra}
        band = Band(rounded(low, ROUNDED), rounded(high, ROUNDED))
        reading = BandReading(places, below, rounded(rate, ROUNDED), band)
        used = tuple(k for k, one in enumerate(reading.statistics) if _measures(sensors[one.point], one))
        if not used:
            raise InputError("no axis of a sensor that measures in a band: nothing to watch")
        powers, floor, stated = _powers(reading, spectra), _floor(reading, spectra), _stated(reading, spectra, sensors)
        noise = Observed.of(reading, powers, floor, stated, first.length_ns / NANOSECONDS).bands.noise
        coverage = tuple(min(1.0, spectra[one.point].coverage) for one in reading.statistics)
        return cls(reading, used, tuple(noise.tolist()), coverage)

    def covers(self, spectra: Spectra, sensors: Sensors) -> bool:
        """Whether a span is read alike: of no other points, sensors, slower rates or bands."""
        known, least = self.reading.sensors, 1.0 - _ALIKE
        return all(
            known.get(point) == _place(sensors[point])
            and one.rate_hz > least * self.reading.rate_hz
            and one.band.high > least * self.reading.band.high
            for point, one in spectra.items()
        )

    def log_powers(self, spectra: Spectra) -> Array:
        """Logarithms of the used band powers of a span, NaN of points that were not there for enough of it.

        A channel that is dead has the power of its sensor's noise.
        """
        found = np.maximum(_powers(self.reading, spectra), self.reading.widths * self.noise)
        return np.asarray(np.log(found[list(self.used)]))

    def floor(self, spectra: Spectra) -> Array:
        """Density (k,) of the sensors' noise as a span shows it; as expected of points that were not there."""
        found = _floor(self.reading, spectra)
        return np.where(np.isfinite(found), found, self.noise)


def _place(sensor: SensorMapping) -> Sensor:
    return Sensor(sensor.frame, sensor.offset)


def _measures(sensor: SensorMapping, statistic: BandStatistic) -> bool:
    """Whether a sensor has the axis, and measures in most of the band."""
    return sensor.measured["xyz".index(statistic.axis[0])] and statistic.within(sensor.band_hz)


def _powers(reading: BandReading, spectra: Spectra) -> Array:
    """Band powers (k,), NaN of points that are not there."""
    found = []
    for point, sensor in reading.sensors.items():
        one = spectra.get(point)
        for columns in compared_axes(sensor.frame).values():
            if one is None or not one.enough:
                found.append(np.full(len(reading.bands), np.nan))
            else:
                found.append(reading.band_powers(one.step_hz, one.density[:, list(columns)].sum(axis=1)))
    return np.concatenate(found)


def _floor(reading: BandReading, spectra: Spectra) -> Array:
    """Density (k,) of the noise of each statistic's sensor from the quiet bands of a span; NaN of points not there."""
    found = []
    for point, sensor in reading.sensors.items():
        one, axes = spectra.get(point), compared_axes(sensor.frame).values()
        floor = np.full(3, np.nan)
        if one is not None and one.enough:
            frequency = one.step_hz * np.arange(len(one.density), dtype=np.float64)
            gain = power_gain(one.rate_hz, one.band, frequency)
            floor = spectrum_floor(frequency, one.density, gain, one.total.segments)
        found += [np.full(len(reading.bands), floor[list(columns)].mean()) for columns in axes]
    return np.concatenate(found)


def _stated(reading: BandReading, spectra: Spectra, sensors: Sensors) -> Array:
    """Density (k,) of that noise as the mapping states it; NaN where it does not."""
    known = {point: sensors[point].noise_power_density(spectra[point].rate_hz) for point in reading.sensors}
    return np.array([math.nan if (value := known[one.point]) is None else value for one in reading.statistics])
