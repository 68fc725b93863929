"""Adds elements into M, C and K."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from tbm_dynamics.structure.beam import Section, along_direction, beam_mass, beam_stiffness, circular_section
from tbm_dynamics.structure.connection import rigid_arm, spring_rows, spring_stiffness
from tbm_msgs_py.base.errors import MachineError

if TYPE_CHECKING:
    from tbm_dynamics.machine.description import MachineDescription
    from tbm_dynamics.machine.parts import Connection
    from tbm_dynamics.machine.springs import ConnectionType, Springs
    from tbm_dynamics.mesh.geometry import GearPair


@dataclass
class Assembler:
    """Matrices of the nodes at given positions; C_e = β_e K_e with each element's own coefficient.

    Parameters
    ----------
    description : MachineDescription
        For steel and damping.
    positions : dict of int to (3,) ndarray
        m; the order of the nodes is that of the unknowns, six each.
    """

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
        """Unknowns of the nodes, six each."""
        return np.concatenate([np.arange(self.index[node], self.index[node] + 6) for node in nodes])

    def add_stiffness(self, nodes: tuple[int, ...], stiffness: np.ndarray, coefficient: float) -> None:
        """Add an element's stiffness, and `coefficient` (s) times it as damping."""
        place = np.ix_(self.dofs(*nodes), self.dofs(*nodes))
        self.K[place] += stiffness
        self.C[place] += coefficient * stiffness

    def add_matrices(self, nodes: tuple[int, ...], M: np.ndarray, C: np.ndarray, K: np.ndarray) -> None:
        """Add the matrices of a part."""
        place = np.ix_(self.dofs(*nodes), self.dofs(*nodes))
        self.M[place] += M
        self.C[place] += C
        self.K[place] += K

    def add_body(self, node: int, mass: float, inertia: tuple[float, float, float]) -> None:
        """Add a rigid body, kg and kg·m²."""
        dofs = self.dofs(node)
        self.M[dofs, dofs] += [mass, mass, mass, *inertia]

    def add_shaft(self, nodes: tuple[int, ...], outer_diameter: float, inner_diameter: float, mass: float) -> None:
        """Add a virtual shaft of `mass` (kg) along the nodes.

        Raises
        ------
        MachineError
            Two of its nodes are at the same place.
        """
        steel = self.description.steel
        section = circular_section(outer_diameter, inner_diameter, steel.poisson)
        spans = [(a, b, self.positions[b] - self.positions[a]) for a, b in pairwise(nodes)]
        lengths = [float(np.linalg.norm(vector)) for _, _, vector in spans]
        if min(lengths) <= 0.0:
            raise MachineError(f"shaft {nodes}: two of its nodes are at the same place")
        density = mass / (section.area * sum(lengths))
        for a, b, vector in spans:
            self._add_beam((a, b), vector, section, density)

    def _add_beam(self, nodes: tuple[int, int], vector: np.ndarray, section: Section, density: float) -> None:
        steel = self.description.steel
        length = float(np.linalg.norm(vector))
        stiffness = beam_stiffness(section, length, steel.elasticity, steel.poisson)
        mass = beam_mass(section, length, density, steel.elasticity, steel.poisson)
        place = np.ix_(self.dofs(*nodes), self.dofs(*nodes))
        self.M[place] += along_direction(mass, vector)
        self.add_stiffness(nodes, along_direction(stiffness, vector), self.damping("steel"))

    def add_connection(self, first: int, second: int | str, springs: Springs, factor: float = 1.0) -> None:
        """Add springs, times a factor, and dampers at the place of the first node, to the second or the ground."""
        place = self.positions[first]
        grounded = isinstance(second, str)
        rows = spring_rows(place, place, None if grounded else self.positions[int(second)])
        nodes = (first,) if grounded else (first, int(second))
        own = springs.damps or springs.type == "other"
        self.add_stiffness(
            nodes,
            spring_stiffness(rows, factor * springs.stiffness_rows),
            0.0 if own else self.damping(springs.type),
        )
        if springs.damps:
            self.C[np.ix_(self.dofs(*nodes), self.dofs(*nodes))] += spring_stiffness(rows, springs.damping_rows)

    def turn_against(self, connection: Connection) -> None:
        """Make the damper about x of a connection with a turning inertia one of a true ratio."""
        if connection.turning_inertia is not None:
            about_x = self.index[connection.between[0]] + 3
            proportional = self.damping(connection.type) * connection.stiffness_rows[3, 3]
            self.C[about_x, about_x] += self.turning_damping(connection) - proportional

    def turning_damping(self, connection: Connection) -> float:
        """Return c = 2ζ√(kJ) about x (N·m·s/rad) of a connection with a turning inertia J, ζ its type's; else 0."""
        if connection.turning_inertia is None:
            return 0.0
        ratio = float(getattr(self.description.connection_damping, connection.type))
        return 2.0 * ratio * math.sqrt(connection.stiffness_rows[3, 3] * connection.turning_inertia)

    def damping(self, kind: ConnectionType) -> float:
        """β of C_e = β K_e (s) of a type of connection, or of steel, in the reading of the machine file."""
        entry = self.description
        ratio = entry.steel.damping if kind == "steel" else float(getattr(entry.connection_damping, kind))
        return entry.damping.factor(ratio)

    def polar_inertia(self, nodes: tuple[int, ...]) -> float:
        """Inertia about x of the listed nodes turning together (kg·m²)."""
        turning = np.zeros(len(self.M))
        turning[[self.index[node] + 3 for node in nodes]] = 1.0
        return float(turning @ self.M @ turning)

    def mesh_row(self, pinion: int, driven: int, pair: GearPair, angle: float, flank: int = 1) -> np.ndarray:
        """Compression of a mesh along its line of action in the transverse section per unit motion, (n,).

        The pinion is at `angle` (rad) around the driven gear, which its drive flank turns about x; on the coast flank,
        −1, the compression is negative.
        """
        out = np.array([0.0, math.cos(angle), math.sin(angle)])
        to_contact = pair.turning * pair.pinion_pitch_radius * out
        place, line = self.positions[pinion] + to_contact, pair.line_of_action(angle, flank)
        row = np.zeros(len(self.M))
        row[self.dofs(pinion)] = line @ rigid_arm(to_contact)[:3]
        row[self.dofs(driven)] = -line @ rigid_arm(place - self.positions[driven])[:3]
        return row
