"""A machine from the side, to scale, in a few shapes: what a person recognises at a glance."""

from __future__ import annotations

from collections.abc import Iterator

from tbm_dynamics.machine.description import MachineDescription
from tbm_dynamics.machine.summary import STRUCTURES
from tbm_dynamics.structure.drive import drive_positions, gear_pair
from tbm_gsa.app.web.state import Picture, Place, Shape

_BODY_M = 0.8
"""Size of a part of which only the mass is known; at most a tenth of the machine."""


def machine_picture(description: MachineDescription) -> Picture:
    """Side view: x from the face to the rear, y up from the axis."""
    places = description.structural_nodes()
    points = tuple(
        Place(point=name, x=-(places[at.node][0] + at.offset[0]), y=places[at.node][2] + at.offset[2])
        for name, at in description.sensor_places.items()
    )
    return Picture(shapes=(*_structure(description), *_drives(description)), places=points)


def _structure(description: MachineDescription) -> Iterator[Shape]:
    places = description.structural_nodes()
    length = max(-place[0] for place in places.values())
    for name in STRUCTURES:
        group = getattr(description, name)
        for shaft in group.shafts:
            along = [-places[node][0] for node in shaft.nodes]
            head = description.load_node in shaft.nodes
            yield _box("head" if head else "structure", min(along), max(along), 0.0, shaft.outer_diameter)
        size = min(_BODY_M, 0.1 * length)
        for body in group.bodies:
            x, _, z = places[body.node]
            yield _box("structure", -x - size / 2.0, size / 2.0 - x, z, size)


def _drives(description: MachineDescription) -> Iterator[Shape]:
    drive = description.driveshaft
    height = 2.0 * gear_pair(drive).pinion_pitch_radius
    for number, angle in enumerate(description.drive_angles):
        nodes = drive_positions(drive, number, float(angle)).values()
        x = [-float(place[0]) for place in nodes]
        yield _box("drive", min(x), max(x), float(next(iter(nodes))[2]), height)


def _box(kind: str, begin: float, end: float, middle: float, height: float) -> Shape:
    return Shape.model_validate(
        {"kind": kind, "x": begin, "y": middle - height / 2.0, "width": end - begin, "height": height}
    )
