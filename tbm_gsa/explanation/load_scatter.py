"""Chance in the band powers of a finite recording: their covariance over realisations of the loads and of the noise.

For Gaussian noise with the one-sided cross-spectral density S_ij of two signals, mean squares over a time T in bands of
shares w_i and w_j have the covariance (Bendat and Piersol, "Random Data", 4th ed., section 8.5)

    cov = 1/T ∫ w_i w_j |S_ij|² df

so that a single one has 2 P² / cov degrees of freedom, twice the bandwidth times T for a flat density. A line of the
cross-power L_ij adds 2 w_i w_j Re(S_ij* L_ij) / T by the noise beside it. S and L are sums over sources: the groups of
loads, S = Σ_r f_r² S_r, what the meshes excite, and the sensors' noise, which no two channels share. Lines of one
frequency in several components add up by their phases, which a longer recording does not average: Σ_c≠d L_c L_d*.
The reading's half overlapping Hann segments use a little less than T.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy.special

from tbm_dynamics.loads.density import SPACING_HZ
from tbm_gsa.explanation.load_transfer import LoadTransfer, MachineMotion
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError

_HANN_2, _HANN_4, _HANN_22 = 3.0 / 8.0, 35.0 / 128.0, 3.0 / 256.0
"""Means over a segment of the window's square, its fourth power, and its square times that of the next segment's."""
_FELT = 1e-20  # of the largest power: below it a column does not feel a group but by rounding


@dataclass(frozen=True, eq=False)
class LoadScatter:
    """Covariance of k band powers over the powers of s sources: r groups of loads, the meshes, the sensors' noise.

    Attributes
    ----------
    transfer : LoadTransfer
    falling : ndarray, shape (s, s, k, k)
        Times the duration in s, (m/s²)⁴ s per powers of both sources: squared factors, 1, the density of the noise.
    staying : ndarray, shape (r, r, k, k)
        (m/s²)⁴ per squared factors: of lines that several components have.
    width : ndarray, shape (k,)
        Band power of noise of unit density, Hz.
    segment_s : float
        Of the reading.
    """

    transfer: LoadTransfer
    falling: Array
    staying: Array
    width: Array
    segment_s: float

    def expected(self, factors: Array, noise: Array) -> Array:
        """Return the mean band powers (k,) at factors (r,), with sensors of the noise densities (k,), m²/s⁴/Hz."""
        return self.transfer.predict(factors) + self.width * noise

    def covariance(self, factors: Array, noise: Array, duration_s: float, coverage: Array | None = None) -> Array:
        """Return the covariance (k, k) of the logarithms of band powers in a recording of a duration.

        Parameters
        ----------
        factors : ndarray, shape (r,)
        noise : ndarray, shape (k,)
        duration_s : float
        coverage : ndarray, shape (k,), optional
            Share of the recording that each statistic's sensor has segments of, by default all. Sensors lose packets
            by themselves: of n and m segments of N two have n m / N in common, so that their covariance is that of the
            whole recording, and only that of a sensor's own bands grows.

        Raises
        ------
        InputError
            A recording shorter than a segment.
        """
        squares, ones = np.square(factors), np.ones_like(noise)
        sources = np.vstack([squares[:, None] * ones, ones, noise])
        found = _summed(self.falling, sources) / effective_duration(duration_s, self.segment_s)
        if coverage is not None:
            points = np.array([one.point for one in self.transfer.statistics])
            found = np.where(points[:, None] == points, found / coverage, found)
        found += _summed(self.staying, sources[: len(squares)])
        powers = self.expected(factors, noise)
        return np.asarray(found / np.outer(powers, powers))

    def only(self, places: Integers) -> Self:
        """Of some statistics (u,) alone."""
        return replace(
            self,
            transfer=self.transfer.only(places),
            falling=self.falling[..., places[:, None], places],
            staying=self.staying[..., places[:, None], places],
            width=self.width[places],
        )

    def scaled(self, groups: Array, meshes: Array, noise: Array, spread: Array | None = None) -> Self:
        """Return those of a machine or of sensors with other powers, correlations left as they are.

        Parameters
        ----------
        groups : ndarray, shape (r, k)
            Powers of each group of loads over those before.
        meshes, noise : ndarray, shape (k,)
            Likewise of the meshes and of the sensors' noise.
        spread : ndarray, shape (r, k), optional
            Standard deviations of the groups over those before; by default as their powers.
        """
        before = self.transfer
        transfer = replace(
            before, gain=before.gain * groups, modulated=before.modulated * groups, meshes=before.meshes * meshes
        )
        sizes = np.vstack([groups if spread is None else spread, meshes, noise])
        return replace(
            self,
            transfer=transfer,
            falling=_scaled(self.falling, sizes),
            staying=_scaled(self.staying, groups),
            width=self.width * noise,
        )


def _summed(covariances: Array, sources: Array) -> Array:
    """Covariance (k, k) of sources of powers (s, k) from those of their pairs, (s, s, k, k)."""
    return np.asarray((covariances * (sources[:, None, :, None] * sources[:, None, :])).sum(axis=(0, 1)))


def _scaled(covariances: Array, sizes: Array) -> Array:
    """Covariances (s, s, k, k) with sizes (s, k) of the sources: of two sources by the geometric mean of both.

    Rows and columns of each block are scaled alike, so that what was positive stays so.
    """
    both = np.sqrt(sizes[:, None] * sizes)
    return np.asarray(covariances * both[..., :, None] * both[..., None, :])


def effective_duration(duration_s: float, segment_s: float) -> float:
    """Time of an even mean with the scatter of that of half overlapping Hann segments of broad noise, s.

    Raises
    ------
    InputError
        A recording shorter than a segment.
    """
    count = int(2.0 * duration_s / segment_s + 1e-6) - 1
    if count < 1:
        raise InputError(f"recording of {duration_s:g} s, allowed: at least a segment of {segment_s:g} s")
    return segment_s * (count * _HANN_2) ** 2 / (count * _HANN_4 + 2 * (count - 1) * _HANN_22)


def load_scatter(motion: MachineMotion) -> LoadScatter:
    """Scatter of the band powers of a machine."""
    density, reading = motion.density, motion.reading
    bin_hz = float(motion.mesh_frequency[1])
    groups, sources = range(len(density.noise)), _LoadSpectra.of(motion)
    noise, lines, on_noise, on_lines = sources.noise, sources.lines, sources.on_noise, sources.on_lines
    near = _nearest(density.frequency, motion.mesh_frequency)
    inside = np.abs(density.frequency[near] - motion.mesh_frequency) <= SPACING_HZ
    mesh, at_mesh = _Spectra.coherent(motion.mesh[inside]), [part.at(near[inside]) for part in noise]
    on_bins = reading.weights(motion.mesh_frequency)
    white = _Spectra.white(motion.mesh.shape[1])
    falling = np.zeros((len(groups) + 2, len(groups) + 2, *(2 * [len(on_bins)]), *(2 * [white.columns])))
    for r in groups:
        for s in groups:
            falling[r, s] = sources.falling(r, s)
        falling[r, -2] = falling[-2, r] = at_mesh[r].summed(mesh, on_bins[:, inside])
        falling[r, -1] = SPACING_HZ * noise[r].summed(white, on_noise) + lines[r].summed(white, on_lines)
        falling[-1, r] = falling[r, -1]
    falling[-2, -1] = falling[-1, -2] = _Spectra.coherent(motion.mesh).summed(white, on_bins)
    falling[-1, -1] = bin_hz * white.summed(white, on_bins)
    staying = np.array([[lines[r].summed(lines[s], on_lines) for s in groups] for r in groups])
    for r in groups:  # less the products of each component's line with itself
        own = np.square(np.abs(motion.lines)) * density.line_power[r][:, None, :]
        staying[r, r] -= np.einsum("bl,cl,loi,lpi->bcop", on_lines, on_lines, own, own, optimize=True)
    width = np.repeat(reading.columns.sum(axis=1), len(on_bins)) * np.tile(
        bin_hz * on_bins.sum(axis=1), len(reading.columns)
    )
    return LoadScatter(
        motion.transfer(), _read(falling, reading.columns), _read(staying, reading.columns), width, reading.segment_s
    )


def group_spread(motion: MachineMotion) -> Array:
    """Return the standard deviation of what each group of loads does alone, times the root of the duration, (r, k)."""
    sources = _LoadSpectra.of(motion)
    own = _read(np.array([[sources.falling(r, r)] for r in range(len(sources.noise))]), motion.reading.columns)
    return np.asarray(np.sqrt(np.diagonal(own[:, 0], axis1=1, axis2=2).clip(0.0)))


def of_logarithms(covariance: Array) -> tuple[Array, Array]:
    """Covariance (k, k) of the logarithms of band powers, and their means (k,), from that of relative band powers.

    The logarithm of a χ² law: its mean lies below that of the law's mean, and it scatters more. Of the degrees of
    freedom there is one at least.
    """
    half = np.maximum(1.0 / np.maximum(np.diag(covariance), 1e-12), 0.5)
    wider = np.sqrt(scipy.special.polygamma(1, half) * half)
    return covariance * np.outer(wider, wider), scipy.special.digamma(half) - np.log(half)


def _nearest(frequency: Array, wanted: Array) -> Integers:
    """Places (m,) of the frequencies (f,), ascending, that are nearest to others (m,)."""
    above = np.searchsorted(frequency, wanted).clip(1, len(frequency) - 1)
    return np.asarray(above - (wanted - frequency[above - 1] < frequency[above] - wanted))


def _read(sums: Array, columns: Array) -> Array:
    """Covariances (…, k, k) of the statistics from those of all columns, (…, b, b, o, o)."""
    found = np.einsum("ao,pq,stbcoq->stabpc", columns, columns, sums, optimize=True)
    count = found.shape[2] * found.shape[3]
    return np.asarray(found.reshape(*found.shape[:2], count, count))


@dataclass(frozen=True, eq=False)
class _LoadSpectra:
    """Cross-spectra of what each group of loads does: its noise, its lines, the noise beside the lines; and weights."""

    noise: list[_Spectra]
    lines: list[_Spectra]
    beside: list[_Spectra]
    on_noise: Array
    on_lines: Array

    @classmethod
    def of(cls, motion: MachineMotion) -> Self:
        density = motion.density
        noise = [_Spectra.of(motion.noise, part) for part in density.noise]
        lines = [_Spectra.of(motion.lines, part) for part in density.line_power]
        near = _nearest(density.frequency, density.line_frequency)
        weights = map(motion.reading.weights, (density.frequency, density.line_frequency))
        return cls(noise, lines, [part.at(near) for part in noise], *weights)

    def falling(self, r: int, s: int) -> Array:
        """Return what two groups do to the covariance of all columns that falls with time, (b, b, o, o)."""
        return np.asarray(
            SPACING_HZ * self.noise[r].summed(self.noise[s], self.on_noise)
            + self.beside[r].summed(self.lines[s], self.on_lines)
            + self.lines[r].summed(self.beside[s], self.on_lines)
        )


@dataclass(frozen=True, eq=False)
class _Spectra:
    """Cross-spectra of the columns that feel a source.

    Attributes
    ----------
    felt : ndarray, shape (n,)
        Columns.
    values : ndarray, shape (f, n, n)
        Of one frequency if they are the same at all.
    columns : int
        Number o of all of them.
    """

    felt: Integers
    values: Array
    columns: int

    @classmethod
    def of(cls, accelerance: Array, density: Array) -> Self:
        """From accelerances (f, o, 6) and densities (f, 6) of the components."""
        motion = accelerance * np.sqrt(density)[:, None, :]
        size = np.square(np.abs(motion)).sum(axis=2).max(axis=0, initial=0.0)
        largest = np.square(np.abs(accelerance)).max(initial=0.0) * density.max(initial=0.0)
        felt = np.flatnonzero(size > _FELT * largest)
        motion = motion[:, felt]
        return cls(felt, motion @ motion.conj().swapaxes(1, 2), accelerance.shape[1])

    @classmethod
    def coherent(cls, amplitudes: Array) -> Self:
        """Of one motion with complex amplitudes (f, o)."""
        products = amplitudes[:, :, None] * amplitudes[:, None, :].conj()
        return cls(np.arange(amplitudes.shape[1]), products, amplitudes.shape[1])

    @classmethod
    def white(cls, columns: int) -> Self:
        """Of noise of unit density that no two columns share."""
        return cls(np.arange(columns), np.eye(columns, dtype=complex)[None], columns)

    def at(self, places: Integers) -> Self:
        """Return those at some of the frequencies."""
        return replace(self, values=self.values[places])

    def summed(self, other: Self, weights: Array) -> Array:
        """Σ_f w_b w_c Re(S_op* T_op), (b, c, o, o), with the weights (b, f) of the bands."""
        count = len(weights)
        found = np.zeros((count, count, self.columns, self.columns))
        both, one, two = np.intersect1d(self.felt, other.felt, return_indices=True)
        if both.size:
            product = self.values[:, one[:, None], one] * other.values[:, two[:, None], two].conj()
            product = np.broadcast_to(product, (weights.shape[1], *product.shape[1:])).real
            pairs = (weights[:, None] * weights).reshape(-1, weights.shape[1])
            sums = pairs @ product.reshape(len(product), -1)
            found[:, :, both[:, None], both] = sums.reshape(count, count, both.size, both.size)
        return found
