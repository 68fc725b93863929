"""The compiled mesh laws: stiffness, error and force of every mesh."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit


class MeshLaws(NamedTuple):
    """What the compiled methods need to know of the meshes; p meshes.

    Attributes
    ----------
    table : (n,) ndarray
        Stiffness over a mesh cycle (N/m).
    shifts : (5, p) ndarray
        Mesh phase γ, cos and sin of 2πγ, cos and sin of the shaft phase.
    errors : (3,) ndarray
        Error amplitudes at mesh and at shaft frequency (m), shaft turns per mesh cycle.
    statics : (2, p) ndarray
        Deflection (m) and force (N) at equilibrium.
    constants : (3,) ndarray
        k̄ (N/m), c_m (N·s/m), half gap (m).
    """

    table: np.ndarray
    shifts: np.ndarray
    errors: np.ndarray
    statics: np.ndarray
    constants: np.ndarray


@njit(cache=True, error_model="numpy", fastmath={"contract"})  # type: ignore[untyped-decorator]
def mesh_condition(cycle: float, rate: float, laws: MeshLaws, out: np.ndarray) -> None:
    """Stiffness, offset, error rate and static force of every mesh at a mesh phase.

    Parameters
    ----------
    cycle : float
        Mesh phase (cycles).
    rate : float
        Mesh frequency (Hz).
    laws : MeshLaws
    out : (4, p) ndarray
        k (N/m), deflection at equilibrium plus error (m), error rate (m/s), force at equilibrium (N).
    """
    tooth, shaft, turns = laws.errors
    table, shifts = laws.table, laws.shifts
    angle = 2.0 * math.pi * (cycle - math.floor(cycle))
    sine, cosine = math.sin(angle), math.cos(angle)
    turned = cycle * turns
    shaft_angle = 2.0 * math.pi * (turned - math.floor(turned))
    shaft_sine, shaft_cosine = math.sin(shaft_angle), math.cos(shaft_angle)
    speed = 2.0 * math.pi * rate
    size = len(table)
    for i in range(shifts.shape[1]):
        phase = cycle - shifts[0, i]
        position = (phase - math.floor(phase)) * size
        j = min(int(position), size - 1)
        after = table[j + 1] if j + 1 < size else table[0]
        out[0, i] = table[j] + (position - j) * (after - table[j])
    for i in range(shifts.shape[1]):
        s1 = sine * shifts[1, i] - cosine * shifts[2, i]
        c1 = cosine * shifts[1, i] + sine * shifts[2, i]
        s2 = shaft_sine * shifts[3, i] + shaft_cosine * shifts[4, i]
        c2 = shaft_cosine * shifts[3, i] - shaft_sine * shifts[4, i]
        out[1, i] = tooth * s1 + shaft * s2 + laws.statics[0, i]
        out[2, i] = speed * (tooth * c1 + shaft * turns * c2)
        out[3, i] = laws.statics[1, i]


@njit(cache=True, error_model="numpy", fastmath={"contract"})  # type: ignore[untyped-decorator]
def mesh_forces(
    motion: np.ndarray, condition: np.ndarray, constants: np.ndarray, force: np.ndarray, excess: np.ndarray
) -> None:
    """Compute the forces of every mesh and their excess g over the mean linear part.

    Parameters
    ----------
    motion : (2p,) ndarray
        Deflections and rates about the equilibrium.
    condition : (4, p) ndarray
        From `mesh_condition`.
    constants : (3,) ndarray
        k̄ (N/m), c_m (N·s/m), half gap (m).
    force, excess : (p,) ndarray
        Written: F and g (N).
    """
    mean, damping, gap = constants
    p = condition.shape[1]
    for i in range(p):
        deflection = motion[i] + condition[1, i]
        over, under = deflection - gap, deflection + gap
        # Without a branch, so that the loop runs over several meshes at once.
        beyond = (over if over > 0.0 else 0.0) + (under if under < 0.0 else 0.0)
        closed = damping if over > 0.0 or under < 0.0 else 0.0
        total = condition[0, i] * beyond + closed * (motion[p + i] + condition[2, i])
        force[i] = total
        excess[i] = total - condition[3, i] - mean * motion[i] - damping * motion[p + i]
