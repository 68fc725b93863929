"""The chunked simulator: the same bits in whatever pieces a run is asked for."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tbm_dynamics.integration.basis import full_basis, reduced_basis
from tbm_dynamics.integration.eigen import Eigen
from tbm_dynamics.integration.errors import SimulationError
from tbm_dynamics.integration.kernel import MeshLaws, mesh_condition, mesh_forces
from tbm_dynamics.integration.linear import INPUTS, linear_system
from tbm_dynamics.integration.lobatto import Lobatto
from tbm_dynamics.integration.method import Method
from tbm_dynamics.machine.machine import OperatingPoint
from tbm_dynamics.structure.system import DIRECTIONS, Equilibrium, Meshes, System

DEFAULT_STEP = 1e-4
MethodName = Literal["reduced", "full"]

# Outputs are one matrix product per block of absolute steps: the same shape, so the same bits, in every chunk.
_BLOCK = 256


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
        self, system: System, nodes: Iterable[int], time_step: float = DEFAULT_STEP, method: MethodName = "reduced"
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
        linear = linear_system(system, basis, dofs)
        self._method: Method = (Eigen if method == "reduced" else Lobatto)(linear, time_step)
        self._turn(0, 0.0, system.operating_point)
        self._record = np.zeros((_BLOCK, len(self._method.output)))
        self._product = np.empty((_BLOCK, self._method.output.shape[1]))
        self._start(system, basis, dofs)

    @property
    def states(self) -> int:
        """Number of states integrated."""
        return self._method.states

    def _start(self, system: System, basis: np.ndarray, dofs: np.ndarray) -> None:
        """Stand in the static equilibrium at mesh phase 0, moving with it as the teeth turn.

        Without that motion the error rate of the meshes would strike the pinions at the first step.
        """
        meshes = self._meshes
        # Without statics yet: stiffness and error only.
        laws = mesh_laws(meshes, np.zeros((2, meshes.count)))
        instant = 1e-6
        before, still, after = (self._equilibrium(system, laws, cycle) for cycle in (-instant, 0.0, instant))
        velocity = (after.displacement - before.displacement) * (self._rate / (2.0 * instant))
        self._laws = mesh_laws(meshes, np.array([meshes.rows @ still.displacement, still.mesh_force]))
        self._static_outputs = still.displacement[dofs].reshape(len(self.nodes), 6)
        mass, damping, stiffness = (basis.T @ matrix @ basis for matrix in (system.M, system.C, system.K))
        rows = meshes.rows @ basis
        rates = np.linalg.solve(mass, basis.T @ (system.M @ velocity))
        # The dampers hold that motion back a little: shift the start to where no net force is left.
        condition = self._condition(self._laws, 0.0)
        drag = damping @ rates + meshes.damping * rows.T @ condition[2]
        offsets = -np.linalg.solve(stiffness, drag)
        self._start_force, excess = np.empty((2, meshes.count))
        motion = np.concatenate([rows @ offsets, rows @ rates])
        mesh_forces(motion, condition, self._laws.constants, self._start_force, excess)
        self._method.begin(np.concatenate([offsets, rates]), excess)
        self._last_inputs = np.zeros(INPUTS)

    def _equilibrium(self, system: System, laws: MeshLaws, cycle: float) -> Equilibrium:
        condition = self._condition(laws, cycle)
        return system.equilibrium(condition[0], condition[1])

    def _condition(self, laws: MeshLaws, cycle: float) -> np.ndarray:
        """Ask `mesh_condition` at a mesh phase, shape (4, p)."""
        condition = np.empty((4, self._meshes.count))
        mesh_condition(cycle, self._rate, laws, condition)
        return condition

    def set_operating_point(self, point: OperatingPoint) -> None:
        """Change speed and torque from the next step on; the mesh phase goes on without a jump."""
        reached = max(self.next_step - 1, 0)  # the next step starts where the last one ended
        cycles = self._phase_base + (reached - self._phase_step) * self._rate * self.time_step
        self._turn(reached, math.fmod(cycles, self._meshes.pinion_teeth), point)

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
        chunk = Chunk(
            self.next_step,
            np.empty((len(loads), len(self.nodes), 6)),
            np.empty((len(loads), len(self.nodes), 6)),
            np.empty((len(loads), self._meshes.count)),
        )
        done = 0
        while done < len(loads):
            # Up to the next border of an output block, so that blocks stay small enough for the cache.
            rows = slice(done, min(len(loads), done + _BLOCK - self.next_step % _BLOCK))
            self._step_block(loads[rows], chunk, rows)
            done = rows.stop
        return chunk

    def _step_block(self, loads: np.ndarray, chunk: Chunk, rows: slice) -> None:
        """Take steps within one output block: loads (n, 6) to n rows of the chunk."""
        inputs = np.empty((len(loads), INPUTS))
        inputs[:, :6] = loads - self._mean_load
        inputs[:, 6] = self._torque - self._mean_torque
        lead = self.next_step % _BLOCK
        record = self._record[lead : lead + len(loads)]
        force = chunk.mesh_force[rows]
        done = 0
        if self.next_step == 0:
            record[0], force[0] = self._method.start_row(inputs[0]), self._start_force
            self._last_inputs = inputs[0].copy()
            done = 1
        self._advance(inputs[done:], record[done:], force[done:], self.next_step + done)
        np.matmul(self._record, self._method.output, out=self._product)
        wanted = self._product[lead : lead + len(loads)].reshape(len(loads), 2, len(self.nodes), 6)
        np.add(wanted[:, 0], self._static_outputs, out=chunk.displacement[rows])
        chunk.acceleration[rows] = wanted[:, 1]
        self.next_step += len(loads)

    def _advance(self, inputs: np.ndarray, record: np.ndarray, force: np.ndarray, target: int) -> None:
        """Fill the rows of the steps from `target` on."""
        if len(inputs) == 0:
            return
        phase = np.array([self._phase_base, self._rate * self.time_step, self._rate])
        known = np.vstack([self._last_inputs, inputs])
        done = self._method.advance(self._laws, known, phase, target - 1 - self._phase_step, record, force)
        if done < len(inputs):
            when = (target + done) * self.time_step
            raise SimulationError(f"the motion diverges at t = {when:.4f} s; reduce time_step or check the machine")
        self._last_inputs = inputs[-1].copy()


def mesh_laws(meshes: Meshes, statics: np.ndarray) -> MeshLaws:
    """Meshes as the compiled methods want them; statics (2, p): deflection and force at equilibrium."""
    mesh, shaft = 2.0 * np.pi * meshes.phases, 2.0 * np.pi * meshes.shaft_phases
    return MeshLaws(
        table=meshes.stiffness_table,
        shifts=np.array([meshes.phases, np.cos(mesh), np.sin(mesh), np.cos(shaft), np.sin(shaft)]),
        errors=np.array([meshes.tooth_error, meshes.shaft_error, 1.0 / meshes.pinion_teeth]),
        statics=statics,
        constants=np.array([meshes.mean_stiffness, meshes.damping, meshes.half_gap]),
    )
