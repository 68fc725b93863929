"""Live streams without ROS: what the nodes do with time, blocks and gaps.

Stream time is an integer step k from an epoch (ns): sample k belongs to epoch + k·dt.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tbm_dynamics.integration.errors import SimulationError
from tbm_dynamics.integration.simulator import Chunk, Simulator
from tbm_dynamics.machine.machine import Machine, OperatingPoint
from tbm_dynamics.simulation import default_outputs

NANOSECONDS = 1_000_000_000


def step_ns(rate_hz: float) -> int:
    """Length of a step (ns).

    Raises
    ------
    ValueError
        A rate whose step is not a whole number of nanoseconds.
    """
    length = NANOSECONDS / rate_hz
    if length != round(length):
        raise ValueError(
            f"rate {rate_hz:g} Hz: its step must be a whole number of ns; allowed are 1000, 5000, 10000, …"
        )
    return round(length)


@dataclass(frozen=True)
class LoadBlock:
    """Consecutive loads.

    Attributes
    ----------
    first_step : int
    loads : (n, 6) ndarray
        N, N·m.
    head_angle : float
        Angle of the cutterhead at the first step (rad).
    operating_point : OperatingPoint
        At the end of the block.
    """

    first_step: int
    loads: np.ndarray
    head_angle: float
    operating_point: OperatingPoint


class LoadStream:
    """Loads block by block, at an operating point that may change between blocks.

    A change is spread linearly over one block, so that the mean thrust does not jump.
    """

    def __init__(self, machine: Machine, seed: int, rate_hz: float, block_samples: int) -> None:
        self._machine = machine
        self._dt = 1.0 / rate_hz
        self._samples = block_samples
        self._point = self._wanted = machine.operating_point
        self._loads = machine.loads(seed)
        self._described = self._loads.with_scale(np.ones(6))
        self.head_angle = 0.0
        self.next_step = 0

    def set_operating_point(self, point: OperatingPoint) -> None:
        """Operating point to reach at the end of the next block; a stream that has not begun starts there."""
        self._wanted = point
        if self.next_step == 0 and point != self._point:
            self._point = point
            self._loads = self._loads.with_scale(self._machine.load_scale(point))

    def next_block(self) -> LoadBlock:
        """Evaluate the loads of the next block."""
        steps = np.arange(self.next_step, self.next_step + self._samples)
        time = steps * self._dt
        if self._wanted == self._point:
            values = self._loads.evaluate(time)
        else:
            before, after = self._machine.load_scale(self._point), self._machine.load_scale(self._wanted)
            share = np.arange(1, self._samples + 1)[:, None] / self._samples
            values = self._described.evaluate(time) * (before + share * (after - before))
            self._loads = self._loads.with_scale(after)
            self._point = self._wanted
        block = LoadBlock(self.next_step, values, self.head_angle, self._point)
        self.head_angle = float((self.head_angle + self._point.speed * self._samples * self._dt) % (2.0 * np.pi))
        self.next_step += self._samples
        return block


class DynamicsStream:
    """Response block by block; a lost block of loads is bridged without a jump of the state.

    Parameters
    ----------
    machine : Machine
    rate_hz : float
        Rate of the loads, and 1/time step.
    longest_bridge : float
        s; a longer gap, or a jump back, starts the run afresh from the static equilibrium.

    Attributes
    ----------
    nodes : tuple of int
        Order of the nodes in the chunks.
    meshes : int
        Number of mesh forces.
    epoch_ns : int
        Time of step 0.
    lost_steps, restarts : int
        Load samples that never came; fresh starts after the first.
    """

    def __init__(self, machine: Machine, rate_hz: float, longest_bridge: float = 2.0) -> None:
        self._machine = machine
        self._system = machine.assemble()
        self._rate = rate_hz
        self._step = step_ns(rate_hz)
        self._longest = round(longest_bridge * rate_hz)
        self.nodes = default_outputs(machine)
        self.lost_steps = 0
        self.restarts = 0
        self.meshes = self._system.couplings.drives
        self._point: OperatingPoint | None = None
        self._last = np.zeros(6)
        self.epoch_ns = 0
        self._started = False
        self._lost = False  # the state is that of a run that diverged
        self._simulator = self._fresh()

    def _fresh(self) -> Simulator:
        """Stand in the static equilibrium of the operating point asked for last."""
        system, point = self._system, self._point
        self._changed = False  # the operating point, since the last block
        if point is not None and point != system.operating_point:
            mean_load = self._machine.description.loads.mean * self._machine.load_scale(point)
            system = replace(system, operating_point=point, mean_load=mean_load)
        return Simulator(system, self.nodes, 1.0 / self._rate)

    def warm_up(self) -> None:
        """Compile the kernel before the first block is due, and stand at the start again."""
        self._simulator.step(np.tile(self._machine.description.loads.mean, (2, 1)))
        self._simulator = self._fresh()

    def set_operating_point(self, point: OperatingPoint) -> None:
        """Speed from the next block on, torque linearly over it, as the loads; a run that has not begun starts there.

        The point that holds already changes no bit of the run, whenever its message comes.
        """
        if point == (self._point or self._machine.operating_point):
            return
        self._point = point
        if self._started:
            self._changed = True
        else:
            self._simulator = self._fresh()

    def process(self, stamp_ns: int, loads: np.ndarray) -> list[Chunk]:
        """Integrate over a block of loads (n, 6) whose first sample belongs to `stamp_ns`.

        Returns the chunk of the block, after that of a bridged gap if there was one.

        Raises
        ------
        SimulationError
            Loads that are not finite: nothing has changed. A run that diverges: the next block starts afresh.
        """
        if not np.isfinite(loads).all():
            raise SimulationError("loads hold a value that is not finite")
        missing = self._missing(stamp_ns)
        self._lost = True
        bridge = []
        if missing:
            self.lost_steps += missing
            share = np.arange(1, missing + 1)[:, None] / (missing + 1)
            bridge.append(self._simulator.step(self._last + share * (loads[0] - self._last)))
        if self._changed and self._point is not None:
            self._simulator.set_operating_point(self._point, over=len(loads))
        self._changed = False
        chunk = self._simulator.step(loads)
        self._lost = False
        self._last = loads[-1].copy()
        return [*bridge, chunk]

    def _missing(self, stamp_ns: int) -> int:
        """Count the steps between what has come and this stamp; a stamp that does not follow starts afresh."""
        if self._started:
            missing = round((stamp_ns - self.epoch_ns) / self._step) - self._simulator.next_step
            if 0 <= missing <= self._longest and not self._lost:
                return missing
            self.restarts += 1
            self._simulator = self._fresh()
        self.epoch_ns, self._started = stamp_ns, True
        return 0
