"""From a machine description to M, C, K and the couplings."""

from __future__ import annotations

from statistics import mode
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from tbm_dynamics.structure.assembler import Assembler
from tbm_dynamics.structure.couplings import build_couplings
from tbm_dynamics.structure.drive import (
    OWN_NODES,
    DriveUnit,
    drive_nodes,
    drive_positions,
    drive_unit,
    gear_pair,
    motor_row,
    turn,
)
from tbm_dynamics.structure.system import Drives, System
from tbm_msgs_py.base.errors import MachineError
from tbm_msgs_py.base.operating_point import OperatingPoint

if TYPE_CHECKING:
    from tbm_dynamics.machine.description import MachineDescription
    from tbm_dynamics.machine.machine import Machine

# A mode this far below the stiffest one has no energy: real machines stay above 1e-10.
_ZERO_ENERGY = 1e-13


def node_positions(description: MachineDescription) -> dict[int, np.ndarray]:
    """Positions (3,) m of every node, in ascending order of the node numbers."""
    found = {node: np.array(place, dtype=float) for node, place in description.structural_nodes().items()}
    for i, angle in enumerate(description.drive_angles):
        found |= drive_positions(description.driveshaft, i, angle)
    return dict(sorted(found.items()))


def assemble(machine: Machine) -> System:
    """M, C, K and the couplings of a machine.

    Raises
    ------
    MachineError
        A part that floats, or gears that cannot mesh; one line that names the file and the changed inputs.
    """
    try:
        return _assembled(machine.description, machine.load_scale(), machine.operating_point)
    except MachineError as error:
        changed = ", ".join(f"{code}={float(value):.10g}" for code, value in machine.inputs.items())
        label = f"{machine.origin} with {changed}" if changed else machine.origin
        raise MachineError(f"{label}: {error}") from None


def _assembled(description: MachineDescription, load_scale: np.ndarray, point: OperatingPoint) -> System:
    assembler = Assembler(description, node_positions(description))
    for subsystem in (description.cutterhead_bearing_gear, description.carrier_girder):
        for shaft in subsystem.shafts:
            assembler.add_shaft(shaft.nodes, shaft.outer_diameter, shaft.inner_diameter, shaft.mass)
        for body in subsystem.bodies:
            assembler.add_body(body.node, body.mass, body.inertia)
    for connection in description.all_connections():
        assembler.add_connection(*connection.between, connection)
        assembler.turn_against(connection)
    ring_inertia = assembler.polar_inertia(description.driveshaft.ring_shaft_nodes)
    drives, rows, unit = _add_drives(assembler)
    couplings = build_couplings(description, unit, rows, ring_inertia)
    assembler.K += rows.T @ (couplings.stiffness[:, None] * rows)
    assembler.C += rows.T @ (couplings.damping[:, None] * rows)
    cylinders, oil = _cylinders(assembler)
    controlled = _controlled(assembler, cylinders, oil)
    _refuse_floating(assembler, assembler.K if controlled is None else assembler.K - controlled)
    return System(
        M=assembler.M,
        C=assembler.C,
        K=assembler.K,
        nodes=tuple(assembler.positions),
        couplings=couplings,
        drives=drives,
        load_dofs=assembler.dofs(description.load_node),
        motor_pattern=_motor_pattern(assembler),
        mean_load=description.loads.mean * load_scale,
        operating_point=point,
        cylinders=cylinders,
        controlled=controlled,
        rock_damping=sum(assembler.turning_damping(one) for one in description.all_connections()),
    )


def _add_drives(assembler: Assembler) -> tuple[Drives, np.ndarray, DriveUnit]:
    """Turn the drive to every place: where the drives are, the rows of their couplings (2p, n), the usual drive."""
    description, drive = assembler.description, assembler.description.driveshaft
    mounts = description.mount_nodes
    kinds = [
        (one.seat_stiffness, one.mount_stiffness, mount, not one.off, 1 if one.weight > 0.0 else -1)
        for one, mount in zip(description.each_drive, mounts, strict=True)
    ]
    units = {kind: drive_unit(description, *kind) for kind in set(kinds)}
    angles = np.array(description.drive_angles)
    rows, turns = np.zeros((2, drive.count, len(assembler.M))), []
    for i, angle in enumerate(angles):
        nodes = (*drive_nodes(drive, i), drive.ring_node, mounts[i])
        R = np.kron(np.eye(2 * len(nodes)), turn(float(angle)))
        one = units[kinds[i]]
        assembler.add_matrices(nodes, R.T @ one.M @ R, R.T @ one.C @ R, R.T @ one.K @ R)
        rows[:, i, assembler.dofs(*nodes)] = one.rows @ R
        turns.append(R[: 6 * OWN_NODES, : 6 * OWN_NODES])
    own = np.array([assembler.dofs(*drive_nodes(drive, i)) for i in range(drive.count)])
    # Without a controller a motor with power is as one without.
    alike = mode(kinds)
    odd = tuple(i for i, kind in enumerate(kinds) if kind[2] != alike[2] or not _equal(units[kind], units[alike]))
    turned = [one.off != "uncoupled" for one in description.each_drive]
    return (
        Drives(angles, own, np.array(turns), odd, rotors=own[turned, -3]),
        rows.reshape(2 * drive.count, -1),
        units[alike],
    )


def _cylinders(assembler: Assembler) -> tuple[np.ndarray | None, float]:
    """Extension (n,) of the cylinders that hold the thrust per unit motion, and the stiffness of their oil (N/m)."""
    for connection in assembler.description.all_connections():
        if connection.force_controlled:
            first, second = connection.between
            row = np.zeros(len(assembler.M))
            row[assembler.index[first]], row[assembler.index[int(second)]] = 1.0, -1.0
            return row, float(connection.stiffness_rows[0, 0])
    return None, 0.0


def _controlled(assembler: Assembler, cylinders: np.ndarray | None, oil: float) -> np.ndarray | None:
    """Stiffness (n, n) of cylinders and motors that hold a mean force."""
    drive, found = assembler.description.driveshaft, np.zeros_like(assembler.K)
    if cylinders is not None:
        found += oil * np.outer(cylinders, cylinders)
    if drive.motor.stiffness:
        powered = [not one.off for one in assembler.description.each_drive]
        rows = _motor_rows(assembler)[powered]
        found += drive.motor.stiffness * (rows.T @ rows)
    return found if found.any() else None


def _motor_rows(assembler: Assembler) -> np.ndarray:
    """Angle between rotor and stator of each drive per unit motion, (p, n)."""
    drive = assembler.description.driveshaft
    return np.array(
        [
            motor_row(assembler, drive_nodes(drive, i)[-1], mount, drive.gearbox.ratio)
            for i, mount in enumerate(assembler.description.mount_nodes)
        ]
    )


def _motor_pattern(assembler: Assembler) -> np.ndarray:
    """Generalised force (n,) of the motors, which share the torque by their weights."""
    drive, weights = assembler.description.driveshaft, np.array(assembler.description.motor_weights)
    unit = gear_pair(drive).turning * drive.gear.pinion_teeth / drive.gear.ring_teeth
    return np.asarray(unit / weights.sum() * weights @ _motor_rows(assembler))


def _equal(one: DriveUnit, other: DriveUnit) -> bool:
    return all(np.array_equal(getattr(one, key), getattr(other, key)) for key in ("M", "C", "K", "rows"))


def _refuse_floating(assembler: Assembler, stiffness: np.ndarray) -> None:
    """Raise if some nodes can move without straining anything, or have no mass; `stiffness` holds mean loads."""
    nodes = list(assembler.positions)
    for node, masses in zip(nodes, assembler.M.diagonal().reshape(-1, 6), strict=True):
        if masses.min() <= 0.0:
            raise MachineError(f"node {node} has no mass; give it a shaft or a body")
    # Scaled so that translations and rotations of light and heavy parts compare.
    scale = 1.0 / np.sqrt(assembler.M.diagonal())
    scaled = stiffness * scale * scale[:, None]
    if _sound(scaled):
        return
    values, vectors = scipy.linalg.eigh(scaled)
    floating = values < _ZERO_ENERGY * values[-1]
    if np.any(floating):
        moving = np.abs(vectors[:, floating] * scale[:, None]).max(axis=1).reshape(-1, 6).max(axis=1)
        names = [str(node) for node, size in zip(nodes, moving, strict=True) if size > 0.05 * moving.max()]
        raise MachineError(
            f"{int(floating.sum())} zero-energy mode(s): nodes {', '.join(names)} float; "
            "connect them to the rest or to the ground"
        )


def _sound(stiffness: np.ndarray) -> bool:
    """Whether a Cholesky factor alone shows that no mode is without energy, much faster than the modes themselves."""
    try:
        factor = scipy.linalg.cholesky(stiffness, lower=True)
    except np.linalg.LinAlgError:
        return False
    estimate, _ = scipy.linalg.lapack.dpocon(factor, np.linalg.norm(stiffness, 1), uplo="L")
    return bool(estimate > 10.0 * _ZERO_ENERGY)
