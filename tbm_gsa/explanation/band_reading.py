"""What is read of a recording: the mean square acceleration of test points along axes in bands."""

# Annotations as they are, no texts: documents with these classes in them look names up elsewhere with pydantic 2.5.
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from tbm_gsa.signals.band_weights import band_weights
from tbm_gsa.signals.conditioning import Band, Frame, common_band, compared_axes
from tbm_gsa.signals.reduction import ReducedSignal
from tbm_gsa.signals.settings import MODEL_RATE_HZ, band_name
from tbm_gsa.signals.spectrum import mixed_spectrum
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

_MOST = 0.5  # of a band


@dataclass(frozen=True)
class Sensor:
    """Where an accelerometer sits.

    Attributes
    ----------
    frame : {"fixed", "rotating"}
    offset : tuple of float or None
        From the node of its test point (m): a rigid arm, by which it feels rotations. By default that of the machine.
    """

    frame: Frame = "fixed"
    offset: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class BandStatistic:
    """Mean square of one point along one compared axis in a band, (m/s²)²."""

    point: str
    axis: str
    low_hz: float
    high_hz: float

    @property
    def name(self) -> str:
        """Name of its root, as an output of a study."""
        return f"rms_{band_name(self.low_hz, self.high_hz)}_{self.point}_{self.axis}"

    def within(self, band_hz: tuple[float, float] | None) -> bool:
        """Whether most of it lies in the band in which a sensor measures; None: all."""
        low, high = band_hz or (self.low_hz, self.high_hz)
        return min(high, self.high_hz) - max(low, self.low_hz) >= _MOST * (self.high_hz - self.low_hz)


@dataclass(frozen=True)
class BandReading:
    """Which band powers are read, and how.

    Attributes
    ----------
    sensors : mapping of str to Sensor
        By test point.
    bands : tuple of (float, float)
        Hz.
    rate_hz : float
        Lowest sampling rate.
    band : Band
        Of the conditioning.
    segment_s : float
        Length of the Hann segments: four seconds, as those of a comparison's spectra at 0.25 Hz.
    """

    sensors: Mapping[str, Sensor]
    bands: tuple[tuple[float, float], ...]
    rate_hz: float = MODEL_RATE_HZ
    band: Band = field(default_factory=lambda: common_band(MODEL_RATE_HZ))
    segment_s: float = 4.0

    @cached_property
    def statistics(self) -> tuple[BandStatistic, ...]:
        """Statistics (k,) in the order point, axis, band."""
        return tuple(
            BandStatistic(point, axis, *limits)
            for point, sensor in self.sensors.items()
            for axis in compared_axes(sensor.frame)
            for limits in self.bands
        )

    @cached_property
    def columns(self) -> Array:
        """Which columns, point by point x, y, z, a compared axis adds up: ones in zeros, (axes, 3 points)."""
        rows = []
        for place, sensor in enumerate(self.sensors.values()):
            for axis in compared_axes(sensor.frame).values():
                row = np.zeros(3 * len(self.sensors))
                row[3 * place + np.array(axis)] = 1.0
                rows.append(row)
        return np.array(rows)

    def weights(self, frequency: Array) -> Array:
        """Share of a power at frequencies (f,) in Hz that each band shows, (b, f)."""
        return band_weights(frequency, self.band, self.rate_hz, self.bands, self.segment_s)

    def of(self, signals: Mapping[str, ReducedSignal], level: int = 0) -> Array:
        """Band powers (k,) of reduced signals at a level of operation, from their spectra."""
        found = []
        for point, sensor in self.sensors.items():
            signal = signals[point]
            if level not in signal.spectra:
                raise InputError(f"{point}: no spectrum at this level of operation")
            total = signal.spectra[level]
            if not np.isclose(total.size, self.segment_s * signal.rate_hz, rtol=0.01):
                raise InputError(f"{point}: no {self.segment_s:g} s without a gap at this level of operation")
            for axis in compared_axes(sensor.frame).values():
                spectrum = mixed_spectrum([(total, 1.0)], axis, signal.rate_hz)
                found.append(self.band_powers(float(spectrum.frequency[1]), spectrum.density))
        return np.concatenate(found)

    def band_powers(self, step_hz: float, density: Array) -> Array:
        """Powers (b,) of the bands of a density (m,) at even frequencies."""
        place = step_hz * (np.arange(len(density)) + 0.25)
        return np.array([step_hz * density[(place >= low) & (place < high)].sum() for low, high in self.bands])

    @property
    def widths(self) -> Array:
        """Powers (k,) of noise of unit density on each column, as far as bands are sharp, Hz."""
        return np.outer(self.columns.sum(axis=1), [high - low for low, high in self.bands]).ravel()
