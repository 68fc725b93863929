"""Faults of one tooth of a pinion: what its pair lacks in stiffness while it is in mesh, once a turn of the pinion.

- ``crack``: a root crack lets the tooth bend further; the pair loses `share` of its stiffness over its whole contact.
- ``pitting``: pits at the pitch line, over half a base pitch, where `share` of the face width no longer touches. In
  thin slices side by side the pair loses that share of its stiffness there.
- ``missing``: the pair carries nothing. Where no other pair is in mesh the force vanishes until the next one enters.

The loss is rounded by the Fourier sum that rounds the pattern of sound teeth (`stiffness`): both load alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from tbm_dynamics.mesh.geometry import GearPair
from tbm_dynamics.mesh.ishikawa import pair_stiffness
from tbm_dynamics.mesh.stiffness import HARMONICS, PATTERN_PARTS
from tbm_msgs_py.base.fields import FrozenModel

_PITTED = 0.5
"""Base pitches around the pitch point over which pits lie (assumed)."""


class ToothFault(FrozenModel):
    """A fault of one pinion tooth, and the share of its stiffness that it costs; none is stated of a missing tooth."""

    fault: Literal["crack", "pitting", "missing"]
    share: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None

    @model_validator(mode="after")
    def _stated_share(self) -> Self:
        if (self.share is None) != (self.fault == "missing"):
            raise ValueError("share: allowed and needed with fault: crack or pitting only, above 0 and below 1")
        return self


def lost_stiffness(fault: ToothFault, pair: GearPair, width: float, elasticity: float, poisson: float) -> np.ndarray:
    """Stiffness (N/m) that a fault takes from a mesh, which has the one that `mesh_stiffness` computes.

    Parameters
    ----------
    fault : ToothFault
    pair : GearPair
    width : float
        Common face width (m).
    elasticity, poisson : float
        Pa, one.

    Returns
    -------
    (z · parts,) ndarray
        In the middle of equal parts of a turn of the pinion of z teeth, which begins where the tooth enters.
    """
    along = (np.arange(pair.pinion_teeth * PATTERN_PARTS) + 0.5) / PATTERN_PARTS
    lost = pair_stiffness(pair, width, elasticity, poisson, along) * (1.0 if fault.share is None else fault.share)
    if fault.fault == "pitting":
        lost = np.where(np.abs(along - pair.pitch_phase) < 0.5 * _PITTED, lost, 0.0)
    spectrum = np.fft.rfft(lost)
    orders = np.arange(len(spectrum)) / pair.pinion_teeth  # of the mesh cycle
    numbers = orders / (HARMONICS + 1)  # 1: the first that is not kept
    spectrum *= np.sinc(numbers) * np.sinc(orders * pair.overlap_ratio(width))
    return np.fft.irfft(np.where(numbers < 1.0, spectrum, 0.0), len(lost))


@dataclass(frozen=True)
class FaultSeries:
    """What a fault takes from the stiffness of one mesh.

    Attributes
    ----------
    drive : int
        Counted from 0.
    entry : float
        Mesh phase at which the tooth enters (cycles).
    turn : int
        Mesh cycles of a turn of the pinion.
    lost : (n,) ndarray
        N/m, see `lost_stiffness`.
    """

    drive: int
    entry: float
    turn: int
    lost: np.ndarray

    def at(self, cycles: np.ndarray) -> np.ndarray:
        """Lost stiffness at mesh phases (n,), N/m, linear between the middles of the parts."""
        place = (cycles - self.entry) / self.turn % 1.0 * len(self.lost) - 0.5
        before = np.floor(place)
        index = before.astype(np.intp)
        share = place - before
        return np.asarray(self.lost[index] * (1.0 - share) + self.lost[(index + 1) % len(self.lost)] * share)
