"""One drive, built in its own axes and turned to its place.

The drives are alike but for their couplings, and stand around the x axis: each is the drive at angle 0, turned about x.
So one pair of matrices serves all of them, here and in the reduced basis. A drive's own axes are x, radial, tangential.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tbm_dynamics.mesh.geometry import GearPair
from tbm_dynamics.structure.assembler import Assembler

if TYPE_CHECKING:
    from tbm_dynamics.machine.description import MachineDescription
    from tbm_dynamics.machine.drive import DriveTemplate

OWN_NODES = 5
"""Front seat, mesh node, rear seat, gearbox output, rotor; ring node and mount node follow."""


@dataclass(frozen=True)
class DriveUnit:
    """A drive in its own axes, with what it does to the ring and to the mount: 7 nodes, 42 unknowns.

    Attributes
    ----------
    M, C, K : (42, 42) ndarray
        Without the two couplings.
    rows : (2, 42) ndarray
        Deflection of the mesh (m) and of the gearbox (rad) per unit motion.
    pinion_mesh_mass : float
        The turning pinion reduced to the line of action (kg).
    gearbox_damping : float
        β of the gearbox's damping, β k̄ (s).
    """

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    rows: np.ndarray
    pinion_mesh_mass: float
    gearbox_damping: float


def gear_pair(drive: DriveTemplate) -> GearPair:
    """Geometry of the pinion–ring pair of a drive template."""
    return drive.gear.pair


def drive_nodes(drive: DriveTemplate, i: int) -> tuple[int, ...]:
    """Front seat, mesh node, rear seat, gearbox output and rotor of drive i."""
    pinion, gearbox = drive.pinion_nodes_from + 3 * i, drive.gearbox_nodes_from + 2 * i
    return pinion, pinion + 1, pinion + 2, gearbox, gearbox + 1


def drive_positions(drive: DriveTemplate, i: int, angle: float) -> dict[int, np.ndarray]:
    """Positions (3,) m of the nodes of drive i standing at an angle."""
    radius = gear_pair(drive).centre_distance
    y, z = radius * math.cos(angle), radius * math.sin(angle)
    at = drive.placement
    along = (at.front_seat, at.mesh, at.rear_seat, at.gearbox, at.rotor)
    return {node: np.array([x, y, z]) for node, x in zip(drive_nodes(drive, i), along, strict=True)}


def turn(angle: float) -> np.ndarray:
    """From global axes to those of a drive at an angle, (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])


def drive_unit(
    description: MachineDescription, seat: float = 1.0, mount: float = 1.0, mount_node: int | None = None
) -> DriveUnit:
    """Build the drive at angle 0.

    `seat` and `mount` are factors on the stiffness of its pinion's seats and of the gearbox on its mount, `mount_node`
    is the node that carries it, by default the template's.
    """
    drive = description.driveshaft
    carrier = mount_node or drive.mount_node
    places = description.structural_nodes()
    ends = {node: np.array(places[node], dtype=float) for node in (drive.ring_node, carrier)}
    unit = Assembler(description, {**drive_positions(drive, 0, 0.0), **ends})
    front, middle, rear, output, rotor = drive_nodes(drive, 0)
    shaft = drive.pinion_shaft
    unit.add_shaft((front, middle, rear), shaft.outer_diameter, shaft.inner_diameter, shaft.mass)
    unit.add_body(output, drive.gearbox_output.mass, drive.gearbox_output.inertia)
    about, *across = drive.rotor.inertia
    unit.add_body(rotor, drive.rotor.mass, (about * drive.gearbox.ratio**2, across[0], across[1]))
    for node in (output, rotor):
        unit.add_connection(node, carrier, drive.gearbox_mount, mount)
    for node in (front, rear):
        unit.add_connection(node, carrier, drive.pinion_bearing, seat)
    unit.add_connection(rear, output, drive.spline)
    pair = gear_pair(drive)
    return DriveUnit(
        M=unit.M,
        C=unit.C,
        K=unit.K,
        rows=np.array([_mesh_row(unit, drive, pair), pair.turning * _gearbox_row(unit, output, rotor)]),
        pinion_mesh_mass=unit.polar_inertia((front, middle, rear)) / pair.pinion_base_radius**2,
        gearbox_damping=unit.damping("steel"),
    )


def _mesh_row(unit: Assembler, drive: DriveTemplate, pair: GearPair) -> np.ndarray:
    """Compression of the mesh along its line of action."""
    return unit.mesh_row(drive_nodes(drive, 0)[1], drive.ring_node, pair, 0.0)


def _gearbox_row(unit: Assembler, output: int, rotor: int) -> np.ndarray:
    """Twist between rotor and gearbox output, both about x, of a pinion that drives forwards."""
    row = np.zeros(len(unit.M))
    row[unit.index[rotor] + 3], row[unit.index[output] + 3] = 1.0, -1.0
    return row
