"""Time-varying mesh stiffness over one mesh cycle (paper, Figure 3).

The shape comes from Ishikawa's tooth stiffness along the path of contact, one or two pairs carrying. The steps where
pairs enter and leave are rounded by a Fourier sum with Lanczos factors: teeth do not load at once.
"""

from __future__ import annotations

import numpy as np

HARMONICS = 12
PATTERN_PARTS = 2048
"""Equal parts of a mesh cycle in which a stiffness pattern is computed."""


def rounded_variation(shape: np.ndarray, overlap: float = 0.0, harmonics: int = HARMONICS) -> np.ndarray:
    """Fourier coefficients of a stiffness pattern over its mean, rounded.

    Parameters
    ----------
    shape : (n,) ndarray
        Stiffness in the middle of n equal parts of a mesh cycle, any unit.
    overlap : float
        Overlap ratio ε_β of helical teeth: thin slices of them, side by side, mesh one after the other over so many
        cycles, those in the middle of the face at the phase of spur teeth, and the pattern is their mean.
    harmonics : int
        h.

    Returns
    -------
    (2h,) ndarray
        Cosine and sine coefficient of each harmonic, over the mean.
    """
    numbers = np.arange(1, harmonics + 1)
    coefficients = 2.0 * np.fft.rfft(shape)[1 : harmonics + 1] / np.sum(shape)
    # The middle of a part lies half a part after its start, where the cycle begins.
    coefficients = coefficients * np.exp(-1j * np.pi * numbers / len(shape)) * np.sinc(numbers / (harmonics + 1))
    coefficients = coefficients * np.sinc(numbers * overlap)
    found = np.empty(2 * harmonics)
    found[0::2], found[1::2] = coefficients.real, -coefficients.imag
    return found
