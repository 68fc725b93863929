"""Precise time integration: the exponential of a matrix by 2^N doublings (Zhong 1994).

    Δ = τ/2^N,  A = HΔ;  Ta = A + A²(I + A/3 + A²/12)/2;  N times: Ta ← 2Ta + Ta²;  T = I + Ta

The identity is added only at the end, so that the small increment is not lost to rounding. The matrix is balanced
before, its rows and columns scaled by powers of two: displacements and velocities differ by the stiffest frequency, and
every factor of two in the norm is a doubling.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.linalg

_MINIMUM_DOUBLINGS = 20


def precise_exponential(matrix: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """exp(H τ/2) and exp(H τ), each (n, n); the half step is the last doubling but one.

    Parameters
    ----------
    matrix : (n, n) ndarray
        H (1/s).
    step : float
        τ (s).
    """
    balanced, (scale, _) = scipy.linalg.matrix_balance(matrix, permute=False, separate=True)
    norm = float(np.linalg.norm(balanced, 1)) * step
    doublings = max(_MINIMUM_DOUBLINGS, math.ceil(math.log2(norm)) + 8 if norm > 0.0 else 0)
    A = balanced * (step / 2.0**doublings)
    A2 = A @ A
    increment = A + A2 @ (np.eye(len(A)) + A / 3.0 + A2 / 12.0) / 2.0
    half = increment
    for _ in range(doublings):
        half = increment
        increment = 2.0 * increment + increment @ increment
    identity, back = np.eye(len(A)), np.outer(scale, 1.0 / scale)
    return identity + back * half, identity + back * increment


def polynomial_response(H: np.ndarray, E: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """State after half a step and a step of v̇ = H v + E (u + w s + y s²/2).

    Solved exactly by one exponential of the augmented system, which needs no inverse of H.

    Parameters
    ----------
    H : (s, s) ndarray
    E : (s, p) ndarray
    step : float
        τ (s).

    Returns
    -------
    half, whole : (s, s + 3p) ndarray
        v(τ/2) and v(τ) = [T, P0, P1, P2] · [v, u, w, y].
    """
    s, p = E.shape
    augmented = np.zeros((s + 3 * p, s + 3 * p))
    augmented[:s, :s] = H
    augmented[:s, s : s + p] = E
    augmented[s : s + 2 * p, s + p :] = np.eye(2 * p)
    half, whole = precise_exponential(augmented, step)
    return half[:s], whole[:s]
