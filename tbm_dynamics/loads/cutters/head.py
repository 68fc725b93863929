"""From the forces on the discs to the six components on the head."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tbm_dynamics.loads.cutters.layout import CutterLayout, FloatArray


def wrench_rows(layout: CutterLayout) -> FloatArray:
    """Six components about the head's centre per unit normal, rolling and side force of each disc, (3, n, 6).

    The head stands at angle 0 and turns from y towards z. The rock pushes a disc back along its plane (`normal`), holds
    it back against its way (`rolling`) and pushes it inwards, across its plane (`side`).
    """
    cosine, sine = np.cos(layout.angle), np.sin(layout.angle)
    zero = np.zeros_like(cosine)
    outward, along = np.array([zero, cosine, sine]), np.array([zero, -sine, cosine])
    axis = np.array([[1.0], [0.0], [0.0]])
    normal = -np.cos(layout.tilt) * axis - np.sin(layout.tilt) * outward
    side = np.sin(layout.tilt) * axis - np.cos(layout.tilt) * outward
    places = (layout.radius * outward).T
    rows = [np.hstack([force, np.cross(places, force)]) for force in (normal.T, -along.T, side.T)]
    return np.array(rows)


def head_wrench(layout: CutterLayout, normal: ArrayLike, rolling: ArrayLike, side: ArrayLike = 0.0) -> FloatArray:
    """Sum of forces (n,) on the discs at head angle 0: (6,) N and N·m."""
    forces = np.array([np.broadcast_to(part, layout.radius.shape) for part in (normal, rolling, side)])
    found: FloatArray = np.einsum("kn,knc->c", forces, wrench_rows(layout))
    return found


def turned(wrench: FloatArray, angle: ArrayLike) -> FloatArray:
    """Give the components of a wrench fixed to the head, (…, 6), in fixed axes at head angles (…), rad."""
    cosine, sine = np.cos(angle), np.sin(angle)
    found = np.array(np.broadcast_to(wrench, (*np.shape(angle), 6)))
    for y, z in ((1, 2), (4, 5)):
        found[..., y], found[..., z] = (
            cosine * wrench[..., y] - sine * wrench[..., z],
            sine * wrench[..., y] + cosine * wrench[..., z],
        )
    return found
