"""Mesh error from the tangential composite tolerance, ISO 1328-1:1995, Annex A.

e(t) = ½ f_i' sin(2πφ_mesh) + ½ (F_i' − f_i') sin(2πφ_shaft)
"""

from __future__ import annotations

import math


def composite_tolerances(module: float, diameter: float, contact_ratio: float, grade: int) -> tuple[float, float]:
    """Tooth-to-tooth f_i' and total F_i' tangential composite tolerance of a gear (m).

    Parameters
    ----------
    module, diameter : float
        m; pitch diameter of the gear.
    contact_ratio : float
        ε of the pair.
    grade : int
        ISO accuracy grade.
    """
    m, d = module * 1e3, diameter * 1e3
    single_pitch = 0.3 * (m + 0.4 * math.sqrt(d)) + 4.0
    total_pitch = 0.3 * m + 1.25 * math.sqrt(d) + 7.0
    profile = 3.2 * math.sqrt(m) + 0.22 * math.sqrt(d) + 0.7
    factor = 0.2 * (contact_ratio + 4.0) / contact_ratio if contact_ratio < 4.0 else 0.4
    tooth_to_tooth = factor * (4.3 + single_pitch + profile)
    scale = 1e-6 * 2.0 ** ((grade - 5) / 2.0)
    return scale * tooth_to_tooth, scale * (total_pitch + tooth_to_tooth)
