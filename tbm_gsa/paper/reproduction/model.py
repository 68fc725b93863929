"""What the machine is made of: Tables 3 to 5, Figures 2, 3 and 6. Nearly all of it is given."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from tbm_dynamics import Machine
from tbm_dynamics.machine.description import MachineDescription
from tbm_dynamics.machine.inputs import input_values
from tbm_dynamics.structure.drive import gear_pair
from tbm_gsa.paper.published import MARKED_NODES, MEASURED_POINTS, SUBSYSTEMS, TABLE_5, Six
from tbm_gsa.paper.reproduction import verdict
from tbm_gsa.paper.reproduction.result import Row
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS, Input
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.topics import absolute, model_block

MESH_CYCLES: Final = 4.0
_POINTS: Final = 801
# Table 4's initial torque and thrust differ from Table 1's, at which the machine stands.
_OPERATING: Final = ("x2", "x3")


@dataclass(frozen=True, eq=False)
class MeshCurves:
    """Stiffness and error of the meshes over a few mesh cycles: the paper's Figure 3.

    Attributes
    ----------
    cycles : ndarray, shape (n,)
        Mesh phase of the head.
    stiffness : ndarray, shape (n, p)
        N/m.
    error : ndarray, shape (n, p)
        m.
    frequency : float
        Mesh frequency, Hz.
    """

    cycles: Array
    stiffness: Array
    error: Array
    frequency: float


def mesh_curves(machine: Machine) -> MeshCurves:
    """Evaluate the meshes of a machine."""
    couplings = machine.assemble().couplings
    cycles = np.linspace(0.0, MESH_CYCLES, _POINTS)
    stiffness, error, _ = couplings.waves.evaluate(cycles)
    return MeshCurves(cycles, stiffness[:, : couplings.drives], error[:, : couplings.drives], machine.mesh_frequency)


def model_rows(machine: Machine, curves: MeshCurves) -> Iterator[Row]:
    """Rows of Tables 4 and 5 and Figures 2, 3 and 6."""
    description = machine.description
    yield from _structure(description)
    yield from _options(description)
    yield from _mesh(machine, curves)
    yield from _points(description)
    yield from _inputs(description)
    for name, paper in TABLE_5.items():
        yield _stiffness(name, paper, description)


def _structure(description: MachineDescription) -> Iterator[Row]:
    parts = ", ".join(SUBSYSTEMS)
    yield Row("figure2.subsystems", "subsystems", parts, parts, "given", "the form of every machine file")
    drive = description.driveshaft
    points = {name: place.node for name, place in description.sensor_places.items()}
    ours = {**points, "ring gear": drive.ring_node, "first pinion": drive.pinion_nodes_from + 1}
    for name, node in MARKED_NODES.items():
        found = ours.get(name)
        same = verdict.echoed(found == node)
        yield Row(f"figure2.node.{name.replace(' ', '_')}", f"node of the {name}", node, found, same)


def _options(description: MachineDescription) -> Iterator[Row]:
    """Say what the paper leaves open of how the machine is driven, pushed and held."""
    motor, connections = description.driveshaft.motor, description.all_connections()
    pushed = any(connection.force_controlled for connection in connections)
    braked = any(connection.turning_inertia is not None for connection in connections)
    ours = {
        "motors": f"hold their {motor.control}",
        "thrust": "enters at the thrust cylinders" if pushed else "acts on the head",
        "rock_damper": "a true ratio, on the head's own turning too" if braked else "as the other dampers",
    }
    for name, value in ours.items():
        what = f"{name.replace('_', ' ')}{' about x' if name == 'rock_damper' else ''}"
        yield Row(f"figure2.{name}", what, "not said", value, "no number", "a key of the machine file")


def _mesh(machine: Machine, curves: MeshCurves) -> Iterator[Row]:
    mean, swing = curves.stiffness.mean(), np.ptp(curves.stiffness, axis=0).max()
    ratio = gear_pair(machine.description.driveshaft).contact_ratio
    ours = f"{mean:.3g} N/m ± {swing / 2.0:.2g}, contact ratio {ratio:.3f}"
    note = "Ishikawa; the mean is Table 4's, tooth numbers and module are assumed"
    paper = "varies with the mesh, one phase a pinion"
    yield Row("figure3.stiffness", "mesh stiffness over time", paper, ours, "no number", note)
    ours, note = f"up to {1e6 * np.abs(curves.error).max():.0f} µm", "ISO 1328-1, accuracy grade assumed"
    paper = "tangential composite tolerance"
    yield Row("figure3.error", "mesh error over time", paper, ours, "no number", note)


def _points(description: MachineDescription) -> Iterator[Row]:
    for point in MEASURED_POINTS:
        node = description.test_points.get(point)
        ours = "no such test point" if node is None else f"node {node}, {absolute(model_block(point))}"
        what, paper = f"measuring point {point}", "wireless accelerometer"
        yield Row(f"figure6.{point}", what, paper, ours, verdict.echoed(node is not None))


def _inputs(description: MachineDescription) -> Iterator[Row]:
    """Table 4: the ranges are the study's own; the initial values those of the machine file."""
    values = input_values(description)
    for item in PAPER_INPUTS.inputs:
        ours = values.get(item.code)
        what = f"{item.name} {item.symbol}, initial value"
        yield Row(f"table4.{item.code}", what, item.initial, ours, "given", _note(item, ours), item.unit)


def _note(item: Input, ours: float | None) -> str:
    bounds = f"range {item.lower:g} to {item.upper:g}, taken over"
    if item.code in _OPERATING:
        return f"{bounds}; the machine stands at Table 1's operating point, a study takes Table 4's range"
    if ours is not None and not verdict.close(item.initial, ours):
        return f"{bounds}; the initial value is this machine's own"
    return bounds


def _stiffness(name: str, paper: Six, description: MachineDescription) -> Row:
    drive = description.driveshaft
    own = {"k_b_pc": drive.pinion_bearing, "k_s_pg": drive.spline}
    found = [own[name]] if name in own else [item for item in description.all_connections() if item.name == name]
    same = bool(found) and all(map(verdict.close, paper, found[0].stiffness))
    ours = _six(found[0].stiffness) if found else "no such connection"
    # Another machine's stiffnesses are its own: an input all the same.
    note = "" if same else "this machine's own"
    what = f"stiffness {name}, x y z (N/m) and about them (N·m/rad)"
    return Row(f"table5.{name}", what, _six(paper), ours, "given", note)


def _six(values: Six) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
