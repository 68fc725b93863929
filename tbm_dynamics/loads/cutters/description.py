"""The ``cutters:`` section of a machine file: the discs, the rock that they cut, and how it chips."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Discriminator, Field, FiniteFloat, PositiveInt, Tag, model_validator

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.fields import FrozenModel, Line, NonNegative, Positive, Source

Share = Annotated[float, Field(ge=0.0, le=1.0)]


class CutterError(InputError):
    """A layout, a rock or an operating point that cannot be."""


class Disc(FrozenModel):
    """A constant-section cutter ring.

    Attributes
    ----------
    radius, tip_width : float
        m.
    pressure_exponent : float
        ψ of the pressure along the arc of contact: 0 is even, up to 0.2 for worn, down to −0.2 for sharp rings.
    """

    radius: Positive
    tip_width: Positive
    pressure_exponent: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.0
    source: Source


class Rock(FrozenModel):
    """Uniaxial compressive and Brazilian tensile strength of the intact rock, MPa."""

    ucs_mpa: Positive
    bts_mpa: Positive
    source: Source


class Fracture(FrozenModel):
    """How the rock chips under a disc.

    Attributes
    ----------
    along : "angle" or "time"
        What the teeth of the sawtooth follow each other along.
    chip : float
        Mean length of a tooth: m of the disc's way, or s.
    jitter : float
        Share of that length over which a chip's place is spread.
    heights : tuple of float
        Smallest and largest amplitude of a tooth over the mean force.
    release : float
        Share of a tooth in which the force drops.
    """

    along: Literal["angle", "time"]
    chip: Positive
    jitter: Annotated[float, Field(ge=0.0, le=0.9)]
    heights: tuple[Share, Share]
    release: Annotated[float, Field(ge=0.01, le=0.5)]
    source: Source

    @model_validator(mode="after")
    def _smaller_first(self) -> Self:
        if self.heights[0] > self.heights[1]:
            raise ValueError(f"heights {list(self.heights)}: allowed are 0 to 1, the smaller first")
        return self


class Layer(FrozenModel):
    """Rock above a level (z, m, 0 at the axis): its strength over that of the rock."""

    level: FiniteFloat
    strength: NonNegative


class Boulder(FrozenModel):
    """Rock within a circle: y and z of its centre and its radius (m), its strength over that of the rock."""

    y: FiniteFloat
    z: FiniteFloat
    radius: Positive
    strength: NonNegative


def _kind(zone: object) -> str:
    return "_layer" if isinstance(zone, Layer) or (isinstance(zone, dict) and "level" in zone) else "_boulder"


Zone = Annotated[Annotated[Layer, Tag("_layer")] | Annotated[Boulder, Tag("_boulder")], Discriminator(_kind)]


class Face(FrozenModel):
    """What differs from even rock and new cutters.

    Attributes
    ----------
    zones : tuple of Layer or Boulder
        A later one lies over an earlier one.
    wear : dict of int to float
        Force of a cutter, by its number, over that of a new one: above 1 worn, 0 lost.
    """

    zones: tuple[Zone, ...] = ()
    wear: dict[PositiveInt, NonNegative] = Field(default_factory=dict)
    source: Source


class CutterDescription(FrozenModel):
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
    face : Face, optional
        Even rock and new cutters without it.
    """

    layout: Line
    head_radius: Positive
    disc: Disc
    rock: Rock
    fracture: Fracture
    side_share: Share
    friction_kn: NonNegative
    idle_torque_kn_m: NonNegative
    face: Face | None = None
    source: Source
