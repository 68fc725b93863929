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
    gearbox_inertia : float
        Rotor and gearbox output turning against each other (kg·m², at the pinion).
    shaft_damping : float
        β of the damping of the gearbox's shaft, β k (s).
    """

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    rows: np.ndarray
    pinion_mesh_mass: float
    gearbox_inertia: float
    shaft_damping: float


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
    description: MachineDescription,
    seat: float = 1.0,
    mount: float = 1.0,
    mount_node: int | None = None,
    powered: bool = True,
    flank: int = 1,
) -> DriveUnit:
    """Build the drive at angle 0, with or without power on its motor.

    `seat` and `mount` are factors on the stiffness of its pinion's seats and of the gearbox on its mount, `mount_node`
    is the node that carries it, by default the template's; `flank` is that on which its pinion rests, 1 or −1.
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
    ratio, (about, *across) = drive.gearbox.ratio, drive.rotor.inertia
    reflected = about * ratio**2
    unit.add_body(rotor, drive.rotor.mass, (reflected, across[0], across[1]))
    for node in (output, rotor):
        unit.add_connection(node, carrier, drive.gearbox_mount, mount)
    for node in (front, rear):
        unit.add_connection(node, carrier, drive.pinion_bearing, seat)
    unit.add_connection(rear, output, drive.spline)
    motor = motor_row(unit, rotor, carrier, ratio)
    if powered:
        unit.C += drive.motor.damping * np.outer(motor, motor)
        unit.K += drive.motor.stiffness * np.outer(motor, motor)
    twist = _gearbox_row(motor, unit.index[output] + 3, unit.index[carrier] + 3)
    pair, turning = gear_pair(drive), drive.gearbox_output.inertia[0]
    return DriveUnit(
        M=unit.M,
        C=unit.C,
        K=unit.K,
        rows=np.array([unit.mesh_row(middle, drive.ring_node, pair, 0.0, flank), pair.turning * twist]),
        pinion_mesh_mass=unit.polar_inertia((front, middle, rear)) / pair.pinion_base_radius**2,
        gearbox_inertia=reflected * turning / (reflected + turning),
        shaft_damping=unit.damping("steel"),
    )


def motor_row(assembler: Assembler, rotor: int, mount: int, ratio: float) -> np.ndarray:
    """Angle between rotor and stator about x, over the ratio i: θ_rotor − θ_mount/i."""
    row = np.zeros(len(assembler.M))
    row[assembler.index[rotor] + 3] = 1.0
    row[assembler.index[mount] + 3] = -1.0 / ratio
    return row


def _gearbox_row(motor: np.ndarray, output: int, mount: int) -> np.ndarray:
    """Twist of the gearbox about x, θ_rotor − θ_output + (1 − 1/i) θ_mount, the rotor's angle being that over i.

    `output` and `mount` are unknowns. A stage's ring is fixed in the mount: relative to it the rotor turns i times as
    fast as the output.
    """
    row = motor.copy()
    row[output] -= 1.0
    row[mount] += 1.0
    return row
