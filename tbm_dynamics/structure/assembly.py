"""From a machine description to M, C, K and the mesh rows."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from tbm_dynamics.machine.description import (
    DampingReading,
    DriveTemplate,
    MachineDescription,
    Shaft,
    SixPositiveOrZero,
)
from tbm_dynamics.machine.loading import MachineError
from tbm_dynamics.machine.machine import Machine
from tbm_dynamics.mesh.error import composite_tolerances
from tbm_dynamics.mesh.geometry import InternalPair
from tbm_dynamics.mesh.ishikawa import mesh_stiffness
from tbm_dynamics.mesh.stiffness import stiffness_table
from tbm_dynamics.structure.beam import Section, beam_mass, beam_stiffness, circular_section, turned
from tbm_dynamics.structure.connection import rigid_arm, spring_rows, spring_stiffness
from tbm_dynamics.structure.system import Meshes, System

# Golden-ratio spacing of the pinions' run-out phases: fixed, and no two alike (assumed).
_GOLDEN = 0.6180339887498949

_PATTERN_PARTS = 2048

# A mode this far below the stiffest one has no energy: real machines stay above 1e-10.
_ZERO_ENERGY = 1e-13


@dataclass
class _Assembler:
    """Adds elements into M, C, K; C_e = β_e K_e with each element's own coefficient."""

    description: MachineDescription
    positions: dict[int, np.ndarray]
    index: dict[int, int] = field(init=False)
    M: np.ndarray = field(init=False)
    C: np.ndarray = field(init=False)
    K: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.index = {node: 6 * i for i, node in enumerate(self.positions)}
        n = 6 * len(self.positions)
        self.M, self.C, self.K = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))

    def dofs(self, *nodes: int) -> np.ndarray:
        return np.concatenate([np.arange(self.index[node], self.index[node] + 6) for node in nodes])

    def add_stiffness(self, nodes: tuple[int, ...], stiffness: np.ndarray, coefficient: float) -> None:
        place = np.ix_(self.dofs(*nodes), self.dofs(*nodes))
        self.K[place] += stiffness
        self.C[place] += coefficient * stiffness

    def add_body(self, node: int, mass: float, inertia: tuple[float, float, float]) -> None:
        dofs = self.dofs(node)
        self.M[dofs, dofs] += [mass, mass, mass, *inertia]

    def add_shaft(self, shaft: Shaft) -> None:
        steel = self.description.steel
        section = circular_section(shaft.outer_diameter, shaft.inner_diameter, steel.poisson)
        spans = [
            (a, b, self.positions[b] - self.positions[a]) for a, b in zip(shaft.nodes, shaft.nodes[1:], strict=False)
        ]
        lengths = [float(np.linalg.norm(vector)) for _, _, vector in spans]
        if min(lengths) <= 0.0:
            raise MachineError(f"{self.description.name}: shaft {shaft.nodes}: two of its nodes are at the same place")
        density = shaft.mass / (section.area * sum(lengths))
        beta = damping_coefficient(steel.damping, self.description.damping)
        for a, b, vector in spans:
            self._add_beam((a, b), vector, section, density, beta)

    def _add_beam(
        self, nodes: tuple[int, int], vector: np.ndarray, section: Section, density: float, beta: float
    ) -> None:
        steel = self.description.steel
        length = float(np.linalg.norm(vector))
        stiffness = beam_stiffness(section, length, steel.elasticity, steel.poisson)
        mass = beam_mass(section, length, density, steel.elasticity, steel.poisson)
        place = np.ix_(self.dofs(*nodes), self.dofs(*nodes))
        self.M[place] += turned(mass, vector)
        self.add_stiffness(nodes, turned(stiffness, vector), beta)

    def add_spring(self, first: int, second: int | str, stiffness: SixPositiveOrZero, kind: str) -> None:
        ratio = (
            self.description.steel.damping
            if kind == "steel"
            else float(getattr(self.description.connection_damping, kind))
        )
        place = self.positions[first]
        grounded = isinstance(second, str)
        rows = spring_rows(place, place, None if grounded else self.positions[int(second)])
        nodes = (first,) if grounded else (first, int(second))
        beta = damping_coefficient(ratio, self.description.damping)
        self.add_stiffness(nodes, spring_stiffness(rows, np.array(stiffness)), beta)

    def polar_inertia(self, nodes: tuple[int, ...]) -> float:
        """Inertia about x of the listed nodes turning together (kg·m²)."""
        turning = np.zeros(len(self.M))
        turning[[self.index[node] + 3 for node in nodes]] = 1.0
        return float(turning @ self.M @ turning)


def damping_coefficient(ratio: float, damping: DampingReading) -> float:
    """β of C_e = β K_e (s) from Table 4's ratio, in the reading of the machine file."""
    return ratio if damping.reading == "stiffness_proportional" else ratio / (math.pi * damping.frequency)


def gear_pair(drive: DriveTemplate) -> InternalPair:
    """Geometry of the pinion–ring pair of a drive template."""
    gear = drive.gear
    return InternalPair(gear.pinion_teeth, gear.ring_teeth, gear.module, math.radians(gear.pressure_angle_deg))


def drive_angles(drive: DriveTemplate) -> np.ndarray:
    """Places of the drives around the ring, shape (count,), rad."""
    return math.radians(drive.first_angle_deg) + 2.0 * math.pi * np.arange(drive.count) / drive.count


def pinion_nodes(drive: DriveTemplate, i: int) -> tuple[int, int, int]:
    """Front seat, mesh node and rear seat of drive i."""
    first = drive.pinion_nodes_from + 3 * i
    return first, first + 1, first + 2


def gearbox_nodes(drive: DriveTemplate, i: int) -> tuple[int, int]:
    """Gearbox output and motor rotor of drive i."""
    first = drive.gearbox_nodes_from + 2 * i
    return first, first + 1


def node_positions(description: MachineDescription) -> dict[int, np.ndarray]:
    """Positions (3,) m of every node, in ascending order of the node numbers."""
    drive = description.driveshaft
    radius = gear_pair(drive).centre_distance
    found = {node: np.array(place, dtype=float) for node, place in description.structural_nodes().items()}
    along = drive.x
    for i, angle in enumerate(drive_angles(drive)):
        y, z = radius * math.cos(angle), radius * math.sin(angle)
        nodes = (*pinion_nodes(drive, i), *gearbox_nodes(drive, i))
        for node, x in zip(
            nodes, (along.front_seat, along.mesh, along.rear_seat, along.gearbox, along.rotor), strict=True
        ):
            found[node] = np.array([x, y, z])
    return dict(sorted(found.items()))


def assemble(machine: Machine) -> System:
    """Assemble a machine; see `Machine.assemble`."""
    description = machine.description
    assembler = _Assembler(description, node_positions(description))
    for subsystem in (description.cutterhead_bearing_gear, description.carrier_girder):
        for shaft in subsystem.shafts:
            assembler.add_shaft(shaft)
        for body in subsystem.bodies:
            assembler.add_body(body.node, body.mass, body.inertia)
    for connection in description.connections:
        first, second = connection.between
        assembler.add_spring(first, second, connection.stiffness, connection.type)
    _add_drives(assembler)
    meshes = _meshes(assembler)
    assembler.K += meshes.mean_stiffness * meshes.rows.T @ meshes.rows
    assembler.C += meshes.damping * meshes.rows.T @ meshes.rows
    _refuse_floating(assembler)
    return System(
        M=assembler.M,
        C=assembler.C,
        K=assembler.K,
        nodes=tuple(assembler.positions),
        meshes=meshes,
        load_dofs=assembler.dofs(description.load_node),
        motor_pattern=_motor_pattern(assembler),
        mean_load=description.loads.mean * machine.load_scale(),
        operating_point=machine.operating_point,
    )


def _add_drives(assembler: _Assembler) -> None:
    drive = assembler.description.driveshaft
    outer, inner, mass = drive.pinion_shaft
    for i in range(drive.count):
        front, middle, rear = pinion_nodes(drive, i)
        gearbox, rotor = gearbox_nodes(drive, i)
        source = drive.sources.get("pinion_shaft", "assumed")
        assembler.add_shaft(
            Shaft(nodes=(front, middle, rear), outer_diameter=outer, inner_diameter=inner, mass=mass, source=source)
        )
        for node, (weight, polar, transverse) in ((gearbox, drive.gearbox_output), (rotor, drive.rotor)):
            assembler.add_body(node, weight, (polar, transverse, transverse))
            assembler.add_spring(node, drive.mount_node, drive.gearbox_mount, "steel")
        for seat in (front, rear):
            assembler.add_spring(seat, drive.mount_node, drive.pinion_bearing, "bearing")
        assembler.add_spring(rear, gearbox, drive.spline, "spline")
        assembler.add_spring(gearbox, rotor, (0.0, 0.0, 0.0, drive.gearbox_torsion, 0.0, 0.0), "steel")


def _mesh_rows(assembler: _Assembler, pair: InternalPair) -> np.ndarray:
    """Deflection of every mesh along its line of action per unit motion of pinion and ring, shape (count, n)."""
    drive = assembler.description.driveshaft
    rows = np.zeros((drive.count, len(assembler.M)))
    ring = assembler.positions[drive.ring_node]
    for i, angle in enumerate(drive_angles(drive)):
        pinion = pinion_nodes(drive, i)[1]
        to_contact = pair.pinion_pitch_radius * np.array([0.0, math.cos(angle), math.sin(angle)])
        place = assembler.positions[pinion] + to_contact
        line = pair.line_of_action(angle)
        rows[i, assembler.dofs(pinion)] = line @ rigid_arm(to_contact)[:3]
        rows[i, assembler.dofs(drive.ring_node)] = -line @ rigid_arm(place - ring)[:3]
    return rows


def _mesh_mass(assembler: _Assembler, pair: InternalPair) -> float:
    """Reduce pinion and ring to their mass along the line of action (kg)."""
    drive = assembler.description.driveshaft
    pinion = assembler.polar_inertia(pinion_nodes(drive, 0))
    ring = assembler.polar_inertia(drive.ring_shaft_nodes)
    return 1.0 / (pair.pinion_base_radius**2 / pinion + pair.ring_base_radius**2 / ring)


def _meshes(assembler: _Assembler) -> Meshes:
    description = assembler.description
    drive = description.driveshaft
    pair, mesh = gear_pair(drive), drive.mesh
    ratio = pair.contact_ratio
    if not 1.0 < ratio < 2.0:
        raise MachineError(
            f"{description.name}: driveshaft.gear: contact ratio {ratio:.3f}; allowed are ratios between 1 and 2"
        )
    tooth, total = composite_tolerances(
        drive.gear.module, 2.0 * pair.pinion_pitch_radius, ratio, drive.gear.accuracy_grade
    )
    return Meshes(
        rows=_mesh_rows(assembler, pair),
        mean_stiffness=mesh.mean_stiffness,
        damping=2.0 * mesh.damping_ratio * math.sqrt(mesh.mean_stiffness * _mesh_mass(assembler, pair)),
        half_gap=mesh.backlash / 2.0,
        stiffness_table=_stiffness_table(description),
        phases=np.mod(pair.ring_teeth * drive_angles(drive) / (2.0 * math.pi), 1.0),
        shaft_phases=np.mod(_GOLDEN * np.arange(drive.count), 1.0),
        tooth_error=0.5 * mesh.error_factor * tooth,
        shaft_error=0.5 * mesh.error_factor * (total - tooth),
        ring_teeth=pair.ring_teeth,
        pinion_teeth=pair.pinion_teeth,
        ring_base_radius=pair.ring_base_radius,
    )


def _stiffness_table(description: MachineDescription) -> np.ndarray:
    drive, steel = description.driveshaft, description.steel
    middles = (np.arange(_PATTERN_PARTS) + 0.5) / _PATTERN_PARTS
    shape = mesh_stiffness(gear_pair(drive), drive.gear.face_width, steel.elasticity, steel.poisson, middles)
    return stiffness_table(shape, drive.mesh.mean_stiffness, drive.mesh.variation)


def _motor_pattern(assembler: _Assembler) -> np.ndarray:
    drive = assembler.description.driveshaft
    share = drive.gear.pinion_teeth / drive.gear.ring_teeth / drive.count
    pattern = np.zeros(len(assembler.M))
    for i in range(drive.count):
        pattern[assembler.index[gearbox_nodes(drive, i)[1]] + 3] += share
        pattern[assembler.index[drive.mount_node] + 3] -= share
    return pattern


def _refuse_floating(assembler: _Assembler) -> None:
    """Raise if some nodes can move without straining anything, or have no mass."""
    nodes = list(assembler.positions)
    for node in nodes:
        if np.any(assembler.M.diagonal()[assembler.dofs(node)] <= 0.0):
            raise MachineError(f"{assembler.description.name}: node {node} has no mass; give it a shaft or a body")
    # Scaled so that translations and rotations of light and heavy parts compare.
    scale = 1.0 / np.sqrt(assembler.M.diagonal())
    values, vectors = np.linalg.eigh(assembler.K * np.outer(scale, scale))
    floating = values < _ZERO_ENERGY * values[-1]
    if np.any(floating):
        moving = np.abs(vectors[:, floating] * scale[:, None]).max(axis=1).reshape(-1, 6).max(axis=1)
        names = [str(node) for node, size in zip(nodes, moving, strict=True) if size > 0.05 * moving.max()]
        raise MachineError(
            f"{assembler.description.name}: {int(floating.sum())} zero-energy mode(s): nodes {', '.join(names)} float; "
            "connect them to the rest or to the ground"
        )
