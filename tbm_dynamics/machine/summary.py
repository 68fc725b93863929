"""What a machine is made of and how it vibrates: what `machine show` prints, as tables and as JSON."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, computed_field

from tbm_dynamics.loads.cutters.description import CutterDescription
from tbm_dynamics.loads.cutters.layout import TYPES
from tbm_dynamics.loads.description import LoadFactors
from tbm_dynamics.machine.description import (
    MachineDescription,
    OperatingLimits,
    SiteOperatingPoint,
)
from tbm_dynamics.machine.drive import (
    DriveBody,
    DriveConnection,
    DriveOverride,
    DrivePlacement,
    DriveShaft,
    Gear,
    Gearbox,
    Mesh,
    Motor,
)
from tbm_dynamics.machine.machine import Machine
from tbm_dynamics.machine.modes import ModeSummary, lowest_modes
from tbm_dynamics.machine.parts import Body, Connection, Shaft, Subsystem
from tbm_dynamics.machine.sensor_place import SensorPlace
from tbm_dynamics.machine.stress import shaft_stresses
from tbm_dynamics.mesh.planetary import PlanetaryStage, stage_law
from tbm_dynamics.structure.assembly import node_positions
from tbm_dynamics.structure.couplings import STAGE_HARMONICS
from tbm_dynamics.structure.drive import drive_nodes, gear_pair
from tbm_msgs_py.base.fields import SOURCES, FrozenModel, Source

STRUCTURES = ("cutterhead_bearing_gear", "carrier_girder")
SUBSYSTEMS = ("cutterhead_bearing_gear", "driveshaft", "carrier_girder")
DRIVE_NODES = ("front seat", "mesh", "rear seat", "gearbox output", "rotor")
DRIVE_PARTS = ("pinion_shaft", "gearbox_output", "rotor")
DRIVE_CONNECTIONS = ("pinion_bearing", "spline", "gearbox_mount")
BETWEEN = "between subsystems"
OWN = "measured or documented"
"""What all sources in the words of a user count as."""

# Keys whose numbers name nodes, or count them out: they have no source.
_REFERENCES = re.compile(r"(.*_)?node|.*_nodes(_from)?|between|test_points")


@dataclass(frozen=True)
class NodeSummary:
    """A node: its subsystem, place (m) and what it is for."""

    node: int
    subsystem: str
    place: tuple[float, ...]
    roles: tuple[str, ...]


@dataclass(frozen=True)
class CutterType:
    """Cutters of a type, their discs, and the smallest and largest radius of those (m)."""

    cutters: int
    discs: int
    radius: tuple[float, float]


class StageSummary(PlanetaryStage):
    """A planetary stage and what follows from its gears; stiffness as the pinion shaft feels it (N·m/rad)."""

    sun_contact_ratio: float
    ring_contact_ratio: float
    mesh_frequency_hz: float
    stiffness: float

    @computed_field  # type: ignore[prop-decorator]
    @property
    def ratio(self) -> float:
        """Turns of the sun per turn of the carrier."""
        return super().ratio


class CuttingSummary(CutterDescription):
    """The cutters, and at the operating point penetration in a turn, mean forces of face discs, torque of the head."""

    types: dict[str, CutterType]
    penetration_mm: float
    normal_force_kn: float
    rolling_force_kn: float
    torque_kn_m: float


class GearSummary(Gear):
    """The gears of pinion and ring, their contact ratio and mesh frequency."""

    contact_ratio: float
    mesh_frequency_hz: float


class GearboxSummary(Gearbox):
    """The gearbox: turns of the rotor per turn of the pinion, speed of the rotors.

    `stiffness` is that of stages and shafts in series as the pinion shaft feels it (N·m/rad).
    """

    stages: tuple[StageSummary, ...]
    stiffness: float
    rotor_speed_r_min: float

    @computed_field  # type: ignore[prop-decorator]
    @property
    def ratio(self) -> float:
        """Turns of the rotor per turn of the pinion."""
        return super().ratio


class ShownShaft(Shaft):
    """A shaft, the subsystem that it is in, and its largest stress under the allowed torque and thrust (Pa)."""

    subsystem: str
    stress: float


class ShownBody(Body):
    """A body, and the subsystem that it is in."""

    subsystem: str


class ShownConnection(Connection):
    """A connection, and the subsystem that it is in, or `BETWEEN`."""

    where: str


class ShownDriveConnection(DriveConnection):
    """A connection of a drive, and its key."""

    name: str


@dataclass(frozen=True)
class DriveMember:
    """One drive, its angle, its nodes in the order of `DRIVE_NODES`, and how it differs from the template."""

    drive: int
    angle_deg: float
    nodes: tuple[int, ...]
    override: DriveOverride | None


class DriveSummary(FrozenModel):
    """The drives; `radius` is the distance of their axes from the machine's (m)."""

    count: int
    source: Source
    ring_node: int
    mount_node: int
    placement: DrivePlacement
    mesh: Mesh
    radius: float
    members: tuple[DriveMember, ...]
    parts: dict[str, DriveShaft | DriveBody]
    connections: tuple[ShownDriveConnection, ...]
    gear: GearSummary
    gearbox: GearboxSummary
    motor: Motor


class MachineSummary(FrozenModel):
    """What `machine show --json` prints: the sections of the file, and what follows from them.

    Attributes
    ----------
    places : dict of str to str
        Sources of the places of the nodes, by subsystem.
    cutters : CuttingSummary or None
        None without cutters.
    time_step : float
        Of its runs, unless another is asked for (s).
    settling : float
        Time that the start of a run is felt, which is left out of its statistics (s).
    masses : dict of str to float
        Of each subsystem, and ``total`` (kg).
    sources : dict of str to int
        How many numbers of the file are from where.
    """

    machine: str
    title: str
    origin: str
    operating_point: SiteOperatingPoint
    operating_limits: OperatingLimits | None
    nodes: tuple[NodeSummary, ...]
    places: dict[str, Source]
    test_points: dict[str, SensorPlace]
    shafts: tuple[ShownShaft, ...]
    bodies: tuple[ShownBody, ...]
    connections: tuple[ShownConnection, ...]
    drives: DriveSummary
    load_factors: LoadFactors
    cutters: CuttingSummary | None
    masses: dict[str, float]
    degrees_of_freedom: int
    time_step: float
    settling: float
    modes: tuple[ModeSummary, ...]
    sources: dict[str, int]


def machine_summary(machine: Machine, count: int = 10) -> MachineSummary:
    """Summary of a machine with its `count` lowest natural frequencies.

    Raises
    ------
    MachineError
        A machine that cannot be assembled.
    """
    from tbm_dynamics.integration.condensed import own_step  # noqa: PLC0415 - compiled code
    from tbm_dynamics.integration.settling import settling_time  # noqa: PLC0415

    system, description = machine.assemble(), machine.description
    structures = structures_of(description)
    groups = [*((name, part.connections) for name, part in structures), (BETWEEN, description.connections)]
    return MachineSummary(
        machine=machine.name,
        title=description.title,
        origin=machine.origin,
        operating_point=description.operating_point,
        operating_limits=description.operating_limits,
        nodes=tuple(_nodes(description)),
        places={name: part.source for name, part in structures},
        test_points=description.sensor_places,
        shafts=tuple(
            ShownShaft(**dict(one.shaft), subsystem=one.subsystem, stress=one.stress)
            for one in shaft_stresses(machine, system)
        ),
        bodies=tuple(ShownBody(**dict(one), subsystem=name) for name, part in structures for one in part.bodies),
        connections=tuple(ShownConnection(**dict(one), where=where) for where, group in groups for one in group),
        drives=_drives(machine),
        load_factors=description.loads.factors,
        cutters=_cutting(machine),
        masses=_masses(description),
        degrees_of_freedom=system.size,
        time_step=own_step(system),
        settling=settling_time(system),
        modes=tuple(lowest_modes(system, count)),
        sources=count_sources(description),
    )


def _drives(machine: Machine) -> DriveSummary:
    drive = machine.description.driveshaft
    pair, angles = gear_pair(drive), np.degrees(machine.description.drive_angles).tolist()
    stages = tuple(_stages(machine))
    pinion_r_min = 60.0 * (machine.mesh_frequency / drive.gear.pinion_teeth)
    return DriveSummary(
        count=drive.count,
        source=drive.source,
        ring_node=drive.ring_node,
        mount_node=drive.mount_node,
        placement=drive.placement,
        mesh=drive.mesh,
        radius=pair.centre_distance,
        members=tuple(
            DriveMember(i + 1, angle, tuple(drive_nodes(drive, i)), machine.description.drives.get(i + 1))
            for i, angle in enumerate(angles)
        ),
        parts={name: getattr(drive, name) for name in DRIVE_PARTS},
        connections=tuple(ShownDriveConnection(**dict(getattr(drive, key)), name=key) for key in DRIVE_CONNECTIONS),
        gear=GearSummary(
            **dict(drive.gear), contact_ratio=pair.contact_ratio, mesh_frequency_hz=machine.mesh_frequency
        ),
        gearbox=GearboxSummary(
            stages=stages,
            shaft_stiffness=drive.gearbox.shaft_stiffness,
            source=drive.gearbox.source,
            stiffness=1.0 / (1.0 / drive.gearbox.shaft_stiffness + sum(1.0 / stage.stiffness for stage in stages)),
            rotor_speed_r_min=pinion_r_min * drive.gearbox.ratio,
        ),
        motor=drive.motor,
    )


def _cutting(machine: Machine) -> CuttingSummary | None:
    cutters = machine.description.cutters
    if cutters is None:
        return None
    loads = machine.cutter_loads()
    layout = loads.head.layout
    kinds = np.array(layout.kind)
    types = {}
    for kind in (kind for kind in TYPES if kind in kinds):
        radius = layout.radius[kinds == kind]
        types[kind] = CutterType(layout.count(kind), len(radius), (float(radius.min()), float(radius.max())))
    wrenches = loads.head.wrenches(loads.penetration)[kinds == "face"]
    return CuttingSummary(
        **dict(cutters),
        types=types,
        penetration_mm=1e3 * loads.penetration,
        normal_force_kn=float(-wrenches[:, 0].mean() / 1e3),
        rolling_force_kn=float((-wrenches[:, 3] / layout.radius[kinds == "face"]).mean() / 1e3),
        torque_kn_m=float(-loads.mean[3] / 1e3),
    )


def structures_of(description: MachineDescription) -> list[tuple[str, Subsystem]]:
    """Return the subsystems that are no drives, with their names."""
    return [(name, getattr(description, name)) for name in STRUCTURES]


def _nodes(description: MachineDescription) -> Iterator[NodeSummary]:
    """Every node in ascending order."""
    drive = description.driveshaft
    owner = {node: name for name, part in structures_of(description) for node in part.nodes}
    mounts = dict.fromkeys((drive.mount_node, *description.mount_nodes), "drive mount")
    roles = [(description.load_node, "loads"), (drive.ring_node, "ring gear"), *mounts.items()]
    roles += [(place.node, _test_point(name, place)) for name, place in description.sensor_places.items()]
    for i in range(drive.count):
        roles += zip(drive_nodes(drive, i), (f"drive {i + 1} {part}" for part in DRIVE_NODES), strict=True)
    for node, place in node_positions(description).items():
        own = tuple(role for at, role in roles if at == node)
        yield NodeSummary(node, owner.get(node, "driveshaft"), tuple(place.tolist()), own)


def _test_point(name: str, place: SensorPlace) -> str:
    arm = ", ".join(f"{value:g}" for value in place.offset)
    return f"test point {name}, off by ({arm}) m" if any(place.offset) else f"test point {name}"


def _stages(machine: Machine) -> Iterator[StageSummary]:
    drive, steel = machine.description.driveshaft, machine.description.steel
    pinion_hz = machine.mesh_frequency / drive.gear.pinion_teeth
    speed = 1.0  # of the stage's carrier, over the pinion shaft
    for gears in drive.gearbox.stages:
        law = stage_law(gears, steel.elasticity, steel.poisson, STAGE_HARMONICS)
        yield StageSummary(
            **dict(gears),
            sun_contact_ratio=gears.sun_mesh.contact_ratio,
            ring_contact_ratio=gears.ring_mesh.contact_ratio,
            mesh_frequency_hz=pinion_hz * speed * gears.ring_teeth,
            stiffness=float(speed**2 / law.compliance[0]),
        )
        speed *= gears.ratio


def _masses(description: MachineDescription) -> dict[str, float]:
    """Mass of each subsystem and of all (kg)."""
    drive = description.driveshaft
    found = {
        name: sum(shaft.mass for shaft in part.shafts) + sum(body.mass for body in part.bodies)
        for name, part in structures_of(description)
    }
    found["driveshaft"] = drive.count * (drive.pinion_shaft.mass + drive.gearbox_output.mass + drive.rotor.mass)
    return {**{name: found[name] for name in SUBSYSTEMS}, "total": sum(found.values())}


def count_sources(description: MachineDescription) -> dict[str, int]:
    """How many numbers of a machine file are from which source, the user's own words as one; node numbers are none."""
    given = [source for source in _sources(description, None) if source is not None]
    found = Counter(source if source in SOURCES else OWN for source in given)
    return {name: found[name] for name in (*SOURCES, OWN)}


def _sources(value: object, source: str | None) -> Iterator[str | None]:
    """Source of every number within that the file states: that of the nearest entry around it."""
    if isinstance(value, BaseModel):
        inner = getattr(value, "source", source)
        for key in value.model_fields_set:
            part = getattr(value, key)
            # `nodes` of a shaft are references, those of a subsystem places.
            if not _REFERENCES.fullmatch(key) and (key != "nodes" or isinstance(part, Mapping)):
                yield from _sources(part, inner)
    elif isinstance(value, Mapping):
        for part in value.values():
            yield from _sources(part, source)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _sources(part, source)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield source
