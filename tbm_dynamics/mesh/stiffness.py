"""Time-varying mesh stiffness over one mesh cycle.

The two-level pattern of the contact ratio ε, one pair k₁ and two pairs k₂ in contact, as a Fourier series

    k(φ) = k̄ + Σ_n [2(k₂−k₁)/(nπ)] sin(nπ(ε−1)) cos(n(2πφ − π(ε−1))),   k̄ = (ε−1)k₂ + (2−ε)k₁

with φ the mesh phase in cycles. Lanczos factors take the Gibbs overshoot out of the finite sum: teeth do not load at
once.
"""

from __future__ import annotations

import math

import numpy as np

TABLE_SIZE = 4096
_HARMONICS = 12


def stiffness_table(mean: float, double_to_single: float, contact_ratio: float) -> np.ndarray:
    """Mesh stiffness at TABLE_SIZE equal steps of one mesh cycle, shape (TABLE_SIZE,), N/m.

    Parameters
    ----------
    mean : float
        k̄ (N/m), kept exactly.
    double_to_single : float
        k₂/k₁, from 1 (no variation) to 2 and a little more.
    contact_ratio : float
        ε, 1 < ε < 2.
    """
    share = contact_ratio - 1.0
    single = mean / (share * double_to_single + (1.0 - share))
    step = (double_to_single - 1.0) * single
    phase = np.arange(TABLE_SIZE) / TABLE_SIZE
    table = np.full(TABLE_SIZE, mean)
    for n in range(1, _HARMONICS + 1):
        amplitude = 2.0 * step / (n * math.pi) * math.sin(n * math.pi * share) * np.sinc(n / (_HARMONICS + 1))
        table += amplitude * np.cos(n * (2.0 * math.pi * phase - math.pi * share))
    return table
