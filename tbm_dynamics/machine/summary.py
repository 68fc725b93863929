"""What a machine is made of and how it vibrates: what `machine show` prints, as tables and as JSON."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass

import numpy as np

from tbm_dynamics.loads.cutters.layout import TYPES
from tbm_dynamics.machine.description import MachineDescription, Subsystem
from tbm_dynamics.machine.machine import Machine
from tbm_dynamics.mesh.planetary import stage_law
from tbm_dynamics.structure.assembly import node_positions
from tbm_dynamics.structure.couplings import STAGE_HARMONICS
from tbm_dynamics.structure.drive import drive_angles, drive_nodes, gear_pair
from tbm_dynamics.structure.system import System
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.fields import SOURCES

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
class StageSummary:
    """What follows from the gears of a planetary stage; stiffness as the pinion shaft feels it (N·m/rad)."""

    ratio: float
    sun_contact_ratio: float
    ring_contact_ratio: float
    mesh_frequency_hz: float
    stiffness: float


@dataclass(frozen=True)
class CutterType:
    """Cutters of a type, their discs, and the smallest and largest radius of those (m)."""

    cutters: int
    discs: int
    radius: tuple[float, float]


@dataclass(frozen=True)
class CuttingSummary:
    """The cutters at the operating point: penetration in a turn, mean forces of the face discs, torque of the head."""

    types: dict[str, CutterType]
    penetration_mm: float
    normal_force_kn: float
    rolling_force_kn: float
    torque_kn_m: float


@dataclass(frozen=True)
class ModeSummary:
    """A mode of vibration.

    Attributes
    ----------
    frequency_hz : float
    motion : str
        The largest of the shares.
    node : int
        The one that moves most in that way.
    shares : dict of str to float
        axial, lateral and torsional share of the kinetic energy; above some 600 Hz they overlap in a few modes.
    """

    frequency_hz: float
    motion: str
    node: int
    shares: dict[str, float]


@dataclass(frozen=True)
class MachineSummary:
    """A machine and what follows from its description.

    Attributes
    ----------
    stages : tuple of StageSummary
        From the pinion to the motor.
    cutting : CuttingSummary or None
        None without cutters.
    masses : dict of str to float
        Of each subsystem, and ``total`` (kg).
    sources : dict of str to int
        How many numbers of the file are from where.
    """

    machine: Machine
    nodes: tuple[NodeSummary, ...]
    stages: tuple[StageSummary, ...]
    cutting: CuttingSummary | None
    masses: dict[str, float]
    degrees_of_freedom: int
    modes: tuple[ModeSummary, ...]
    sources: dict[str, int]

    @property
    def gearbox_stiffness(self) -> float:
        """Stiffness of stages and shafts in series as the pinion shaft feels it (N·m/rad)."""
        shafts = self.machine.description.driveshaft.gearbox.shaft_stiffness
        return 1.0 / (1.0 / shafts + sum(1.0 / stage.stiffness for stage in self.stages))

    @property
    def rotor_speed_r_min(self) -> float:
        """Speed of the rotors."""
        drive = self.machine.description.driveshaft
        return 60.0 * (self.machine.mesh_frequency / drive.gear.pinion_teeth) * drive.gearbox.ratio

    def document(self) -> dict[str, object]:
        """Return what `machine show --json` prints: the sections of the file, and what follows from them."""
        description = self.machine.description
        structures, limits, cutters = structures_of(description), description.operating_limits, description.cutters
        groups = [*((name, part.connections) for name, part in structures), (BETWEEN, description.connections)]
        return {
            "machine": self.machine.name,
            "title": description.title,
            "origin": self.machine.origin,
            "operating_point": description.operating_point.model_dump(),
            "operating_limits": limits and limits.model_dump(),
            "nodes": [asdict(node) for node in self.nodes],
            "places": {name: part.source for name, part in structures},
            "shafts": [{"subsystem": name, **s.model_dump()} for name, part in structures for s in part.shafts],
            "bodies": [{"subsystem": name, **b.model_dump()} for name, part in structures for b in part.bodies],
            "connections": [{"where": where, **c.model_dump()} for where, group in groups for c in group],
            "drives": self._drives(),
            "load_factors": description.loads.factors.model_dump(),
            "cutters": cutters and self.cutting and {**cutters.model_dump(), **asdict(self.cutting)},
            "masses": self.masses,
            "degrees_of_freedom": self.degrees_of_freedom,
            "modes": [asdict(mode) for mode in self.modes],
            "sources": self.sources,
        }

    def _drives(self) -> dict[str, object]:
        drive = self.machine.description.driveshaft
        pair, angles = gear_pair(drive), np.degrees(drive_angles(drive))
        meshing = {"contact_ratio": pair.contact_ratio, "mesh_frequency_hz": self.machine.mesh_frequency}
        return {
            **drive.model_dump(include={"count", "source", "ring_node", "mount_node", "placement", "mesh"}),
            "radius": pair.centre_distance,
            "members": [
                {"drive": i + 1, "angle_deg": float(angle), "nodes": drive_nodes(drive, i)}
                for i, angle in enumerate(angles)
            ],
            "parts": drive.model_dump(include=set(DRIVE_PARTS)),
            "connections": [{"name": name, **getattr(drive, name).model_dump()} for name in DRIVE_CONNECTIONS],
            "gear": {**drive.gear.model_dump(), **meshing},
            "gearbox": {
                **drive.gearbox.model_dump(),
                "ratio": drive.gearbox.ratio,
                "stiffness": self.gearbox_stiffness,
                "rotor_speed_r_min": self.rotor_speed_r_min,
                "stages": [
                    {**gears.model_dump(), **asdict(stage)}
                    for gears, stage in zip(drive.gearbox.stages, self.stages, strict=True)
                ],
            },
        }


def machine_summary(machine: Machine, count: int = 10) -> MachineSummary:
    """Summary of a machine with its `count` lowest natural frequencies.

    Raises
    ------
    MachineError
        A machine that cannot be assembled.
    """
    system, description = machine.assemble(), machine.description
    return MachineSummary(
        machine=machine,
        nodes=tuple(_nodes(description)),
        stages=tuple(_stages(machine)),
        cutting=_cutting(machine),
        masses=_masses(description),
        degrees_of_freedom=system.size,
        modes=tuple(_modes(system, count)),
        sources=count_sources(description),
    )


def _cutting(machine: Machine) -> CuttingSummary | None:
    if machine.description.cutters is None:
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
        types,
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
    roles = [(description.load_node, "loads"), (drive.ring_node, "ring gear"), (drive.mount_node, "drive mount")]
    roles += [(node, f"test point {name}") for name, node in description.test_points.items()]
    for i in range(drive.count):
        roles += zip(drive_nodes(drive, i), (f"drive {i + 1} {part}" for part in DRIVE_NODES), strict=True)
    for node, place in node_positions(description).items():
        own = tuple(role for at, role in roles if at == node)
        yield NodeSummary(node, owner.get(node, "driveshaft"), tuple(place.tolist()), own)


def _stages(machine: Machine) -> Iterator[StageSummary]:
    drive, steel = machine.description.driveshaft, machine.description.steel
    pinion_hz = machine.mesh_frequency / drive.gear.pinion_teeth
    speed = 1.0  # of the stage's carrier, over the pinion shaft
    for gears in drive.gearbox.stages:
        law = stage_law(gears, steel.elasticity, steel.poisson, STAGE_HARMONICS)
        yield StageSummary(
            ratio=gears.ratio,
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


def _modes(system: System, count: int) -> Iterator[ModeSummary]:
    frequencies, shapes = system.modes
    for frequency, shape in zip(frequencies[:count], shapes.T, strict=False):
        parts = motion_parts(system, shape)
        energy = {name: float(part @ system.M @ part) for name, part in parts.items()}
        shares = {name: value / sum(energy.values()) for name, value in energy.items()}
        motion = max(shares, key=shares.__getitem__)
        at_nodes = parts[motion].reshape(-1, 6)
        size = np.abs(at_nodes[:, 3]) if motion == "torsional" else np.linalg.norm(at_nodes[:, :3], axis=1)
        # Drives that move alike differ by rounding: the first of them is named.
        node = system.nodes[int(np.argmax(size > (1.0 - 1e-6) * size.max()))]
        yield ModeSummary(float(frequency), motion, node, shares)


def motion_parts(system: System, shape: Array) -> dict[str, Array]:
    """Axial, lateral and torsional part of a motion (n,); together they are the motion.

    The drives stand off the axis: what they do together along it is axial, together around it torsional. Tilting and
    what differs from drive to drive is lateral, a drive's turn about its own axis torsional.
    """
    drives, count = system.drives, len(system.drives.angles)
    own = np.einsum("pij,pj->pi", drives.turns, shape[drives.dofs]).reshape(count, -1, 6)
    split = {name: np.zeros_like(own) for name in ("axial", "torsional")}
    split["axial"][:, :, 0] = own[:, :, 0].mean(axis=0)
    split["torsional"][:, :, 2] = own[:, :, 2].mean(axis=0)
    split["torsional"][:, :, 3] = own[:, :, 3]
    split["lateral"] = own - split["axial"] - split["torsional"]
    found = {}
    for name, columns in (("axial", [0]), ("lateral", [1, 2, 4, 5]), ("torsional", [3])):
        part = np.zeros_like(shape)
        part.reshape(-1, 6)[:, columns] = shape.reshape(-1, 6)[:, columns]
        part[drives.dofs] = np.einsum("pji,pj->pi", drives.turns, split[name].reshape(count, -1))
        found[name] = part
    return found


def count_sources(description: MachineDescription) -> dict[str, int]:
    """How many numbers of a machine file are from which source, the user's own words as one; node numbers are none."""
    written = description.model_dump(exclude_unset=True)
    given = [source for source in _sources(written, None) if source is not None]
    found = Counter(source if source in SOURCES else OWN for source in given)
    return {name: found[name] for name in (*SOURCES, OWN)}


def _sources(value: object, source: str | None) -> Iterator[str | None]:
    """Source of every number within: that of the nearest entry around it."""
    if isinstance(value, Mapping):
        inner = value.get("source", source)
        for key, part in value.items():
            # `nodes` of a shaft are references, those of a subsystem places.
            if not _REFERENCES.fullmatch(str(key)) and (key != "nodes" or isinstance(part, Mapping)):
                yield from _sources(part, inner)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _sources(part, source)
    elif isinstance(value, int | float):
        yield source
