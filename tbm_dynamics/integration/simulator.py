"""The chunked simulator: the same bits in whatever pieces a run is asked for."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tbm_dynamics.integration.basis import full_basis, reduced_basis
from tbm_dynamics.integration.kernel import advance, mesh_condition, mesh_forces
from tbm_dynamics.integration.propagator import INPUTS, build_propagator
from tbm_dynamics.machine.machine import OperatingPoint
from tbm_dynamics.structure.system import DIRECTIONS, Equilibrium, System

DEFAULT_STEP = 1e-4
Method = Literal["reduced", "full"]

# Outputs are one matrix product per block of absolute steps: the same shape, so the same bits, in every chunk.
_BLOCK = 256


class SimulationError(RuntimeError):
    """A run that cannot go on: the message says when and why."""


@dataclass(frozen=True)
class Chunk:
    """Consecutive steps of a run.

    Attributes
    ----------
    first_step : int
        Step number of the first row, from the start of the run.
    displacement, acceleration : (n, nodes, 6) ndarray
        m and rad, m/s² and rad/s², in the order of the simulator's `nodes`; the displacement holds the static part.
    mesh_force : (n, p) ndarray
        N, compression positive.
    """

    first_step: int
    displacement: np.ndarray
    acceleration: np.ndarray
    mesh_force: np.ndarray


class Simulator:
    """Integrates a system step by step from its static equilibrium.

    Parameters
    ----------
    system : System
    nodes : iterable of int
        Nodes whose motion is wanted.
    time_step : float
        s.
    method : "reduced" or "full"
        The production basis, or every unknown.

    Attributes
    ----------
    next_step : int
        Number of the step that the next row handed to `step` belongs to.
    """

    def __init__(
        self, system: System, nodes: Iterable[int], time_step: float = DEFAULT_STEP, method: Method = "reduced"
    ) -> None:
        if not time_step > 0.0:
            raise SimulationError(f"time_step {time_step}: must be positive")
        self.nodes = tuple(nodes)
        self.time_step = time_step
        self.next_step = 0
        self._meshes = system.meshes
        self._mean_load = system.mean_load
        self._mean_torque = system.operating_point.torque
        dofs = np.array([system.dof(node, direction) for node in self.nodes for direction in DIRECTIONS], dtype=np.intp)
        basis = reduced_basis(system) if method == "reduced" else full_basis(system)
        self._rows = self._meshes.rows @ basis
        self._propagator = build_propagator(system, basis, time_step, dofs)
        self._shifts = _shift_table(self._meshes.phases, self._meshes.shaft_phases)
        self._errors = np.array([self._meshes.tooth_error, self._meshes.shaft_error, 1.0 / self._meshes.pinion_teeth])
        self._laws = np.array([self._meshes.mean_stiffness, self._meshes.damping, self._meshes.half_gap])
        self._turn(0, 0.0, system.operating_point)
        self._record = np.zeros((_BLOCK, self._propagator.states + INPUTS + self._meshes.count))
        self._start(system, basis, dofs)

    @property
    def states(self) -> int:
        """Number of states integrated."""
        return self._propagator.states

    def _start(self, system: System, basis: np.ndarray, dofs: np.ndarray) -> None:
        """Stand in the static equilibrium at mesh phase 0, moving with it as the teeth turn.

        Without that motion the error rate of the meshes would strike the pinions at the first step.
        """
        instant = 1e-6
        before, still, after = (self._equilibrium(system, cycle) for cycle in (-instant, 0.0, instant))
        velocity = (after.displacement - before.displacement) * (self._rate / (2.0 * instant))
        self._statics = np.column_stack([self._meshes.rows @ still.displacement, still.mesh_force])
        self._static_outputs = still.displacement[dofs].reshape(len(self.nodes), 6)
        mass, damping, stiffness = (basis.T @ matrix @ basis for matrix in (system.M, system.C, system.K))
        rates = np.linalg.solve(mass, basis.T @ (system.M @ velocity))
        # The dampers hold that motion back a little: shift the start to where no net force is left.
        error_rate = self._condition(0.0)[:, 2]
        drag = damping @ rates + self._meshes.damping * self._rows.T @ error_rate
        offsets = -np.linalg.solve(stiffness, drag)
        self._state = np.concatenate([offsets, rates, np.zeros(self._meshes.count)])
        self._last_inputs = np.zeros(INPUTS)

    def _equilibrium(self, system: System, cycle: float) -> Equilibrium:
        condition = self._condition(cycle)
        return system.equilibrium(condition[:, 0].copy(), condition[:, 1].copy())

    def _condition(self, cycle: float) -> np.ndarray:
        """Stiffness, error and error rate of every mesh at a mesh phase, shape (p, 3)."""
        condition = np.empty((self._meshes.count, 3))
        mesh_condition(cycle, self._meshes.stiffness_table, self._shifts, self._errors, self._rate, condition)
        return condition

    def set_operating_point(self, point: OperatingPoint) -> None:
        """Change speed and torque from the next step on; the mesh phase goes on without a jump."""
        cycles = self._phase_base + (self.next_step - self._phase_step) * self._rate * self.time_step
        self._turn(self.next_step, math.fmod(cycles, self._meshes.pinion_teeth), point)

    def _turn(self, step: int, cycles: float, point: OperatingPoint) -> None:
        # Whole turns of the pinion are dropped: stiffness and error repeat with them.
        self._phase_step, self._phase_base = step, cycles
        self._rate = self._meshes.ring_teeth * point.speed / (2.0 * math.pi)
        self._torque = point.torque

    def step(self, loads: np.ndarray) -> Chunk:
        """Integrate to each of the given loads in turn.

        Parameters
        ----------
        loads : (n, 6) ndarray
            Cutterhead loads at steps `next_step` … `next_step + n − 1` (N, N·m). The first row of a run is where
            it starts, at the static equilibrium under the mean load.

        Raises
        ------
        SimulationError
            Loads that are not finite or of another shape, or a motion that diverges.
        """
        loads = np.ascontiguousarray(loads, dtype=float)
        if loads.ndim != 2 or loads.shape[1] != 6 or len(loads) == 0:
            raise SimulationError(f"loads: shape {loads.shape}; must be (n, 6) with n of at least 1")
        if not np.all(np.isfinite(loads)):
            bad = int(np.argmin(np.isfinite(loads).all(axis=1))) + self.next_step
            raise SimulationError(f"loads at t = {bad * self.time_step:.4f} s are not finite")
        parts = []
        while len(loads):
            # Up to the next border of an output block, so that blocks stay small enough for the cache.
            count = min(len(loads), _BLOCK - self.next_step % _BLOCK)
            parts.append(self._step_block(loads[:count]))
            loads = loads[count:]
        return parts[0] if len(parts) == 1 else _joined(parts)

    def _step_block(self, loads: np.ndarray) -> Chunk:
        """Integrate over loads (n, 6) that lie within one output block."""
        inputs = np.empty((len(loads), INPUTS))
        inputs[:, :6] = loads - self._mean_load
        inputs[:, 6] = self._torque - self._mean_torque
        lead = self.next_step % _BLOCK
        record = self._record[lead : lead + len(loads)]
        force = np.empty((len(loads), self._meshes.count))
        done = 0
        if self.next_step == 0:
            self._record_start(inputs[0], record, force)
            done = 1
        self._advance(inputs[done:], record[done:], force[done:], self.next_step + done)
        product = (self._record @ self._propagator.output)[lead : lead + len(loads)]
        wanted = product.reshape(len(loads), 2, len(self.nodes), 6)
        chunk = Chunk(self.next_step, wanted[:, 0] + self._static_outputs, wanted[:, 1], force)
        self.next_step += len(loads)
        return chunk

    def _record_start(self, inputs: np.ndarray, record: np.ndarray, force: np.ndarray) -> None:
        states = self._propagator.states
        offsets, rates = np.split(self._state[:states], 2)
        motion = np.concatenate([self._rows @ offsets, self._rows @ rates])
        mesh_forces(motion, self._condition(0.0), self._statics, self._laws, force[0], self._state[states:])
        record[0] = np.concatenate([self._state[:states], inputs, self._state[states:]])
        self._last_inputs = inputs.copy()

    def _advance(self, inputs: np.ndarray, record: np.ndarray, force: np.ndarray, target: int) -> None:
        if len(inputs) == 0:
            return
        propagator = self._propagator
        mesh_columns = slice(propagator.states, None)
        done = advance(
            propagator.free,
            propagator.from_middle,
            propagator.from_end,
            np.ascontiguousarray(propagator.from_middle[:, mesh_columns]),
            np.ascontiguousarray(propagator.from_end[:, mesh_columns]),
            self._meshes.stiffness_table,
            self._shifts,
            self._errors,
            self._statics,
            self._laws,
            np.vstack([self._last_inputs, inputs]),
            np.array([self._phase_base, self._rate * self.time_step, self._rate]),
            target - 1 - self._phase_step,
            self._state,
            record,
            force,
        )
        if done < len(inputs):
            when = (target + done) * self.time_step
            raise SimulationError(f"the motion diverges at t = {when:.4f} s; reduce time_step or check the machine")
        self._last_inputs = inputs[-1].copy()


def _joined(parts: list[Chunk]) -> Chunk:
    return Chunk(
        parts[0].first_step,
        np.concatenate([part.displacement for part in parts]),
        np.concatenate([part.acceleration for part in parts]),
        np.concatenate([part.mesh_force for part in parts]),
    )


def _shift_table(phases: np.ndarray, shaft_phases: np.ndarray) -> np.ndarray:
    """Columns of `mesh_condition`'s `shifts`, shape (p, 5)."""
    mesh, shaft = 2.0 * np.pi * phases, 2.0 * np.pi * shaft_phases
    return np.column_stack([phases, np.cos(mesh), np.sin(mesh), np.cos(shaft), np.sin(shaft)])
