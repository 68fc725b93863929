"""The drives of a machine file: one template, repeated around the ring, and how single drives differ from it."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, FiniteFloat, model_validator

from tbm_dynamics.machine.springs import Springs
from tbm_dynamics.mesh.faults import ToothFault
from tbm_dynamics.mesh.geometry import ExternalPair, GearPair, HelixAngle, InternalPair, Shift
from tbm_dynamics.mesh.planetary import PlanetaryStage
from tbm_msgs_py.base.fields import FrozenModel, NonNegative, Positive, Source, SparseModel

Node = Annotated[int, Field(ge=1)]


class Gear(SparseModel):
    """The pinion–ring pair.

    Attributes
    ----------
    ring : "internal" or "external"
        Whether the pinions turn inside the ring, with it, or around it, the other way.
    pinion_teeth, ring_teeth : int
    module, pressure_angle_deg : float
        In the normal section, m and degrees.
    helix_angle_deg : float
        Of helical teeth, at the reference circle; where it is positive the teeth push the ring forwards.
    profile_shift : (float, float)
        Of pinion and ring in modules, each positive away from its axis; the pair works without play at the centre
        distance that follows.
    face_width : float
        Common one, m.
    accuracy_grade : int
        ISO 1328-1.
    """

    optional: ClassVar[tuple[str, ...]] = ("ring", "helix_angle_deg", "profile_shift")

    ring: Literal["internal", "external"] = "internal"
    pinion_teeth: Annotated[int, Field(ge=5)]
    ring_teeth: Annotated[int, Field(ge=10)]
    module: Positive
    pressure_angle_deg: Annotated[float, Field(gt=10.0, lt=35.0)]
    helix_angle_deg: HelixAngle = 0.0
    profile_shift: tuple[Shift, Shift] = (0.0, 0.0)
    face_width: Positive
    accuracy_grade: Annotated[int, Field(ge=0, le=12)]
    source: Source

    @model_validator(mode="after")
    def _pinion_inside(self) -> Self:
        if self.ring == "internal" and self.pinion_teeth >= self.ring_teeth:
            raise ValueError(f"pinion_teeth {self.pinion_teeth} must be fewer than ring_teeth {self.ring_teeth}")
        _ = self.pair.working_angle  # refused here if there is none
        return self

    @property
    def pair(self) -> GearPair:
        """Its geometry; `GearError` of one that cannot be is for its check."""
        kind = InternalPair if self.ring == "internal" else ExternalPair
        angles = math.radians(self.pressure_angle_deg), math.radians(self.helix_angle_deg)
        return kind(self.pinion_teeth, self.ring_teeth, self.module, *angles, *self.profile_shift)


class Mesh(FrozenModel):
    """Meshing parameters (paper, Table 4: x7 … x10)."""

    mean_stiffness: Positive
    variation: Annotated[float, Field(ge=0.0, le=1.0)] = 1.0
    """Share of Ishikawa's variation about the mean that is kept."""
    backlash: NonNegative
    error_factor: NonNegative = 1.0
    damping_ratio: NonNegative
    source: Source


class Gearbox(FrozenModel):
    """The planetary gearbox of a drive, condensed to one torsional coupling between its output and the rotor.

    `stages` run from the pinion to the motor. `shaft_stiffness` (N·m/rad, pinion side) stands for everything else that
    twists in between, in series with the stages.
    """

    stages: tuple[PlanetaryStage, ...] = ()
    shaft_stiffness: Positive
    source: Source

    @property
    def ratio(self) -> float:
        """Turns of the rotor per turn of the pinion."""
        return math.prod(stage.ratio for stage in self.stages)


class Motor(FrozenModel):
    """How the motors hold the head: their torque alone, or their speed.

    `torque`: each gives its share of the mean torque, whatever its speed is. `speed`: about that torque, a controller
    that holds the speed: proportional `damping` (N·m·s/rad) and integral `stiffness` (N·m/rad), both at the pinion, of
    the rotor against its mount. An induction motor without a controller is one with the damping of its slip, its rated
    torque over its slip speed.
    """

    control: Literal["torque", "speed"] = "torque"
    damping: NonNegative = 0.0
    stiffness: NonNegative = 0.0
    scatter: Annotated[float, Field(ge=0.0, le=0.3)] = 0.0
    """Standard deviation of the torques of motors that run, over their mean: what a master leaves of its slaves."""
    source: Source = "assumed"

    @model_validator(mode="after")
    def _held_by_something(self) -> Self:
        if (self.control == "speed") != (self.damping > 0.0):
            raise ValueError(f"damping {self.damping:g}: must be positive with control: speed, is 0 with torque")
        if self.control == "torque" and self.stiffness > 0.0:
            raise ValueError(f"stiffness {self.stiffness:g}: allowed with control: speed only")
        return self


class DrivePlacement(FrozenModel):
    """Angle of the first drive, and x of the five nodes of one drive (m): seats, mesh, gearbox output and rotor."""

    first_angle_deg: FiniteFloat = 0.0
    front_seat: FiniteFloat
    mesh: FiniteFloat
    rear_seat: FiniteFloat
    gearbox: FiniteFloat
    rotor: FiniteFloat
    source: Source


class DriveShaft(FrozenModel):
    """The pinion shaft through front seat, mesh node and rear seat: diameters (m) and mass (kg)."""

    outer_diameter: Positive
    inner_diameter: NonNegative = 0.0
    mass: Positive
    source: Source


class DriveBody(FrozenModel):
    """A rigid body of a drive: mass (kg) and moments of inertia about x and two axes across (kg·m²)."""

    mass: Positive
    inertia: tuple[Positive, Positive, Positive]
    source: Source


class DriveConnection(Springs):
    """A connection of a drive, along and about x, the radial and the tangential direction of the drive."""


class DriveTemplate(FrozenModel):
    """One drive, repeated `count` times at equal angles around the ring.

    Drive i has the pinion nodes `pinion_nodes_from + 3i …` (front seat, mesh, rear seat) and
    `gearbox_nodes_from + 2i …` (gearbox output, motor rotor).
    """

    count: Annotated[int, Field(ge=1, le=40)]
    source: Source
    pinion_nodes_from: Node
    gearbox_nodes_from: Node
    ring_node: Node
    ring_shaft_nodes: Annotated[tuple[Node, ...], Field(min_length=1)]
    mount_node: Node
    placement: DrivePlacement
    pinion_shaft: DriveShaft
    gearbox_output: DriveBody
    rotor: DriveBody
    """Inertia about x at the motor's speed; it counts times the ratio squared on the pinion side."""
    pinion_bearing: DriveConnection
    """k_b,pc of each of the two seats, to the mount."""
    spline: DriveConnection
    """k_s,pg from the rear seat to the gearbox output."""
    gearbox_mount: DriveConnection
    """Of gearbox output and of rotor on the mount; about x it must be free."""
    gear: Gear
    mesh: Mesh
    gearbox: Gearbox
    motor: Motor = Motor()

    @model_validator(mode="after")
    def _hollow_pinion_shaft(self) -> Self:
        shaft = self.pinion_shaft
        if shaft.inner_diameter >= shaft.outer_diameter:
            raise ValueError(
                f"pinion_shaft: inner_diameter {shaft.inner_diameter} must be smaller than "
                f"outer_diameter {shaft.outer_diameter}"
            )
        return self

    @model_validator(mode="after")
    def _free_rotation(self) -> Self:
        for key in ("gearbox_mount", "pinion_bearing"):
            if getattr(self, key).stiffness_rows[3].any():
                raise ValueError(f"{key}: the stiffness about x must be 0, the drive turns in it")
        return self


def _off(given: object) -> object:
    """Return the word for a yes or no."""
    return {True: "dragged", False: None}[given] if isinstance(given, bool) else given


class DriveOverride(SparseModel):
    """How a drive differs from the template; what is left out is the template's.

    Attributes
    ----------
    angle : float or None
        Place around the x axis (degrees) instead of that at equal angles.
    backlash : float or None
        m, instead of the template's.
    mesh_error, tooth_stiffness, seat_stiffness, mount_stiffness : float
        Factors on the template's mesh error, mesh stiffness, seats and mount of gearbox and rotor.
    mount_node : int or None
        Node that carries it, on the x axis, instead of the template's.
    torque_share : float or None
        Weight in the torque of the head, which is shared in proportion: 1 of a motor that runs, 0 of one that is off,
        below 0 of a drive that brakes by its drag.
    off : "dragged", "uncoupled" or None
        The motor gives no torque; dragged (in a file also `true`) it turns with its pinion, uncoupled it does not.
    eccentricity : float
        Of the pinion's teeth about its shaft (m), beside the run-out that its accuracy grade allows.
    misalignment : float
        Share of the face width that does not touch. In thin slices side by side the teeth lose that share of their
        stiffness; of ISO 6336-1's face load factor K_Hβ of at least 2 it is 1 − 2/K_Hβ.
    tooth : ToothFault or None
    """

    optional: ClassVar[tuple[str, ...]] = ("mount_stiffness", "mount_node")

    angle: Annotated[FiniteFloat, Field(ge=-360.0, le=360.0)] | None = None
    backlash: NonNegative | None = None
    mesh_error: NonNegative = 1.0
    tooth_stiffness: Positive = 1.0
    torque_share: Annotated[FiniteFloat, Field(gt=-1.0)] | None = None
    off: Annotated[Literal["dragged", "uncoupled"] | None, BeforeValidator(_off)] = None
    seat_stiffness: Positive = 1.0
    mount_stiffness: Positive = 1.0
    mount_node: Node | None = None
    eccentricity: NonNegative = 0.0
    misalignment: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    tooth: ToothFault | None = None
    source: Source = "assumed"

    @model_validator(mode="after")
    def _one_torque(self) -> Self:
        share, most = self.torque_share, {"dragged": 0.0, "uncoupled": -1.0}.get(self.off or "", math.inf)
        if share is not None and share > most:
            allowed = "0, or below for its drag" if self.off == "dragged" else "none is stated"
            raise ValueError(f"torque_share {share:g}: the drive is {self.off}, allowed: {allowed}")
        return self

    @property
    def weight(self) -> float:
        """Weight in the torque of the head."""
        return float(not self.off) if self.torque_share is None else self.torque_share
