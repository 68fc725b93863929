"""What the teeth move from the loads' frequencies to others: modulation of the answer by their varying stiffness.

To the first order in the variation (see `frequency_response`); that leaves out what the second order and momentary loss
of contact add, which is of the same size where the variation is large.
"""

from __future__ import annotations

import numpy as np

from tbm_dynamics.frequency_response import FrequencyResponse
from tbm_dynamics.loads.density import SPACING_HZ, LoadDensity
from tbm_gsa.explanation.band_reading import BandReading
from tbm_msgs_py.base.arrays import Array

_CELL_HZ = 0.25
"""Loads are taken together over so many Hz: where they are moved to, the machine answers alike."""


def modulated_powers(response: FrequencyResponse, density: LoadDensity, scale: Array, reading: BandReading) -> Array:
    """Band powers (r, b, o) along the response's rows that the teeth move there, of each group at a factor of 1.

    Parameters
    ----------
    response : FrequencyResponse
    density : LoadDensity
    scale : ndarray, shape (6,)
        Of the loads at the operating point.
    reading : BandReading
    """
    frequency, bending = _bending(response, density, scale)
    felt = np.flatnonzero(np.abs(bending).max(axis=(1, 2, 3)) > 0.0)
    found = np.zeros((len(bending), len(reading.bands), response.rows))
    end = max(high for _, high in reading.bands) + 1.0
    for harmonic in response.stiffness_harmonics():
        for shift, matrix in ((harmonic.frequency, harmonic.matrix), (-harmonic.frequency, harmonic.matrix.conj())):
            shown = np.flatnonzero(np.abs(frequency + shift) < end)
            if not shown.size:
                continue
            moved = frequency[shown] + shift
            answer = response.coupling_accelerance(moved) @ matrix
            powers = ((answer @ bending[np.ix_(felt, shown)]) * answer.conj()).real.sum(axis=-1)
            found[felt] += reading.weights(np.abs(moved)) @ powers
    return found


def _bending(response: FrequencyResponse, density: LoadDensity, scale: Array) -> tuple[Array, Array]:
    """Frequencies (m,) of cells and lines, and the cross-powers (r, m, 2c, 2c) of the couplings' deflections there."""
    cells, first = np.unique((density.frequency / _CELL_HZ).astype(int), return_index=True)
    parts = []
    for frequency, powers in (
        (density.frequency, density.noise * SPACING_HZ),
        (density.line_frequency, density.line_power),
    ):
        motion = (response.deflection(frequency) * scale) * np.sqrt(powers)[:, :, None, :]
        parts.append(motion @ motion.conj().swapaxes(-1, -2))
    noise, lines = parts
    together = np.add.reduceat(noise, first, axis=1)
    return (
        np.concatenate([(cells + 0.5) * _CELL_HZ, density.line_frequency]),
        np.concatenate([together, lines], axis=1),
    )
