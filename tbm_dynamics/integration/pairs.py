"""A linear system in the eigenvectors of its first-order matrix, in real pairs.

There the transfer over a step is a 2×2 matrix for each pair, and the response to polynomial inputs is known in closed
form for every eigenvalue, whatever the damping couples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from tbm_msgs_py.base.errors import SimulationError

# Beyond this the eigenvectors lose more digits than the indicators can spare.
_WORST_CONDITION = 1e9


@dataclass(frozen=True)
class Eigenbasis:
    """Real form of the eigenvectors of H: pairs (a, b) of states, complex conjugates or two real ones.

    Attributes
    ----------
    vectors : (s, s) ndarray
        v = vectors · (a, b), the a of all pairs first.
    inverse : (s, s) ndarray
        (a, b) = inverse · v.
    values : (2, s/2) ndarray of complex
        Eigenvalue that each a and each b belongs to: λ and its conjugate, or two real ones.
    paired : (s/2,) ndarray of bool
        Whether the pair is a complex one.
    """

    vectors: np.ndarray
    inverse: np.ndarray
    values: np.ndarray
    paired: np.ndarray


def eigenbasis(H: np.ndarray) -> Eigenbasis:
    """Eigenvectors of H (s, s), s even, in pairs.

    Raises
    ------
    SimulationError
        Eigenvectors that are nearly dependent.
    """
    values, vectors = scipy.linalg.eig(H) if len(H) else (np.zeros(0), H)
    upper = np.flatnonzero(values.imag > 0.0)
    real = np.flatnonzero(values.imag == 0.0)
    first, second = real[0::2], real[1::2]
    a = np.hstack([vectors[:, upper].real, vectors[:, first].real])
    b = np.hstack([-vectors[:, upper].imag, vectors[:, second].real])
    pairs = np.array(
        [np.concatenate([values[upper], values[first]]), np.concatenate([values[upper].conj(), values[second]])]
    )
    inverse, condition = _inverse(np.hstack([a, b]))
    if condition > _WORST_CONDITION:
        raise SimulationError(
            f"the eigenvectors of the damped system are nearly dependent (condition {condition:.1e}); "
            "change a damping ratio slightly, or use method 'full'"
        )
    return Eigenbasis(np.hstack([a, b]), inverse, pairs, np.arange(pairs.shape[1]) < len(upper))


def _inverse(vectors: np.ndarray) -> tuple[np.ndarray, float]:
    """Inverse of eigenvectors (s, s), and their condition, of unit length each, in the norm of all elements."""
    try:
        inverse = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        return vectors, np.inf
    lengths = np.linalg.norm(vectors, axis=0)
    return inverse, float(np.sqrt(len(vectors)) * np.linalg.norm(lengths[:, None] * inverse))


def scalar_responses(values: np.ndarray, step: float) -> np.ndarray:
    """exp(λτ) and the response over a step for every eigenvalue λ, complex.

    Returns
    -------
    (6, n) ndarray
        Transfer; input linear over the step by its value now and at the end; residual quadratic through its values a
        step before, now and at the end.
    """
    phi1, phi2, phi3 = phi_functions(values * step)
    # Responses to 1, s/τ and (s/τ)²/2.
    p0, p1, p2 = step * phi1, step * phi2, step * phi3
    transfer = np.exp(values * step)
    return np.array([transfer, p0 - p1, p1, p2 - 0.5 * p1, p0 - 2.0 * p2, p2 + 0.5 * p1])


def phi_functions(z: np.ndarray) -> np.ndarray:
    """φ₁, φ₂ and φ₃ of complex numbers (n,), (3, n), from φ₀ = eᶻ and φₖ = zφₖ₊₁ + 1/k!.

    See Hochbruck and Ostermann, Acta Numerica 19, 2010. The latter solved for φₖ₊₁ loses digits where z is small:
    there φ₃ is its series.
    """
    near = np.abs(z) < 1.0
    small, large = np.where(near, z, 0.0), np.where(near, 1.0, z)
    series = np.zeros_like(z)
    for j in range(20, 2, -1):
        series = series * small + 1.0 / math.factorial(j)
    phi3 = np.where(near, series, (((np.exp(large) - 1.0) / large - 1.0) / large - 0.5) / large)
    phi2 = z * phi3 + 0.5
    return np.array([z * phi2 + 1.0, phi2, phi3])


def as_pairs(basis: Eigenbasis, factors: np.ndarray) -> np.ndarray:
    """Real 2×2 action of complex factors (2, m) of the eigenvalues on the pairs, rows (aa, ab, ba, bb), (4, m).

    λ acts on (a, b) of v = a·Re φ − b·Im φ as [[Re, −Im], [Im, Re]]; two real ones act on their own.
    """
    upper, lower = factors
    zero = np.zeros(len(basis.paired))
    imaginary = np.where(basis.paired, upper.imag, zero)
    second = np.where(basis.paired, upper.real, lower.real)
    return np.array([upper.real, -imaginary, imaginary, second])


def act(action: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Apply 2×2 actions (4, m) on pairs to columns of states (2m, c)."""
    a, b = np.split(states, 2)
    aa, ab, ba, bb = action[:, :, None]
    return np.vstack([aa * a + ab * b, ba * a + bb * b])
