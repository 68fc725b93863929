"""Forces on a rolling disc cutter: the model of the Colorado School of Mines.

Rostami and Ozdemir, A new model for performance prediction of hard rock TBMs, Rapid Excavation and Tunneling
Conference 1993; Rostami, PhD thesis, Colorado School of Mines 1997. The pressure between ring and rock is spread over
the arc of contact φ, and its resultant halves the arc:

    φ = arccos((R − p)/R),  P₀ = C (S σ_c² σ_t / (φ √(R T)))^⅓,  F_t = T R φ P₀ / (1 + ψ)
    F_n = F_t cos(φ/2),  F_r = F_t sin(φ/2)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tbm_dynamics.loads.cutters.description import CutterError, Disc, Rock
from tbm_msgs_py.base.arrays import Array

_C = 2.12
"""Of the pressure; free of units."""


def cutting_forces(rock: Rock, disc: Disc, spacing: ArrayLike, penetration: float) -> tuple[Array, Array]:
    """Compute normal and rolling force of discs.

    Parameters
    ----------
    rock : Rock
    disc : Disc
    spacing : array_like, shape (n,)
        Of the tracks beside each other, m.
    penetration : float
        In a turn of the head, m; none gives no force.

    Returns
    -------
    normal, rolling : (n,) ndarray
        N.

    Raises
    ------
    CutterError
        A spacing that is not positive, a penetration below 0 or of more than the radius.
    """
    tracks = np.asarray(spacing, dtype=float)
    if not np.all(np.isfinite(tracks) & (tracks > 0.0)):
        raise CutterError("spacing of the tracks must be numbers above 0")
    if not 0.0 <= penetration < disc.radius:
        raise CutterError(
            f"penetration {penetration * 1e3:g} mm a turn, allowed are 0 to {disc.radius * 1e3:g} mm, a disc's radius"
        )
    arc = 2.0 * np.arcsin(np.sqrt(0.5 * penetration / disc.radius))
    strength = (rock.ucs_mpa * 1e6) ** 2 * (rock.bts_mpa * 1e6)
    # φ P₀ in one root: no penetration, no force.
    line = _C * np.cbrt(arc**2 * tracks * strength / np.sqrt(disc.radius * disc.tip_width))
    total = disc.tip_width * disc.radius * line / (1.0 + disc.pressure_exponent)
    return total * np.cos(arc / 2.0), total * np.sin(arc / 2.0)
