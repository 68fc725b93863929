"""The eight indicators of the paper's Table 3, and the peaks among them as their expectation."""

from __future__ import annotations

import math

import numpy as np

UNITS = {
    "RDef_A": "m",
    "RDef_L": "m",
    "RDef_R": "rad",
    "PAcc_A": "m/s²",
    "PAcc_L": "m/s²",
    "PAcc_R": "rad/s²",
    "MF_M": "N",
    "MF_Se": "N",
}
"""Unit of each, in the order of the table."""
INDICATORS = tuple(UNITS)

EXPECTED_PEAKS = tuple(f"expected_{name}" for name in ("PAcc_A", "PAcc_L", "PAcc_R"))
"""The expectation, under other loads of the same spectrum, of the peaks among them; in the same units."""
PARTS = 10
"""Into which a run is cut for it: each long enough to hold many swings, so that their peaks are independent draws."""

# axial, lateral, rotational among (x, y, z, rx, ry, rz)
_AXES = (0, 1, 3)


def indicators(
    ring_displacement: np.ndarray, pinion_acceleration: np.ndarray, mesh_force: np.ndarray, static_mesh_force: float
) -> dict[str, float]:
    """Return the indicators of a run.

    Parameters
    ----------
    ring_displacement : (n, 6) ndarray
        Displacement of the ring gear's mesh node, static part included (m, rad).
    pinion_acceleration : (n, 6) ndarray
        Acceleration of the first pinion's mesh node (m/s², rad/s²).
    mesh_force : (n, p) ndarray
        N.
    static_mesh_force : float
        F̄_s: the static mesh force of the mean torque shared equally (N).

    Returns
    -------
    dict
        RDef_A, RDef_L, RDef_R (m, m, rad): RMS displacement; PAcc_A, PAcc_L, PAcc_R (m/s², m/s², rad/s²): peak
        acceleration; MF_M (N): largest mesh force; MF_Se (N): dynamic deviation factor, equation (5).
    """
    rms = np.sqrt(np.mean(ring_displacement[:, _AXES] ** 2, axis=0))
    peak = np.abs(pinion_acceleration[:, _AXES]).max(axis=0)
    deviation = np.sqrt(np.mean((mesh_force - static_mesh_force) ** 2, axis=0)).mean()
    values = (*rms, *peak, mesh_force.max(), deviation)
    return dict(zip(INDICATORS, map(float, values), strict=True))


def expected_peaks(pinion_acceleration: np.ndarray) -> dict[str, float]:
    """Return the peaks that a run of this length has on average.

    A single peak is one draw of an extreme. The largest values of equal parts of the run are taken for draws of a
    Gumbel distribution, fitted by its moments; the expected largest of all parts follows from it [1]_.

    Parameters
    ----------
    pinion_acceleration : (n, 6) ndarray
        Acceleration of the first pinion's mesh node (m/s², rad/s²), n at least `PARTS`.

    Returns
    -------
    dict
        By `EXPECTED_PEAKS`, m/s², m/s², rad/s².

    References
    ----------
    .. [1] E. J. Gumbel, "Statistics of extremes", Columbia University Press, 1958: mean μ + γβ, variance π²β²/6, and
       the largest of n has μ + β ln n for its μ.
    """
    parts = np.array_split(np.abs(pinion_acceleration[:, _AXES]), PARTS)
    peaks = np.array([part.max(axis=0) for part in parts])
    scale = peaks.std(axis=0, ddof=1) * math.sqrt(6.0) / math.pi
    expected = peaks.mean(axis=0) + scale * math.log(PARTS)
    return dict(zip(EXPECTED_PEAKS, map(float, expected), strict=True))
