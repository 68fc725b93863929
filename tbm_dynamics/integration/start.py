"""Where a run starts: the static equilibrium at mesh phase 0, moving with it as the teeth turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tbm_dynamics.integration.lanes import widened
from tbm_dynamics.integration.laws import CouplingLaws, coupling_forces
from tbm_dynamics.structure.system import System

_INSTANT = 1e-6  # of a mesh cycle, over which the equilibrium is differentiated


@dataclass(frozen=True)
class Start:
    """Static equilibrium, and motion about it.

    Attributes
    ----------
    equilibrium : (n,) ndarray
        Displacement q_s.
    deflection : (2p,) ndarray
        Of the couplings there.
    laws : CouplingLaws
    displacement, velocity : (n,) ndarray
        q − q_s and q̇.
    push : (2L,) ndarray
        Forces of the couplings beyond the linear part, which the displacement holds with those of its dampers.
    residual : (2, 2L) ndarray
        Residual forces of the couplings a step before and now.
    mesh_inputs : (3, 2L) ndarray
        Now.
    force : (2L,) ndarray
        Of the couplings now.
    flank : (2L,) ndarray
        That each coupling rests on, 1 or −1.
    """

    equilibrium: np.ndarray
    deflection: np.ndarray
    laws: CouplingLaws
    displacement: np.ndarray
    velocity: np.ndarray
    push: np.ndarray
    residual: np.ndarray
    mesh_inputs: np.ndarray
    force: np.ndarray
    flank: np.ndarray


def static_start(system: System, rate: float, time_step: float, linear: np.ndarray) -> Start:
    """Start of a run of a system whose meshes turn at `rate` (Hz), in steps of `time_step` (s).

    `linear` are stiffness and damping (2, 2p) that the method has in its linear part.

    Without the motion that the equilibrium has as the teeth turn, the error rate of the meshes would strike the pinions
    at the first step.
    """
    couplings = system.couplings
    stiffness, error, slope = couplings.waves.evaluate(np.array([-rate * time_step, 0.0, -_INSTANT, _INSTANT]))
    slope *= rate
    before, still, *around = (system.equilibrium(k, e) for k, e in zip(stiffness, error, strict=True))
    velocity = (around[1].displacement - around[0].displacement) * (rate / (2.0 * _INSTANT))
    velocity -= _turning_rotors(system, velocity)
    # The dampers hold that motion back a little: shift the start to where no net force is left.
    rows = couplings.rows
    push = couplings.damping * slope[1]
    offset = -system.solve(system.C @ velocity + rows.T @ push)
    push += (couplings.damping - linear[1]) * (rows @ velocity) + (couplings.stiffness - linear[0]) * (rows @ offset)
    deflection, p = rows @ still.displacement, couplings.drives
    beyond = widened((couplings.damping - linear[1])[None], p)[0]
    laws = CouplingLaws(
        statics=widened(still.force[None], p)[0],
        constants=widened(np.array([linear[0], couplings.damping, couplings.half_gap]), p),
    )
    mesh_inputs = np.array([widened(np.array([stiffness[i], deflection + error[i], slope[i]]), p) for i in (0, 1)])
    force, *residual = np.empty((3, mesh_inputs.shape[2]))
    for i, place in enumerate((before.displacement - still.displacement + offset, offset)):
        motion = widened(np.array([rows @ place, rows @ velocity]), p)
        coupling_forces(motion, mesh_inputs, i, laws, force, residual[i])
        residual[i] += beyond * motion[1]
    flank = widened(system.flank[None], p)[0]
    return Start(
        still.displacement,
        deflection,
        laws,
        offset,
        velocity,
        widened(push[None], p)[0],
        np.array(residual),
        mesh_inputs[1],
        force,
        flank,
    )


def _turning_rotors(system: System, velocity: np.ndarray) -> np.ndarray:
    """Return what of a velocity (n,) is the rotors turning, the others following them.

    As heavy as they are at the pinion they do not follow the teeth, which the equilibrium has them do.
    """
    rotors = system.drives.rotors
    if not len(rotors):
        return np.zeros_like(velocity)
    torques = np.zeros((system.size, len(rotors)))
    torques[rotors, np.arange(len(rotors))] = 1.0
    following = system.solve(torques)
    return np.asarray(following @ np.linalg.solve(following[rotors], velocity[rotors]))
