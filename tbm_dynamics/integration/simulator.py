"""The chunked simulator: the same bits in whatever pieces a run is asked for."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tbm_dynamics.integration.condensed import Condensed, own_step
from tbm_dynamics.integration.lanes import aligned, lanes_for
from tbm_dynamics.integration.laws import MeshInputs
from tbm_dynamics.integration.linear import ABOUT_X, INPUTS, MOTORS
from tbm_dynamics.integration.lobatto import Lobatto
from tbm_dynamics.integration.method import Method, Steps
from tbm_dynamics.integration.output import Output
from tbm_dynamics.integration.start import static_start
from tbm_dynamics.structure.system import DIRECTIONS, System
from tbm_msgs_py.base.errors import SimulationError
from tbm_msgs_py.base.operating_point import OperatingPoint

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
    motion : (n, 2, nodes, 6) ndarray
        Displacement (m and rad, static part included) and acceleration (m/s² and rad/s²), in the order of the
        simulator's `nodes`.
    mesh_force : (n, p) ndarray
        N, compression positive.
    """

    first_step: int
    motion: np.ndarray
    mesh_force: np.ndarray

    @property
    def displacement(self) -> np.ndarray:
        """Displacement, (n, nodes, 6)."""
        return self.motion[:, 0]

    @property
    def acceleration(self) -> np.ndarray:
        """Acceleration, (n, nodes, 6)."""
        return self.motion[:, 1]

    def rows(self, begin: int, stop: int | None = None) -> Chunk:
        """Rows `begin` to `stop` of these."""
        return Chunk(self.first_step + begin, self.motion[begin:stop], self.mesh_force[begin:stop])


@dataclass(frozen=True)
class _Operation:
    """Speed and torque of a run from a step on.

    Attributes
    ----------
    rate : float
        Mesh frequency (Hz).
    phase_step, phase : int, float
        A step, and the mesh phase there (cycles).
    driving : tuple of 2 (2,) ndarrays
        Torque of the motors, on the side of the head, and the moment of the gross rotation against it (N·m), before and
        after a linear ramp.
    ramp_step, ramp_steps : int
        First step of the ramp, and their number.
    """

    rate: float
    driving: tuple[np.ndarray, np.ndarray]
    phase_step: int = 0
    phase: float = 0.0
    ramp_step: int = 0
    ramp_steps: int = 1

    def driving_at(self, steps: np.ndarray) -> np.ndarray:
        """Torque and moment at steps (n,), (n, 2) N·m."""
        before, after = self.driving
        share = np.clip((steps[:, None] - self.ramp_step + 1) / self.ramp_steps, 0.0, 1.0)
        return np.asarray(before + share * (after - before))


class Simulator:
    """Integrates a system step by step from its static equilibrium.

    Parameters
    ----------
    system : System
    nodes : iterable of int
        Nodes whose motion is wanted.
    time_step : float, optional
        s; the system's own, see `own_step`, without it.
    method : "reduced" or "full"
        The production basis, or every unknown.
    ramp : float
        s from the start, over which loads and torque go from their mean there to what is handed over.

    Attributes
    ----------
    time_step : float
    next_step : int
        Number of the step that the next row handed to `step` belongs to.
    """

    def __init__(
        self,
        system: System,
        nodes: Iterable[int],
        time_step: float | None = None,
        method: MethodName = "reduced",
        *,
        ramp: float = 0.0,
    ) -> None:
        time_step = own_step(system) if time_step is None else time_step
        if not time_step > 0.0:
            raise SimulationError(f"time_step {time_step}: must be positive")
        self.nodes = tuple(nodes)
        self.time_step = time_step
        self.next_step = 0
        self._couplings = system.couplings
        self._ramp_steps = round(ramp / time_step)
        self._system = system
        self._mean_driving = system.driving(system.operating_point)
        dofs = np.array([system.dof(node, direction) for node in self.nodes for direction in DIRECTIONS], dtype=np.intp)
        self._method: Method[Any] = (Condensed if method == "reduced" else Lobatto)(system, dofs, time_step)
        self._operation = _Operation(self._mesh_rate(system.operating_point), (self._mean_driving, self._mean_driving))
        start = static_start(system, self._operation.rate, time_step, self._method.linear)
        self._laws, self._start_force = start.laws, start.force
        self._state: Any
        self._state, self._start_row = self._method.start(start)
        constant = np.concatenate([start.equilibrium[dofs], np.zeros(len(dofs))])
        self._output = Output(self._method.output, self._method.tail, constant, _BLOCK)
        self._mesh_inputs = MeshInputs(system.couplings, start.deflection, _BLOCK, self._method.stages)
        self._block = Steps(
            mesh_inputs=self._mesh_inputs.values,
            inputs=np.zeros((_BLOCK, 2 * INPUTS)),
            forced=aligned(np.zeros((_BLOCK, self._method.forced.shape[1]))),
            record=aligned(np.zeros((_BLOCK, len(self._method.output)))),
            force=aligned(np.zeros((_BLOCK, 2 * lanes_for(system.couplings.drives)))),
        )
        self._last_inputs = np.zeros(INPUTS)

    @property
    def states(self) -> int:
        """Number of states integrated."""
        return self._method.states

    def set_operating_point(self, point: OperatingPoint, over: int = 1) -> None:
        """Change the speed from the next step on, and the torque linearly over so many steps.

        The mesh phase goes on without a jump.
        """
        reached = max(self.next_step - 1, 0)  # the next step starts where the last one ended
        now = self._operation
        self._operation = _Operation(
            rate=self._mesh_rate(point),
            driving=(now.driving_at(np.array([reached]))[0], self._system.driving(point)),
            phase_step=reached,
            phase=now.phase + (reached - now.phase_step) * now.rate * self.time_step,
            ramp_step=self.next_step,
            ramp_steps=over,
        )

    def _mesh_rate(self, point: OperatingPoint) -> float:
        return self._couplings.ring_teeth * point.speed / (2.0 * math.pi)

    def step(self, loads: np.ndarray, into: Chunk | None = None) -> Chunk:
        """Integrate to each of the given loads in turn.

        Parameters
        ----------
        loads : (n, 6) ndarray
            Cutterhead loads at steps `next_step` … `next_step + n − 1` (N, N·m). The first row of a run is where
            it starts, at the static equilibrium under the mean load.
        into : Chunk, optional
            Of n rows, written and returned.

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
        n = len(loads)
        chunk = into or Chunk(
            self.next_step, np.empty((n, 2, len(self.nodes), 6)), np.empty((n, self._couplings.drives))
        )
        done = 0
        while done < n:
            # Up to the next border of an output block, so that blocks stay small enough for the cache.
            rows = slice(done, min(n, done + _BLOCK - self.next_step % _BLOCK))
            self._step_block(loads[rows], chunk.motion[rows], chunk.mesh_force[rows])
            done = rows.stop
        return chunk

    def _step_block(self, loads: np.ndarray, motion: np.ndarray, mesh_force: np.ndarray) -> None:
        """Integrate within one output block, to loads (n, 6); write motion (n, 2, nodes, 6) and force (n, p)."""
        n, block = len(loads), self._block
        begin = self.next_step % _BLOCK
        rows = slice(begin, begin + n)
        inputs, steps = np.empty((n, INPUTS)), self.next_step + np.arange(n)
        inputs[:, :6] = loads - self._system.mean_load
        torque, moment = (self._operation.driving_at(steps) - self._mean_driving).T
        inputs[:, MOTORS] = torque
        inputs[:, ABOUT_X] -= moment
        if self.next_step < self._ramp_steps:  # the motors, too: what turns the head and what holds it stay equal
            share = np.minimum(steps[:, None] / self._ramp_steps, 1.0)
            inputs *= share**2 * (3.0 - 2.0 * share)
        known = block.inputs[rows]
        known[:, :INPUTS], known[0, INPUTS:], known[1:, INPUTS:] = inputs, self._last_inputs, inputs[:-1]
        block.record[rows, -INPUTS:] = inputs
        first = 0
        if self.next_step == 0:
            block.record[0, :-INPUTS], block.force[0] = self._start_row, self._start_force
            first = 1
        self._advance(begin + first, begin + n, self.next_step + first)
        self._output.of(block.record, rows, motion.reshape(n, -1))
        mesh_force[...] = block.force[rows, : self._couplings.drives]
        self._last_inputs = inputs[-1].copy()
        self.next_step += n

    def _advance(self, begin: int, stop: int, step: int) -> None:
        """Fill rows `begin` to `stop` of the block, the first of which is the given step."""
        if stop == begin:
            return
        block, operation = self._block, self._operation
        np.matmul(block.inputs, self._method.forced, out=block.forced)
        turn = operation.rate * self.time_step
        # The block's first row is the step that begins here.
        block_start = step - begin - 1 - operation.phase_step
        self._mesh_inputs.fill(operation.phase + block_start * turn, turn, operation.rate)
        done = self._method.advance(self._laws, block.rows(begin, stop), self._state)
        if done < stop - begin:
            when = (step + done) * self.time_step
            raise SimulationError(f"the motion diverges at t = {when:.4f} s; reduce time_step or check the machine")
