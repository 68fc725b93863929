"""Bodies, springs and meshes of published examples, put together by the assembler of the machines."""

import numpy as np
import scipy.linalg
from machine_files import built, small, stage_of

from tbm_dynamics.machine.description import Material
from tbm_dynamics.structure.assembler import Assembler
from tbm_dynamics.structure.connection import rigid_arm, spring_rows, spring_stiffness


def assembler_of(positions, elasticity=208e9, shear_modulus=80e9):
    """An empty assembler of undamped steel with nodes at some places, m."""
    poisson = elasticity / (2.0 * shear_modulus) - 1.0
    steel = Material(elasticity=elasticity, poisson=poisson, damping=0.0, source="test")
    description = built(small()).description.model_copy(update={"steel": steel})
    return Assembler(description, {node: np.array(place, dtype=float) for node, place in positions.items()})


def add_spring(parts, first, second, stiffness):
    """Six springs without dampers at the place of the first node, to the second or (None) to the ground."""
    place = parts.positions[first]
    rows = spring_rows(place, place, None if second is None else parts.positions[second])
    nodes = (first,) if second is None else (first, second)
    parts.add_stiffness(nodes, spring_stiffness(rows, np.array(stiffness)), 0.0)


def turning_parts(bodies, springs):
    """Bodies (inertia, place in y) with springs (first, second, N·m/rad) between them: only what turns counts."""
    parts = assembler_of({node: (0.0, aside, 0.0) for node, (_, aside) in bodies.items()})
    for node, (inertia, _) in bodies.items():
        parts.add_body(node, 1.0, (inertia, 1.0, 1.0))
    for first, second, stiffness in springs:
        add_spring(parts, first, second, (0.0, 0.0, 0.0, stiffness, 0.0, 0.0))
    return parts


def frequencies(M, K, free, rigid=()):
    """Natural frequencies (Hz) of the free unknowns, `rigid` being rows of what does not yield."""
    motions = np.eye(len(free))
    if len(rigid):
        motions = scipy.linalg.null_space(np.array(rigid)[:, free] / np.abs(rigid).max(axis=1, keepdims=True))
    K, M = (motions.T @ matrix[np.ix_(free, free)] @ motions for matrix in (K, M))
    return np.sqrt(np.abs(scipy.linalg.eigh(K, M, eigvals_only=True))) / (2.0 * np.pi)


SUN, RING, CARRIER, FIRST_PLANET = 1, 2, 3, 4


class Planetary:
    """A planetary gear in the plane, its meshes as rows: sun–planet, then planet–ring of every planet, (2N, n).

    `masses` (kg) and `inertias` (I/r², kg) are of sun, ring, carrier and one planet; r is the base radius, of the
    carrier the distance of the pins.
    """

    def __init__(self, planets, degrees, masses, inertias, teeth=(20, 25)):
        self.stage = stage = stage_of(*teeth, planets, degrees=degrees)
        self.angles = 2.0 * np.pi * np.arange(planets) / planets
        self.pins = stage.centre_distance * np.array([[0.0, np.cos(a), np.sin(a)] for a in self.angles])
        self.planets = tuple(range(FIRST_PLANET, FIRST_PLANET + planets))
        self.parts = parts = assembler_of(
            {**dict.fromkeys((SUN, RING, CARRIER), np.zeros(3)), **dict(zip(self.planets, self.pins, strict=True))}
        )
        sun, ring = stage.sun_mesh, stage.ring_mesh
        self.radii = (sun.pinion_base_radius, ring.ring_base_radius, stage.centre_distance, ring.pinion_base_radius)
        nodes = (SUN, RING, CARRIER, *self.planets)
        for node, kind in zip(nodes, (0, 1, 2, *[3] * planets), strict=True):
            parts.add_body(node, masses[kind], (inertias[kind] * self.radii[kind] ** 2, 1.0, 1.0))
        # The sun stands opposite, seen from a planet: it turns against x, the planets about it.
        self.meshes = np.array(
            [parts.mesh_row(SUN, node, sun, a + np.pi) for node, a in zip(self.planets, self.angles, strict=True)]
            + [parts.mesh_row(node, RING, ring, a) for node, a in zip(self.planets, self.angles, strict=True)]
        )

    def bear(self, node, stiffness, turning):
        """Hold a central body by springs, N/m across and N/m at its radius."""
        about = turning * self.radii[node - SUN] ** 2
        add_spring(self.parts, node, None, (0.0, stiffness, stiffness, about, 0.0, 0.0))

    def pin(self, stiffness):
        """Put the planets on the carrier by springs, N/m."""
        for node in self.planets:
            add_spring(self.parts, node, CARRIER, (0.0, stiffness, stiffness, 0.0, 0.0, 0.0))

    def pinned(self):
        """Rows of planets that do not leave their pins."""
        rows = np.zeros((2 * len(self.planets), len(self.parts.M)))
        for i, (node, pin) in enumerate(zip(self.planets, self.pins, strict=True)):
            for j, across in enumerate((1, 2)):
                rows[2 * i + j, self.parts.dofs(node)[across]] = 1.0
                rows[2 * i + j, self.parts.dofs(CARRIER)] -= rigid_arm(pin)[across]
        return rows

    def stiffness(self, springs):
        """K with springs (2N,) in the meshes, N/m."""
        return self.parts.K + self.meshes.T @ (np.broadcast_to(springs, len(self.meshes))[:, None] * self.meshes)

    def in_the_plane(self):
        """Unknowns across and about the axis."""
        return np.concatenate([self.parts.dofs(node)[1:4] for node in self.parts.positions])

    def turning(self, *nodes):
        """Unknowns of central bodies that only turn, then of the planets in the plane."""
        return np.array(
            [self.parts.dofs(node)[3] for node in nodes]
            + [dof for node in self.planets for dof in self.parts.dofs(node)[1:4]]
        )
