"""What a machine is made of and how it vibrates, as one document: machine → what `machine show --json` prints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from tbm_dynamics import Machine
from tbm_dynamics.loads.cutters.layout import TYPES
from tbm_dynamics.machine.description import Connection, MachineDescription, Subsystem
from tbm_dynamics.mesh.planetary import stage_law
from tbm_dynamics.structure.assembly import node_positions
from tbm_dynamics.structure.couplings import STAGE_HARMONICS, planetary_stages
from tbm_dynamics.structure.drive import drive_angles, drive_nodes, gear_pair
from tbm_dynamics.structure.system import System
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.validation import SOURCES

STRUCTURES = ("cutterhead_bearing_gear", "carrier_girder")
SUBSYSTEMS = ("cutterhead_bearing_gear", "driveshaft", "carrier_girder")
DRIVE_NODES = ("front seat", "mesh", "rear seat", "gearbox output", "rotor")
PLACES = ("front_seat", "mesh", "rear_seat", "gearbox", "rotor")
"""Keys of their x in the placement of the drives."""
DRIVE_CONNECTIONS = ("pinion_bearing", "spline", "gearbox_mount")
BETWEEN = "between subsystems"
OWN = "measured or documented"
"""What all sources in the words of a user count as."""

# Keys whose numbers name nodes, or count them out: they have no source.
_REFERENCES = frozenset(
    {
        "node",
        "between",
        "load_node",
        "test_points",
        "pinion_nodes_from",
        "gearbox_nodes_from",
        "ring_node",
        "ring_shaft_nodes",
        "mount_node",
    }
)


def machine_summary(machine: Machine, count: int = 10) -> dict[str, Any]:
    """Gather what there is to say about a machine.

    Parameters
    ----------
    machine : Machine
    count : int
        Number of natural frequencies.

    Returns
    -------
    dict
        ``machine``, ``title``, ``origin``; ``operating_point{speed_r_min, torque_kn_m, thrust_kn, source}``;
        ``operating_limits{speed_r_min, torque_kn_m, thrust_kn, power_kw, source}``, null without;
        ``nodes[{node, subsystem, place (m), roles}]``; ``places{subsystem: source}``; ``shafts[{subsystem, nodes,
        outer_diameter, inner_diameter (m), mass (kg), source}]``; ``bodies[{subsystem, node, mass, inertia
        (kg·m²), source}]``; ``connections[{name, where, between, type, stiffness (6: N/m, N·m/rad), source}]``;
        ``drives`` (see `drives_summary`); ``cutters`` (see `cutters_summary`, null without);
        ``masses{subsystem …, total}`` (kg); ``degrees_of_freedom``;
        ``modes[{frequency_hz, motion, node, shares}]``; ``sources{table1 …}``:
        how many numbers of the file come from where.

    Raises
    ------
    MachineError
        A machine that cannot be assembled.
    """
    system = machine.assemble()
    description = machine.description
    limits = description.operating_limits
    return {
        "machine": machine.name,
        "title": description.title,
        "origin": machine.origin,
        "operating_point": description.operating_point.model_dump(),
        "operating_limits": limits and limits.model_dump(),
        "nodes": _nodes(description),
        "places": {name: part.source for name, part in _structures(description)},
        "shafts": [_entry(name, shaft) for name, part in _structures(description) for shaft in part.shafts],
        "bodies": [_entry(name, body) for name, part in _structures(description) for body in part.bodies],
        "connections": list(_connections(description)),
        "drives": drives_summary(machine),
        "cutters": cutters_summary(machine),
        "masses": _masses(description),
        "degrees_of_freedom": system.size,
        "modes": modes_summary(system, count),
        "sources": count_sources(description),
    }


def cutters_summary(machine: Machine) -> dict[str, Any] | None:
    """Gather the cutters of a machine.

    Returns
    -------
    dict or None
        ``types{centre, face, gauge: {cutters, discs, radius: [m, m]}}``; ``disc``, ``rock`` and ``fracture`` as in the
        file; ``side_share``, ``friction_kn``, ``idle_torque_kn_m``, ``source``; and, from the model at the operating
        point, ``penetration_mm``, ``normal_force_kn`` and ``rolling_force_kn`` (means of the face discs) and
        ``torque_kn_m`` of the head.

    Raises
    ------
    MachineError
        A layout that cannot be, or a thrust that the rock cannot take up.
    """
    entry = machine.description.cutters
    if entry is None:
        return None
    loads = machine.cutter_loads()
    layout = loads.head.layout
    kinds = np.array(layout.kind)
    types = {
        kind: {
            "cutters": layout.count(kind),
            "discs": int(np.count_nonzero(kinds == kind)),
            "radius": [float(layout.radius[kinds == kind].min()), float(layout.radius[kinds == kind].max())],
        }
        for kind in TYPES
        if kind in kinds
    }
    wrenches = loads.head.wrenches(loads.penetration)[kinds == "face"]
    return {
        **entry.model_dump(),
        "types": types,
        "penetration_mm": 1e3 * loads.penetration,
        "normal_force_kn": float(-wrenches[:, 0].mean() / 1e3),
        "rolling_force_kn": float((-wrenches[:, 3] / layout.radius[kinds == "face"]).mean() / 1e3),
        "torque_kn_m": float(-loads.mean[3] / 1e3),
    }


def _structures(description: MachineDescription) -> list[tuple[str, Subsystem]]:
    return [(name, getattr(description, name)) for name in STRUCTURES]


def _entry(subsystem: str, entry: Any) -> dict[str, Any]:
    return {"subsystem": subsystem, **entry.model_dump()}


def _nodes(description: MachineDescription) -> list[dict[str, Any]]:
    """Every node with its subsystem, place (m) and what it is for, in ascending order."""
    drive = description.driveshaft
    owner = {node: name for name, part in _structures(description) for node in part.nodes}
    roles: dict[int, list[str]] = {}
    roles.setdefault(description.load_node, []).append("loads")
    roles.setdefault(drive.ring_node, []).append("ring gear")
    roles.setdefault(drive.mount_node, []).append("drive mount")
    for name, node in description.test_points.items():
        roles.setdefault(node, []).append(f"test point {name}")
    for i in range(drive.count):
        for node, part in zip(drive_nodes(drive, i), DRIVE_NODES, strict=True):
            owner[node] = "driveshaft"
            roles.setdefault(node, []).append(f"drive {i + 1} {part}")
    return [
        {"node": node, "subsystem": owner[node], "place": place.tolist(), "roles": roles.get(node, [])}
        for node, place in node_positions(description).items()
    ]


def _connections(description: MachineDescription) -> Iterator[dict[str, Any]]:
    groups: list[tuple[str, Sequence[Connection]]] = [
        *((name, part.connections) for name, part in _structures(description)),
        (BETWEEN, description.connections),
    ]
    for where, connections in groups:
        for connection in connections:
            yield {"name": connection.name, "where": where, **connection.model_dump(exclude={"name"})}


def drives_summary(machine: Machine) -> dict[str, Any]:
    """Describe the drives of a machine.

    Returns
    -------
    dict
        ``count``, ``source``, ``ring_node``, ``mount_node``, ``radius`` off the axis (m), ``placement``;
        ``members[{drive, angle_deg, nodes}]``, nodes being front seat, mesh, rear seat, gearbox output and rotor;
        ``parts{pinion_shaft, gearbox_output, rotor}``;
        ``connections[{name, type, stiffness, source}]``, stiffness along and about x, radial, tangential; ``gear`` and
        ``mesh`` as in the file, with ``contact_ratio`` and ``mesh_frequency_hz``; ``gearbox{ratio, stiffness,
        shaft_stiffness, rotor_speed_r_min, source, stages[{… as in the file, ratio, sun_contact_ratio,
        ring_contact_ratio, mesh_frequency_hz, stiffness}]}``, stiffness in N·m/rad as the pinion shaft feels it.
    """
    drive = machine.description.driveshaft
    angles = np.degrees(drive_angles(drive))
    return {
        "count": drive.count,
        "source": drive.source,
        "ring_node": drive.ring_node,
        "mount_node": drive.mount_node,
        "radius": gear_pair(drive).centre_distance,
        "placement": drive.placement.model_dump(),
        "members": [
            {"drive": i + 1, "angle_deg": float(angle), "nodes": list(drive_nodes(drive, i))}
            for i, angle in enumerate(angles)
        ],
        "parts": {name: getattr(drive, name).model_dump() for name in ("pinion_shaft", "gearbox_output", "rotor")},
        "connections": [{"name": name, **getattr(drive, name).model_dump()} for name in DRIVE_CONNECTIONS],
        "gear": {
            **drive.gear.model_dump(),
            "contact_ratio": gear_pair(drive).contact_ratio,
            "mesh_frequency_hz": machine.mesh_frequency,
        },
        "mesh": drive.mesh.model_dump(),
        "gearbox": _gearbox(machine),
    }


def _gearbox(machine: Machine) -> dict[str, Any]:
    description = machine.description
    drive, steel = description.driveshaft, description.steel
    pinion_hz = machine.mesh_frequency / drive.gear.pinion_teeth
    speed = 1.0  # of the stage's carrier, over the pinion shaft
    stages = []
    for entry, stage in zip(drive.gearbox.stages, planetary_stages(drive), strict=True):
        law = stage_law(stage, steel.elasticity, steel.poisson, STAGE_HARMONICS)
        stages.append(
            {
                **entry.model_dump(),
                "ratio": stage.ratio,
                "sun_contact_ratio": stage.sun_mesh.contact_ratio,
                "ring_contact_ratio": stage.ring_mesh.contact_ratio,
                "mesh_frequency_hz": pinion_hz * speed * stage.ring_teeth,
                "stiffness": float(speed**2 / law.compliance[0]),
            }
        )
        speed *= stage.ratio
    compliance = 1.0 / drive.gearbox.shaft_stiffness + sum(1.0 / stage["stiffness"] for stage in stages)
    return {
        "ratio": drive.gearbox.ratio,
        "stiffness": 1.0 / compliance,
        "shaft_stiffness": drive.gearbox.shaft_stiffness,
        "rotor_speed_r_min": 60.0 * pinion_hz * drive.gearbox.ratio,
        "source": drive.gearbox.source,
        "stages": stages,
    }


def _masses(description: MachineDescription) -> dict[str, float]:
    """Mass of each subsystem and of all (kg)."""
    drive = description.driveshaft
    found = {
        name: sum(shaft.mass for shaft in part.shafts) + sum(body.mass for body in part.bodies)
        for name, part in _structures(description)
    }
    found["driveshaft"] = drive.count * (drive.pinion_shaft.mass + drive.gearbox_output.mass + drive.rotor.mass)
    return {**{name: found[name] for name in SUBSYSTEMS}, "total": sum(found.values())}


def modes_summary(system: System, count: int) -> list[dict[str, Any]]:
    """Describe the lowest modes: frequency (Hz), what moves and the node that moves most.

    Returns
    -------
    list of dict
        ``frequency_hz``; ``shares{axial, lateral, torsional}`` of the kinetic energy (above some 600 Hz the three
        overlap in a few modes); ``motion``: the largest of them; ``node``: the one that moves most in that way.
    """
    frequencies, shapes = system.modes
    found = []
    for frequency, shape in zip(frequencies[:count], shapes.T, strict=False):
        parts = motion_parts(system, shape)
        energy = {name: float(part @ system.M @ part) for name, part in parts.items()}
        shares = {name: value / sum(energy.values()) for name, value in energy.items()}
        motion = max(shares, key=shares.__getitem__)
        at_nodes = parts[motion].reshape(-1, 6)
        size = np.abs(at_nodes[:, 3]) if motion == "torsional" else np.linalg.norm(at_nodes[:, :3], axis=1)
        # Drives that move alike differ by rounding: the first of them is named.
        node = system.nodes[int(np.argmax(size > (1.0 - 1e-6) * size.max()))]
        found.append({"frequency_hz": float(frequency), "motion": motion, "node": node, "shares": shares})
    return found


def motion_parts(system: System, shape: Array) -> dict[str, Array]:
    """Split a motion (n,) into its axial, lateral and torsional part; together they are the motion.

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
    """Count the numbers of a machine file by their source, the user's own words as one; node numbers are none."""
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
            if key not in _REFERENCES and (key != "nodes" or isinstance(part, Mapping)):
                yield from _sources(part, inner)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _sources(part, source)
    elif isinstance(value, int | float):
        yield source
