"""The ``cutters:`` section of a machine file: the discs, where they sit, and the rock they cut."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, FiniteFloat

from tbm_dynamics.machine.entries import Entry, Node, NonNegative, Positive
from tbm_msgs_py.base.validation import Line, Source

Share = Annotated[float, Field(ge=0.0, le=1.0)]


class DiscEntry(Entry):
    """A cutter ring: radius and width of its tip (m), exponent ψ of the pressure along the arc of contact."""

    radius: Positive
    tip_width: Positive
    pressure_exponent: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.0
    source: Source


class RockEntry(Entry):
    """Uniaxial compressive and Brazilian tensile strength of the intact rock, MPa."""

    ucs_mpa: Positive
    bts_mpa: Positive
    source: Source


class FractureEntry(Entry):
    """How the rock chips under a disc; see `tbm_dynamics.loads.cutters.fracture.Fracture`."""

    along: Literal["angle", "time"]
    chip: Positive
    jitter: Annotated[float, Field(ge=0.0, le=0.9)]
    heights: tuple[Share, Share]
    release: Annotated[float, Field(ge=0.01, le=0.5)]
    source: Source


class LayerEntry(Entry):
    """Rock above a level (z, m, 0 at the axis): its strength over that of the rock."""

    level: FiniteFloat
    strength: NonNegative


class BoulderEntry(Entry):
    """Rock within a circle: y and z of its centre and its radius (m), its strength over that of the rock."""

    y: FiniteFloat
    z: FiniteFloat
    radius: Positive
    strength: NonNegative


class FaceEntry(Entry):
    """Where rock and cutters differ: zones, a later one over an earlier one; force of cutters over that of new ones."""

    zones: tuple[LayerEntry | BoulderEntry, ...] = ()
    wear: dict[Node, NonNegative] = Field(default_factory=dict)
    source: Source


class CuttersEntry(Entry):
    """The cutters of a head and what reaches the head past them.

    Attributes
    ----------
    layout : str
        Name of a shipped machine whose layout it is, or a CSV file beside the machine file.
    head_radius : float
        m; no disc is farther out.
    side_share : float
        Side force of a gauge disc over its normal force.
    friction_kn, idle_torque_kn_m : float
        Thrust and torque that reach no disc.
    face : FaceEntry, optional
        Even rock and new cutters without it.
    """

    layout: Line
    head_radius: Positive
    disc: DiscEntry
    rock: RockEntry
    fracture: FractureEntry
    side_share: Share
    friction_kn: NonNegative
    idle_torque_kn_m: NonNegative
    face: FaceEntry | None = None
    source: Source
