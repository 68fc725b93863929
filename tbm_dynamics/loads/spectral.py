"""Cutterhead loads as a pure function of (seed, time): band-limited noise plus lines on the means.

White noise, hashed from (seed, component, absolute block), is filtered block by block with one long FIR kernel and
brought to a finer grid by the same inverse FFT; the lines are added there, and a compiled kernel interpolates to the
asked times.
A block is always computed by the very same calls, and a time is always taken from the block it falls in, so the
values depend neither on the order nor on the chunks they are asked in.
"""

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Self

import numba
import numpy as np
import scipy.fft
from numpy.typing import ArrayLike, NDArray

from tbm_dynamics.loads import NOISE_BLOCK, NOISE_HZ
from tbm_dynamics.loads.description import COMPONENTS, LoadComponent, LoadDescription
from tbm_dynamics.loads.noise import hashed_generator
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

FINER = 4
WIDTH = len(COMPONENTS)
GRID_HZ = NOISE_HZ * FINER  # a power of two, so that time * GRID_HZ is exact
GRID_BLOCK = NOISE_BLOCK * FINER
STENCIL = 8  # points of the Lagrange interpolation; 3e-5 of the amplitude at 210 Hz
BEFORE = STENCIL // 2 - 1  # of them before the interval
MARGIN = 4  # noise samples a block knows beyond its end, for the stencils of its last times
TAPS = NOISE_BLOCK - 2 * MARGIN + 1  # the longest odd kernel that two noise blocks feed without wrapping round
KAISER_BETA = 10.06  # 100 dB: 0.1102 (A - 8.7)
TRANSITION_HZ = (100.0 - 8.0) / (2.285 * 2.0 * math.pi) * NOISE_HZ / TAPS  # Kaiser's formula, 0.40 Hz
KEPT_BLOCKS = 6
LONGEST_S = 1e9


class SpectralLoads:
    """The load model `spectral`: the six load components of node 1, N and N·m.

    Parameters
    ----------
    description : LoadDescription
        Means, regions and lines at the reference operating point.
    scale : array_like, shape (6,)
        Factor of each component, mean and fluctuation alike (`LoadDescription.scale`).
    seed : int
        Seed of noise and phases.
    """

    def __init__(self, description: LoadDescription, scale: ArrayLike = (1.0,) * 6, seed: int = 0) -> None:
        self.description = description
        self.seed = seed
        self.scale = _checked_scale(scale)
        self._fluctuation = _fluctuation(description, seed)

    @property
    def mean(self) -> Array:
        """Mean of each component, (6,), N and N·m, at the current scale."""
        return self.scale * self.description.mean

    def with_scale(self, scale: ArrayLike) -> Self:
        """Return the same realisation at another operating point; the computed blocks are shared."""
        other = copy.copy(self)
        other.scale = _checked_scale(scale)
        return other

    def evaluate(self, time: ArrayLike) -> Array:
        """Evaluate the loads at any times.

        Parameters
        ----------
        time : array_like, shape (n,)
            Stream time in s, in any order, negative too, within ±1e9 s.

        Returns
        -------
        ndarray, shape (n, 6)
            N and N·m; the same bits for the same time, however it is asked for.
        """
        times = np.asarray(time, dtype=np.float64)
        if times.ndim != 1:
            raise InputError(f"time must have shape (n,), not {times.shape}")
        if not np.all(np.abs(times) <= LONGEST_S):
            raise InputError(f"time must be finite and within ±{LONGEST_S:g} s")
        loads = np.empty((times.size, WIDTH))
        blocks = np.floor(times * (GRID_HZ / GRID_BLOCK)).astype(np.int64)
        order = np.argsort(blocks, kind="stable")
        for run in np.split(order, np.flatnonzero(np.diff(blocks[order])) + 1):
            if run.size:
                block = int(blocks[run[0]])
                # Exact: a scaling by a power of two and a difference of numbers that are close.
                position = times[run] * GRID_HZ - block * GRID_BLOCK
                loads[run] = _interpolate(self._fluctuation.block(block), position, self.description.mean, self.scale)
        return loads


@dataclass(frozen=True, eq=False)
class _Sinusoid:
    """A line of one component: amplitude · cos 2π(frequency · t + phase)."""

    column: int
    amplitude: float
    frequency: Fraction
    phase: float
    carrier: NDArray[np.complex128]  # exp(2πi · frequency · t) on the grid of a block

    def on_block(self, index: int) -> Array:
        """Values on the grid of a block, (g,)."""
        # Reduced in exact arithmetic: after weeks of run time the phase is as good as at the start.
        cycles = float(self.frequency * (index * GRID_BLOCK // GRID_HZ) % 1) + self.phase
        real, imaginary = np.cos(2.0 * np.pi * cycles), np.sin(2.0 * np.pi * cycles)
        values: Array = self.amplitude * (real * self.carrier.real - imaginary * self.carrier.imag)
        return values


class _Fluctuation:
    """Noise and lines of all components on the grid, block by block, the last few blocks kept."""

    def __init__(self, description: LoadDescription, seed: int) -> None:
        self._description, self._seed = description, seed
        kernels = np.array([noise_kernel(component) for component in description.components])
        self._response = scipy.fft.rfft(kernels, 2 * NOISE_BLOCK, axis=1)
        self._lines = _lines(description, seed)
        self.block = lru_cache(maxsize=KEPT_BLOCKS)(self._compute)

    def __reduce__(self) -> tuple[Callable[..., "_Fluctuation"], tuple[LoadDescription, int]]:
        # A cache does not pickle, and what was computed need not travel: it is a function of these two.
        return _fluctuation, (self._description, self._seed)

    def _compute(self, index: int) -> Array:
        """Grid values from BEFORE points before the block to a few after it, (GRID_BLOCK + …, 6), N and N·m."""
        noise = np.array(
            [np.concatenate([self._white(name, index - 1), self._white(name, index)]) for name in COMPONENTS]
        )
        spectrum = scipy.fft.rfft(noise, axis=1) * self._response
        # The kernel's response ends below the Nyquist frequency, so zeros above it interpolate exactly.
        fine = scipy.fft.irfft(spectrum, 2 * GRID_BLOCK, axis=1) * FINER
        # The first TAPS - 1 noise samples of the circular convolution are wrapped round; the rest is the block.
        first = (NOISE_BLOCK - MARGIN) * FINER - BEFORE
        values = fine[:, first : first + GRID_BLOCK + STENCIL]
        for line in self._lines:
            values[line.column] += line.on_block(index)
        return np.ascontiguousarray(values.T)

    def _white(self, name: str, index: int) -> Array:
        return hashed_generator(self._seed, f"loads/{name}", index).standard_normal(NOISE_BLOCK)


@lru_cache(maxsize=2)
def _fluctuation(description: LoadDescription, seed: int) -> _Fluctuation:
    """Return the realisation of a seed, computed once for all operating points and all simulations of a study."""
    return _Fluctuation(description, seed)


def _checked_scale(scale: ArrayLike) -> Array:
    factors = np.array(scale, dtype=np.float64)
    if factors.shape != (WIDTH,) or not np.all(np.isfinite(factors)):
        raise InputError(f"scale must be {WIDTH} finite factors, not {factors.tolist()}")
    return factors


@lru_cache(maxsize=1)
def _window() -> Array:
    return np.kaiser(TAPS, KAISER_BETA)


def noise_kernel(component: LoadComponent) -> Array:
    """FIR kernel (TAPS,) at `NOISE_HZ` that turns white noise of unit variance into all regions of a component.

    Ideal band-passes under a Kaiser window, their edges moved inwards by half the transition so that each
    band is 100 dB down at its limits; a kernel of unit energy has an output of unit variance.
    """
    time = (np.arange(TAPS) - TAPS // 2) / NOISE_HZ
    total, window = np.zeros(TAPS), _window()
    for region in component.regions:
        low, high = region.filled[0] + TRANSITION_HZ / 2.0, region.filled[1] - TRANSITION_HZ / 2.0
        kernel = window * (2.0 * high * np.sinc(2.0 * high * time) - 2.0 * low * np.sinc(2.0 * low * time))
        total += region.rms / np.linalg.norm(kernel) * kernel
    return total


def _lines(description: LoadDescription, seed: int) -> list[_Sinusoid]:
    """All lines of all components, with hashed phases."""
    time = (np.arange(GRID_BLOCK + STENCIL) - BEFORE) / GRID_HZ
    carriers = {
        line.frequency: np.exp(2j * np.pi * line.frequency * time)
        for component in description.components
        for line in component.lines
    }
    return [
        _Sinusoid(column, line.amplitude, Fraction(line.frequency), phase, carriers[line.frequency])
        for column, (name, component) in enumerate(zip(COMPONENTS, description.components, strict=True))
        for line, phase in zip(component.lines, _phases(name, component, seed), strict=True)
    ]


def _phases(name: str, component: LoadComponent, seed: int) -> list[float]:
    """Phases of the lines of a component, in cycles."""
    return list(hashed_generator(seed, f"loads/{name}/phase").random(len(component.lines)))


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _interpolate(grid: Array, position: Array, mean: Array, scale: Array) -> Array:
    """Lagrange interpolation: scale · (mean + fluctuation), (n, 6).

    The grid (g, 6) is that of `_Fluctuation.block`; the positions (n,) count grid points from the start of the block.
    """
    out = np.empty((position.size, WIDTH))
    below = np.empty(STENCIL)
    above = np.empty(STENCIL)
    inverse = np.ones(STENCIL)
    for k in range(STENCIL):
        for j in range(STENCIL):
            if j != k:
                inverse[k] /= k - j
    for i in range(position.size):
        row = int(position[i])
        x = position[i] - row + BEFORE
        below[0] = 1.0
        above[STENCIL - 1] = 1.0
        for k in range(1, STENCIL):
            below[k] = below[k - 1] * (x - (k - 1))
            above[STENCIL - 1 - k] = above[STENCIL - k] * (x - (STENCIL - k))
        for c in range(WIDTH):
            out[i, c] = mean[c]
        for k in range(STENCIL):
            weight = below[k] * above[k] * inverse[k]
            for c in range(WIDTH):
                out[i, c] += weight * grid[row + k, c]
        for c in range(WIDTH):
            out[i, c] *= scale[c]
    return out
