"""The chunked simulator: the same bits in whatever pieces a run is asked for."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tbm_dynamics.integration import aligned
from tbm_dynamics.integration.condensed import Condensed
from tbm_dynamics.integration.laws import Held, Laws, forces, lanes_for, widened
from tbm_dynamics.integration.linear import INPUTS
from tbm_dynamics.integration.lobatto import Lobatto
from tbm_dynamics.integration.method import Method
from tbm_dynamics.integration.output import Output
from tbm_dynamics.structure.system import DIRECTIONS, System
from tbm_msgs_py.base.errors import SimulationError
from tbm_msgs_py.base.operating_point import OperatingPoint

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
        self._drives = system.couplings.drives
        self._ring_teeth = system.couplings.ring_teeth
        self._mean_load = system.mean_load
        self._mean_torque = system.operating_point.torque
        dofs = np.array([system.dof(node, direction) for node in self.nodes for direction in DIRECTIONS], dtype=np.intp)
        self._method: Method = (Condensed if method == "reduced" else Lobatto)(system, dofs, time_step)
        self._phase_step, self._phase_base = 0, 0.0
        self._rate = self._mesh_rate(system.operating_point)
        self._torque, self._torque_from, self._torque_over = (self._mean_torque, self._mean_torque), 0, 1
        self._inputs = np.zeros((_BLOCK, 2 * INPUTS))
        self._forced = aligned.empty(_BLOCK, self._method.forced.shape[1])
        self._record = aligned.zeros(_BLOCK, len(self._method.output))
        self._force = aligned.empty(_BLOCK, 2 * lanes_for(self._drives))
        self._last_inputs = np.zeros(INPUTS)
        self._start(system, dofs)

    @property
    def states(self) -> int:
        """Number of states integrated."""
        return self._method.states

    def _start(self, system: System, dofs: np.ndarray) -> None:
        """Stand in the static equilibrium at mesh phase 0, moving with it as the teeth turn.

        Without that motion the error rate of the meshes would strike the pinions at the first step.
        """
        couplings = system.couplings
        instant = 1e-6
        cycles = np.array([-self._rate * self.time_step, 0.0, -instant, instant])
        stiffness, error, slope = couplings.waves.evaluate(cycles)
        slope *= self._rate
        before, still, *around = (system.equilibrium(k, e) for k, e in zip(stiffness, error, strict=True))
        velocity = (around[1].displacement - around[0].displacement) * (self._rate / (2.0 * instant))
        constant = np.concatenate([still.displacement[dofs], np.zeros(len(dofs))])
        self._output = Output(self._method.output, self._method.tail, constant, _BLOCK)
        # The dampers hold that motion back a little: shift the start to where no net force is left.
        rows = couplings.rows
        offset = -system.solve(system.C @ velocity + rows.T @ (couplings.damping * slope[1]))
        deflection, p = rows @ still.displacement, couplings.drives
        self._laws = Laws(
            statics=widened(still.force[None], p)[0],
            constants=widened(np.array([couplings.stiffness, couplings.damping, couplings.half_gap]), p),
        )
        self._held = Held(couplings, deflection, _BLOCK, self._method.stages)
        held = np.array([widened(np.array([stiffness[i], deflection + error[i], slope[i]]), p) for i in (0, 1)])
        start, *excess = np.empty((3, held.shape[2]))
        for i, place in enumerate((before.displacement - still.displacement + offset, offset)):
            forces(widened(np.array([rows @ place, rows @ velocity]), p), held, i, self._laws, start, excess[i])
        self._from = offset, velocity, np.array(excess), held[1]
        self._start_force = start

    def set_operating_point(self, point: OperatingPoint, over: int = 1) -> None:
        """Change the speed from the next step on, and the torque linearly over so many steps.

        The mesh phase goes on without a jump.
        """
        reached = max(self.next_step - 1, 0)  # the next step starts where the last one ended
        self._phase_base += (reached - self._phase_step) * self._rate * self.time_step
        self._phase_step = reached
        self._rate = self._mesh_rate(point)
        self._torque = self._torque_at(np.array([reached]))[0], point.torque
        self._torque_from, self._torque_over = self.next_step, over

    def _mesh_rate(self, point: OperatingPoint) -> float:
        return self._ring_teeth * point.speed / (2.0 * math.pi)

    def _torque_at(self, steps: np.ndarray) -> np.ndarray:
        """Torque of the motors, on the side of the head, at steps (n,), N·m."""
        before, after = self._torque
        share = np.clip((steps - self._torque_from + 1) / self._torque_over, 0.0, 1.0)
        return np.asarray(before + share * (after - before))

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
        chunk = into or Chunk(
            self.next_step, np.empty((len(loads), 2, len(self.nodes), 6)), np.empty((len(loads), self._drives))
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
        lead = self.next_step % _BLOCK
        block = slice(lead, lead + len(loads))
        inputs = np.empty((len(loads), INPUTS))
        inputs[:, :6] = loads - self._mean_load
        inputs[:, 6] = self._torque_at(self.next_step + np.arange(len(loads))) - self._mean_torque
        known, record = self._inputs[block], self._record[block]
        known[:, :INPUTS], known[0, INPUTS:], known[1:, INPUTS:] = inputs, self._last_inputs, inputs[:-1]
        record[:, -INPUTS:] = inputs
        done = 0
        if self.next_step == 0:
            record[0, :-INPUTS], self._force[0] = self._method.begin(*self._from), self._start_force
            done = 1
        self._advance(lead + done, lead + len(loads), self.next_step + done)
        self._output.of(self._record, block, chunk.motion[rows].reshape(len(loads), -1))
        chunk.mesh_force[rows] = self._force[block, : self._drives]
        self._last_inputs = inputs[-1].copy()
        self.next_step += len(loads)

    def _advance(self, begin: int, stop: int, target: int) -> None:
        """Fill rows `begin` to `stop` of the block, the first of which is step `target`."""
        if stop == begin:
            return
        np.matmul(self._inputs, self._method.forced, out=self._forced)
        turn = self._rate * self.time_step
        # The block's first row is the step that begins here.
        block_start = target - begin - 1 - self._phase_step
        stages = len(self._method.stages)
        held = self._held.block(self._phase_base + block_start * turn, turn, self._rate)[stages * begin : stages * stop]
        block = slice(begin, stop)
        done = self._method.advance(
            self._laws, held, self._inputs[block], self._forced[block], self._record[block], self._force[block]
        )
        if done < stop - begin:
            when = (target + done) * self.time_step
            raise SimulationError(f"the motion diverges at t = {when:.4f} s; reduce time_step or check the machine")
