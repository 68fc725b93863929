"""Forces on a rolling disc cutter: the model of the Colorado School of Mines.

Rostami and Ozdemir, A new model for performance prediction of hard rock TBMs, Rapid Excavation and Tunneling
Conference 1993; Rostami, PhD thesis, Colorado School of Mines 1997. The pressure between ring and rock is spread over
the arc of contact φ, and its resultant halves the arc:

    φ = arccos((R − p)/R),  P₀ = C (S σ_c² σ_t / (φ √(R T)))^⅓,  F_t = T R φ P₀ / (1 + ψ)
    F_n = F_t cos(φ/2),  F_r = F_t sin(φ/2)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tbm_dynamics.loads.cutters.errors import CutterError

_C = 2.12
"""Of the pressure; free of units."""


@dataclass(frozen=True)
class Rock:
    """Intact rock: uniaxial compressive and Brazilian tensile strength, Pa.

    Raises
    ------
    CutterError
        A strength that is not positive.
    """

    compressive_strength: float
    tensile_strength: float

    def __post_init__(self) -> None:
        _positive("rock", self)


@dataclass(frozen=True)
class Disc:
    """A constant-section cutter ring: radius and width of the tip, m.

    Attributes
    ----------
    pressure_exponent : float
        ψ of the pressure along the arc: 0 is even, up to 0.2 for worn, down to −0.2 for sharp rings.

    Raises
    ------
    CutterError
        A size that is not positive, an exponent outside −0.2 to 0.2.
    """

    radius: float = 0.216
    tip_width: float = 0.015
    pressure_exponent: float = 0.0

    def __post_init__(self) -> None:
        if not -0.2 <= self.pressure_exponent <= 0.2:
            raise CutterError(f"disc: pressure_exponent {self.pressure_exponent:g}, allowed are -0.2 to 0.2")
        _positive("disc", self, "pressure_exponent")


def _positive(what: str, entry: Rock | Disc, *but: str) -> None:
    for name, value in vars(entry).items():
        if name not in but and not (np.isfinite(value) and value > 0.0):
            raise CutterError(f"{what}: {name} {value:g}, must be a number above 0")


def cutting_forces(
    rock: Rock, disc: Disc, spacing: ArrayLike, penetration: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
    strength = rock.compressive_strength**2 * rock.tensile_strength
    # φ P₀ in one root: no penetration, no force.
    line = _C * np.cbrt(arc**2 * tracks * strength / np.sqrt(disc.radius * disc.tip_width))
    total = disc.tip_width * disc.radius * line / (1.0 + disc.pressure_exponent)
    return total * np.cos(arc / 2.0), total * np.sin(arc / 2.0)
