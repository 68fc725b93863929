"""Response of a run: motion of selected nodes, mesh forces, and the indicators of both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tbm_dynamics.indicators import expected_peaks, indicators
from tbm_dynamics.machine.sensor_place import SensorPlace, place_of
from tbm_msgs_py.base.errors import MachineError

if TYPE_CHECKING:
    from tbm_dynamics.machine.machine import Machine

AXES = ("x", "y", "z", "rx", "ry", "rz")


def default_outputs(machine: Machine) -> tuple[int, ...]:
    """Nodes of the test points, the ring gear's mesh plane and the first pinion's mesh node."""
    drive = machine.description.driveshaft
    nodes = [
        *(place.node for place in machine.description.sensor_places.values()),
        drive.ring_node,
        drive.pinion_nodes_from + 1,
    ]
    return tuple(dict.fromkeys(nodes))


def rotor_nodes(machine: Machine) -> tuple[int, ...]:
    """Nodes of the motors' rotors, whose angle θx is that on the side of the pinion."""
    from tbm_dynamics.structure.drive import drive_nodes  # noqa: PLC0415 - a stream of loads needs none

    drive = machine.description.driveshaft
    return tuple(drive_nodes(drive, i)[-1] for i in range(drive.count))


def pinion_torque(machine: Machine, mesh_force: np.ndarray) -> np.ndarray:
    """Torque of each pinion (n, p), N·m, from the forces of the meshes (n, p), N."""
    from tbm_dynamics.structure.drive import gear_pair  # noqa: PLC0415 - a stream of loads needs none

    return np.asarray(mesh_force * gear_pair(machine.description.driveshaft).pinion_base_radius)


def mean_pinion_speed(machine: Machine, head_speed: float) -> np.ndarray:
    """Mean speed of each drive (p,) on the side of its pinion at a speed of the head, rad/s; uncoupled, it rests.

    The motion of a run is a perturbation about this uniform turning: the rate of a rotor's θx comes on top.
    """
    gear = machine.description.driveshaft.gear
    turning = [drive.off != "uncoupled" for drive in machine.description.each_drive]
    return np.asarray(head_speed * gear.ring_teeth / gear.pinion_teeth * np.array(turning, dtype=float))


@dataclass(frozen=True)
class Response:
    """Motion of selected nodes and mesh forces, at every step and unfiltered.

    Attributes
    ----------
    time : (n,) ndarray
        s, from the start of the run, its settling included.
    nodes : tuple of int
    displacements, accelerations : (n, nodes, 6) ndarray
        m and rad, m/s² and rad/s².
    mesh_force : (n, p) ndarray
        N.
    ring_node, pinion_node : int
        Mesh node of the ring gear and of the first pinion.
    static_mesh_force : float
        Mean torque shared equally by the meshes (N).
    states : int
        Number of states integrated.
    """

    time: np.ndarray
    nodes: tuple[int, ...]
    displacements: np.ndarray
    accelerations: np.ndarray
    mesh_force: np.ndarray
    ring_node: int
    pinion_node: int
    static_mesh_force: float
    states: int

    def acceleration(self, node: int | SensorPlace, axis: str | None = None) -> np.ndarray:
        """Acceleration of a node or a sensor's place, (n,) along one axis x, y, z, rx, ry, rz, or (n, 6).

        Raises
        ------
        MachineError
            A node that was not among the outputs, or an unknown axis.
        """
        return self._pick(self.accelerations, node, axis)

    def displacement(self, node: int | SensorPlace, axis: str | None = None) -> np.ndarray:
        """Displacement, static part included, (n,) or (n, 6); raises as `acceleration`."""
        return self._pick(self.displacements, node, axis)

    def _pick(self, values: np.ndarray, point: int | SensorPlace, axis: str | None) -> np.ndarray:
        place = place_of(point)
        if place.node not in self.nodes:
            raise MachineError(
                f"node {place.node}: not among the outputs {', '.join(map(str, self.nodes))}; ask for it with outputs="
            )
        picked = values[:, self.nodes.index(place.node)]
        if axis is not None and axis not in AXES:
            raise MachineError(f"axis {axis!r}: allowed are {', '.join(AXES)}")
        if any(place.offset):
            picked = np.concatenate([place.translation(picked), picked[:, 3:]], axis=1)
        return picked if axis is None else picked[:, AXES.index(axis)]

    def indicators(self) -> dict[str, float]:
        """Return the eight indicators of the paper's Table 3."""
        return indicators(
            self.displacement(self.ring_node),
            self.acceleration(self.pinion_node),
            self.mesh_force,
            self.static_mesh_force,
        )

    def expected_peaks(self) -> dict[str, float]:
        """Return the peaks among the indicators as their expectation under other loads of the same spectrum."""
        return expected_peaks(self.acceleration(self.pinion_node))
