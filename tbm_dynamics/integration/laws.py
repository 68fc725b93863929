"""Force over deflection of the couplings, as the compiled methods want it.

The couplings of all drives stand side by side, meshes first, then gearboxes, each in L lanes (`lanes`). Stiffness and
error are computed for a block of steps at once (`MeshInputs`), the forces in the compiled step (`coupling_forces`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tbm_dynamics.integration.lanes import aligned, lanes_for, widened
from tbm_dynamics.structure.couplings import Couplings

STIFFNESS, OFFSET, SLOPE = 0, 1, 2
"""Mesh inputs of every coupling at an instant: k (N/m, N·m/rad), deflection at equilibrium plus error (m, rad), error
rate (m/s, rad/s)."""


class CouplingLaws(NamedTuple):
    """What does not vary with time.

    Attributes
    ----------
    statics : (2L,) ndarray
        Force at equilibrium (N, N·m).
    constants : (3, 2L) ndarray
        k̄ of the linear part, c, half gap.
    """

    statics: np.ndarray
    constants: np.ndarray


class MeshInputs:
    """Stiffness and error of the couplings over a block of steps, the same bits however the steps are asked for.

    Parameters
    ----------
    couplings : Couplings
    deflection : (2p,) ndarray
        Of the couplings at equilibrium (m, rad).
    steps : int
        Steps in a block.
    stages : tuple of float
        Instants within a step, as shares of it, at which they are wanted.

    Attributes
    ----------
    values : (steps · stages, 3, 2L) ndarray
    """

    def __init__(self, couplings: Couplings, deflection: np.ndarray, steps: int, stages: tuple[float, ...]) -> None:
        waves, p = couplings.waves, couplings.drives
        lanes = lanes_for(p)
        error = waves.error
        # The slope of C cos + S sin is ω (S cos − C sin).
        slope = np.empty_like(error)
        slope[0::2], slope[1::2] = error[1::2], -error[0::2]
        slope *= 2.0 * np.pi * np.repeat(waves.turns, 2)[:, None]
        # Each sum begins with a phase that does not turn: cos 0 = 1 carries the mean.
        self._mesh = widened(_with_mean(np.full(p, waves.mesh_stiffness), waves.mesh_variation), p)
        self._gearbox = widened(_with_mean(np.full(p, waves.gearbox_compliance), waves.gearbox_variation), p)
        self._gearbox[0, p:] = self._gearbox[0, 0]  # idle lanes too: they are divided by
        self._faults = waves.faults
        self._error = np.hstack(
            [widened(_with_mean(deflection, error), p), widened(_with_mean(np.zeros(2 * p), slope), p)]
        )
        mesh, *planets = waves.stiffness_turns()
        self._multiples = np.concatenate([[0.0], mesh, [0.0], *planets, [0.0], waves.turns])
        self._instants = (np.arange(steps)[:, None] + np.array(stages)).ravel()
        self._turned = np.empty((len(self._instants), len(self._multiples)), dtype=complex)
        self._phases = np.empty_like(self._turned)
        self._turn, self._start = math.nan, math.nan
        self._stiffness, self._compliance = np.empty((2, len(self._instants), lanes))
        self._errors = np.empty((len(self._instants), 4 * lanes))
        self.values = aligned(np.zeros((len(self._instants), 3, 2 * lanes)))

    def fill(self, start: float, turn: float, rate: float) -> None:
        """Compute `values` for a block whose first step begins at mesh phase `start`.

        Parameters
        ----------
        start : float
            Cycles.
        turn : float
            Cycles a step.
        rate : float
            Mesh frequency (Hz).
        """
        if turn != self._turn:
            # All that a block's phases differ in from those at its start: the same for every block at one speed.
            self._turned[:] = _unit(np.outer(self._instants * turn, self._multiples))
        elif start == self._start:
            return
        self._start, self._turn = start, turn
        np.multiply(self._turned, _unit(start * self._multiples), out=self._phases)
        waves, lanes = self._phases.view(float), self._stiffness.shape[1]
        first, second = len(self._mesh), len(self._mesh) + len(self._gearbox)
        np.matmul(waves[:, :first], self._mesh, out=self._stiffness)
        np.matmul(waves[:, first:second], self._gearbox, out=self._compliance)
        np.matmul(waves[:, second:], self._error, out=self._errors)
        values = self.values
        values[:, STIFFNESS, :lanes] = self._stiffness
        for fault in self._faults:
            values[:, STIFFNESS, fault.drive] -= fault.at(start + turn * self._instants)
        np.reciprocal(self._compliance, out=values[:, STIFFNESS, lanes:])
        values[:, OFFSET] = self._errors[:, : 2 * lanes]
        np.multiply(self._errors[:, 2 * lanes :], rate, out=values[:, SLOPE])


def _with_mean(mean: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Coefficients with those of a phase that does not turn before them."""
    return np.vstack([mean, np.zeros_like(mean), coefficients])


def _unit(cycles: np.ndarray) -> np.ndarray:
    """Phases in cycles as cos + i sin."""
    angle = 2.0 * np.pi * (cycles - np.floor(cycles))
    return np.asarray(np.cos(angle) + 1j * np.sin(angle))


@njit(cache=True, error_model="numpy", fastmath={"contract"})  # type: ignore[untyped-decorator]
def coupling_forces(
    motion: np.ndarray,
    mesh_inputs: np.ndarray,
    instant: int,
    laws: CouplingLaws,
    force: np.ndarray,
    residual: np.ndarray,
) -> None:
    """Compute the forces of every coupling and what they are above the mean linear part, c in it each coupling's own.

    Parameters
    ----------
    motion : (2, 2L) ndarray
        Deflections and rates about the equilibrium.
    mesh_inputs : (instants, 3, 2L) ndarray
        See `STIFFNESS`, `OFFSET`, `SLOPE`.
    instant : int
        Which of them.
    laws : CouplingLaws
    force, residual : (2L,) ndarray
        Written: F and the residual force (N, N·m).
    """
    statics, constants = laws.statics, laws.constants
    for i in range(len(force)):
        gap = constants[2, i]
        deflection = motion[0, i] + mesh_inputs[instant, 1, i]
        over, under = deflection - gap, deflection + gap
        # Without a branch, so that the loop runs over several couplings at once.
        beyond = (over if over > 0.0 else 0.0) + (under if under < 0.0 else 0.0)
        closed = constants[1, i] if over > 0.0 or under < 0.0 else 0.0
        total = mesh_inputs[instant, 0, i] * beyond + closed * (motion[1, i] + mesh_inputs[instant, 2, i])
        force[i] = total
        residual[i] = total - statics[i] - constants[0, i] * motion[0, i] - constants[1, i] * motion[1, i]
