"""Stress of the virtual shafts under steady loads: whether a section that was assumed could carry them.

Of each beam element, from its end forces K_e u_e: the normal stress |N|/A + M r/I at the outer fibre with the shear
stress |T| r/J of torsion, together σ_v = √(σ² + 3τ²) (von Mises; Niemann, Maschinenelemente 1). Shear forces are left
out.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tbm_dynamics.machine.machine import Machine
from tbm_dynamics.machine.parts import Shaft, Subsystem
from tbm_dynamics.structure.assembly import node_positions
from tbm_dynamics.structure.beam import Section, along_direction, beam_stiffness, circular_section
from tbm_dynamics.structure.system import System
from tbm_msgs_py.base.operating_point import OperatingPoint


@dataclass(frozen=True)
class ShaftStress:
    """A shaft, the subsystem that it is in, and its largest stress (Pa)."""

    shaft: Shaft
    subsystem: str
    stress: float


def hardest_point(machine: Machine) -> OperatingPoint:
    """Return the largest allowed torque and thrust together, or the operating point of a machine without limits."""
    limits, point = machine.description.operating_limits, machine.operating_point
    if limits is None:
        return point
    return OperatingPoint(speed=point.speed, torque=limits.torque_kn_m * 1e3, thrust=limits.thrust_kn * 1e3)


def shaft_stresses(machine: Machine, system: System) -> tuple[ShaftStress, ...]:
    """Stress of every shaft outside the drives under the mean loads at `hardest_point`."""
    description, point = machine.description, hardest_point(machine)
    steel, places = description.steel, node_positions(description)
    loaded = system.under(point, description.loads.mean * machine.load_scale(point))
    moved = dict(zip(system.nodes, loaded.equilibrium().displacement.reshape(-1, 6), strict=True))
    found = []
    for name in ("cutterhead_bearing_gear", "carrier_girder"):
        subsystem: Subsystem = getattr(description, name)
        for shaft in subsystem.shafts:
            section = circular_section(shaft.outer_diameter, shaft.inner_diameter, steel.poisson)
            stresses = []
            for first, second in pairwise(shaft.nodes):
                vector = places[second] - places[first]
                element = beam_stiffness(section, float(np.linalg.norm(vector)), steel.elasticity, steel.poisson)
                ends = along_direction(element, vector) @ np.concatenate([moved[first], moved[second]])
                stresses += [_von_mises(end, vector, section, shaft.outer_diameter / 2.0) for end in ends.reshape(2, 6)]
            found.append(ShaftStress(shaft, name, max(stresses)))
    return tuple(found)


def overstressed(machine: Machine, system: System) -> str | None:
    """Return one line about the shaft that exceeds the allowable stress of the file most; None if none does."""
    allowable = machine.description.steel.allowable_stress
    worst = max(shaft_stresses(machine, system), key=lambda one: one.stress, default=None)
    if allowable is None or worst is None or worst.stress <= allowable:
        return None
    point, nodes = hardest_point(machine), worst.shaft.nodes
    return (
        f"{worst.subsystem}.shafts: nodes {nodes[0]} to {nodes[-1]}: {worst.stress / 1e6:.0f} MPa under "
        f"{point.thrust / 1e3:g} kN and {point.torque / 1e3:g} kN·m, allowed are up to {allowable / 1e6:g} "
        "(steel.allowable_stress)"
    )


def _von_mises(end: np.ndarray, vector: np.ndarray, section: Section, radius: float) -> float:
    """Of the force and moment (6,) on an end of an element along `vector`."""
    axis = vector / np.linalg.norm(vector)
    normal, torsion = axis @ end[:3], axis @ end[3:]
    bending = np.linalg.norm(end[3:] - torsion * axis)
    sigma = abs(normal) / section.area + bending * radius / section.second_moment
    tau = abs(torsion) * radius / section.polar_moment
    return float(np.sqrt(sigma**2 + 3.0 * tau**2))
