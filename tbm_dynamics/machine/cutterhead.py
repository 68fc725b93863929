"""The ``cutters:`` section of a machine file as the head that makes its loads."""

from __future__ import annotations

from pathlib import Path

from tbm_dynamics.loads.cutters import (
    Boulder,
    CutterError,
    Cutterhead,
    CutterLoads,
    Disc,
    Face,
    Fracture,
    Layer,
    Rock,
    read_layout,
)
from tbm_dynamics.machine.cutters import BoulderEntry, FaceEntry
from tbm_dynamics.machine.machine import Machine
from tbm_msgs_py.base.errors import MachineError


def cutter_loads(machine: Machine, seed: int) -> CutterLoads:
    """Make the loads; see `Machine.cutter_loads`."""
    entry, origin = machine.description.cutters, machine.origin
    if entry is None:
        raise MachineError(f"{origin}: cutters: missing; the cutter level of the loads needs this section")
    beside = Path(origin).parent / entry.layout
    try:
        head = Cutterhead(
            layout=read_layout(beside if beside.is_file() else entry.layout, entry.head_radius),
            disc=Disc(entry.disc.radius, entry.disc.tip_width, entry.disc.pressure_exponent),
            rock=Rock(entry.rock.ucs_mpa * 1e6, entry.rock.bts_mpa * 1e6),
            fracture=Fracture(**entry.fracture.model_dump(exclude={"source"})),
            side_share=entry.side_share,
            friction=entry.friction_kn * 1e3,
            idle_torque=entry.idle_torque_kn_m * 1e3,
            face=_face(entry.face),
        )
        point = machine.operating_point
        return CutterLoads(head, point.thrust, point.speed, seed)
    except CutterError as error:
        raise MachineError(f"{origin}: cutters: {error}") from None


def _face(entry: FaceEntry | None) -> Face:
    if entry is None:
        return Face()
    zones = [(Boulder if isinstance(zone, BoulderEntry) else Layer)(**zone.model_dump()) for zone in entry.zones]
    return Face(tuple(zones), entry.wear)
