"""Spectral densities of the load model `spectral`: what its filters let through, and its lines."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.fft

from tbm_dynamics.loads import NOISE_BLOCK, NOISE_HZ
from tbm_dynamics.loads.description import COMPONENTS, LOAD_GROUPS, LoadComponent, LoadDescription
from tbm_msgs_py.base.arrays import Array

_FINER = 4
SPACING_HZ = NOISE_HZ / (_FINER * NOISE_BLOCK)
"""Of the frequencies: 1/64 Hz."""
_LEAST = 1e-9  # of the highest density: what the filters stop


@dataclass(frozen=True, eq=False)
class LoadDensity:
    """Densities of the six components, which are independent, for each group of loads at a factor of 1.

    Attributes
    ----------
    frequency : ndarray, shape (f,)
        Hz, multiples of `SPACING_HZ`: those at which there is noise.
    noise : ndarray, shape (r, f, 6)
        One-sided, N²/Hz and (N·m)²/Hz.
    line_frequency : ndarray, shape (l,)
        Hz, ascending.
    line_power : ndarray, shape (r, l, 6)
        Mean squares of the lines, whose phases are random, N² and (N·m)².
    """

    frequency: Array
    noise: Array
    line_frequency: Array
    line_power: Array


@lru_cache(maxsize=4)
def load_density(description: LoadDescription) -> LoadDensity:
    """Spectral densities of loads at their reference operating point; what their factors are makes no difference."""
    from tbm_dynamics.loads.spectral import noise_kernel  # noqa: PLC0415 - it compiles: only who computes densities

    groups = [description.with_factors(one).components for one in np.eye(len(LOAD_GROUPS))]
    kernels = np.array([[noise_kernel(component) for component in components] for components in groups])
    # White noise of unit variance has the one-sided density 2 / NOISE_HZ.
    noise = np.square(np.abs(scipy.fft.rfft(kernels, _FINER * NOISE_BLOCK))).swapaxes(1, 2) * (2.0 / NOISE_HZ)
    there = np.any(noise > _LEAST * noise.max(axis=1, keepdims=True), axis=(0, 2))
    there[:2] = True  # of loads without noise too there are frequencies
    lines = sorted({line.frequency for component in description.components for line in component.lines})
    return LoadDensity(
        frequency=np.flatnonzero(there).astype(np.float64) * SPACING_HZ,
        noise=noise[:, there],
        line_frequency=np.array(lines),
        line_power=np.array([_line_power(components, lines) for components in groups]),
    )


def _line_power(components: tuple[LoadComponent, ...], lines: list[float]) -> Array:
    power = np.zeros((len(lines), len(COMPONENTS)))
    for column, component in enumerate(components):
        for line in component.lines:
            power[lines.index(line.frequency), column] += line.amplitude**2 / 2.0
    return power
