"""Time-varying mesh stiffness over one mesh cycle (paper, Figure 3).

The shape comes from Ishikawa's tooth stiffness along the path of contact, one or two pairs carrying; the mean is the
machine file's. The steps where pairs enter and leave are rounded by a Fourier sum with Lanczos factors: teeth do not
load at once.
"""

from __future__ import annotations

import numpy as np

# Fine enough that straight lines between the steps do not excite the pinions.
TABLE_SIZE = 4096
HARMONICS = 12


def stiffness_table(shape: np.ndarray, mean: float, variation: float = 1.0) -> np.ndarray:
    """Round a stiffness pattern and scale it to its mean.

    Parameters
    ----------
    shape : (n,) ndarray
        Stiffness in the middle of n equal parts of a mesh cycle, any unit.
    mean : float
        k̄ (N/m), kept exactly.
    variation : float
        Share of the variation about the mean that is kept.

    Returns
    -------
    (TABLE_SIZE,) ndarray
        Stiffness at TABLE_SIZE equal steps of the cycle, from phase 0 (N/m).
    """
    harmonics = np.arange(1, HARMONICS + 1)
    coefficients = np.fft.rfft(shape)[1 : HARMONICS + 1] / np.sum(shape)
    # The middle of a part lies half a part after its start, where the table has its step.
    coefficients = coefficients * np.exp(-1j * np.pi * harmonics / len(shape)) * np.sinc(harmonics / (HARMONICS + 1))
    phase = np.arange(TABLE_SIZE) / TABLE_SIZE
    ripple = 2.0 * np.real(np.exp(2j * np.pi * np.outer(phase, harmonics)) @ coefficients)
    return np.asarray(mean * (1.0 + variation * ripple))
