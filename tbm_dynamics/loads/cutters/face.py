"""A face that is not the same everywhere: the strength of its rock under every disc, and the wear of the cutters."""

from __future__ import annotations

import numpy as np
from numba import njit

from tbm_dynamics.loads.cutters.description import Boulder, CutterError, Face
from tbm_dynamics.loads.cutters.layout import CutterLayout
from tbm_msgs_py.base.arrays import Array

_EDGE = 0.1
"""Width over which one rock gives way to another, m: about the length of contact of a disc."""

_TURN = 720
"""Places on a turn at which a mean is taken."""


def wear_factors(face: Face, layout: CutterLayout) -> Array:
    """Force of every disc over that of a new one, (n,).

    Raises
    ------
    CutterError
        Wear of a cutter that is not there.
    """
    unknown = sorted(set(face.wear) - set(layout.cutter.tolist()))
    if unknown:
        raise CutterError(f"face: no cutter {unknown[0]}, there are {layout.cutter.min()} to {layout.cutter.max()}")
    return np.array([face.wear.get(int(number), 1.0) for number in layout.cutter])


def zone_table(face: Face) -> Array:
    """Zones as rows (y, z, radius, strength), the radius of a layer infinite, (k, 4)."""
    rows = [
        (zone.y, zone.z, zone.radius, zone.strength)
        if isinstance(zone, Boulder)
        else (0.0, zone.level, np.inf, zone.strength)
        for zone in face.zones
    ]
    return np.array(rows).reshape(-1, 4)


def strengths_over_a_turn(face: Face, layout: CutterLayout) -> tuple[Array, Array]:
    """Head angles (m,) and the strength under every disc there, (m, n)."""
    angles = 2.0 * np.pi * (np.arange(_TURN) + 0.5) / _TURN
    if not face.zones:
        return angles, np.ones((_TURN, len(layout.radius)))
    table, places = zone_table(face), list(zip(layout.radius, layout.angle, strict=True))
    found = [[strength(table, r * np.cos(a + turn), r * np.sin(a + turn)) for r, a in places] for turn in angles]
    return angles, np.array(found)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def strength(table: Array, y: float, z: float) -> float:
    """Strength of the rock at a place over that of the even rock."""
    value = 1.0
    for k in range(len(table)):
        inside = z - table[k, 1]
        if np.isfinite(table[k, 2]):
            inside = table[k, 2] - np.hypot(y - table[k, 0], inside)
        share = min(max(inside / _EDGE + 0.5, 0.0), 1.0)
        value += share * (table[k, 3] - value)
    return value
