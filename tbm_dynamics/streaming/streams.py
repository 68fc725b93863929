"""Live streams of loads and of the response, block by block, without ROS.

Stream time is an integer step k from an epoch (ns): sample k belongs to epoch + k·dt.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tbm_dynamics.integration import LOAD_RAMP
from tbm_dynamics.loads.stepper import LoadModel, load_stepper
from tbm_dynamics.machine.machine import Machine
from tbm_dynamics.response import default_outputs
from tbm_dynamics.streaming.continuity import Continuity, StreamBlock
from tbm_dynamics.streaming.schedule import Schedule
from tbm_msgs_py.base.errors import InputError, MachineError, SimulationError
from tbm_msgs_py.base.operating_point import OperatingPoint
from tbm_msgs_py.base.units import NANOSECONDS

if TYPE_CHECKING:
    from tbm_dynamics.integration.simulator import Chunk, Simulator


def step_ns(rate_hz: float) -> int:
    """Length of a step (ns).

    Raises
    ------
    InputError
        A rate whose step is not a whole number of nanoseconds.
    """
    length = NANOSECONDS / rate_hz
    if length != round(length):
        raise InputError(
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

    A change is spread linearly over one block, so that the mean thrust does not jump; the speed holds from the block's
    start.

    Parameters
    ----------
    machine : Machine
    seed : int
    time_step : float
        Of the samples, s.
    block_samples : int
    level : "spectral" or "cutter"
    schedule : Schedule, optional
        The operating point at the end of every block; without one it is what `set_operating_point` was given last.

    Raises
    ------
    MachineError
        A schedule, or the machine's own operating point, that the machine or its rock does not allow.
    """

    def __init__(
        self,
        machine: Machine,
        seed: int,
        time_step: float,
        block_samples: int,
        level: LoadModel = "spectral",
        schedule: Schedule | None = None,
    ) -> None:
        self._dt = time_step
        self._samples = block_samples
        self._schedule = schedule
        self._loads = load_stepper(machine, level, seed)
        if schedule is not None:
            self._check(schedule)
        start = machine.operating_point if schedule is None else schedule.at(0.0)
        self._point = self._wanted = self._loads.reached(start)
        self._turning = 0.0, 0.0  # time (s) from which the speed holds, and the head's angle there (rad)
        self.next_step = 0

    def _check(self, schedule: Schedule) -> None:
        for place, point in schedule.rows():
            try:
                self._loads.reached(point)
            except MachineError as error:
                raise MachineError(f"{place}: {error}") from None

    @property
    def operating_point(self) -> OperatingPoint:
        """Where the next block starts."""
        return self._point

    @property
    def mean(self) -> np.ndarray:
        """Mean loads where the next block starts, (6,), N and N·m."""
        return self._loads.mean(self._point)

    def set_operating_point(self, point: OperatingPoint) -> None:
        """Operating point to reach at the end of the next block; a stream that has not begun starts there.

        Raises
        ------
        MachineError
            A point that the machine or its rock does not allow, or a stream that follows a schedule.
        """
        if self._schedule is not None:
            raise MachineError("operating point: the loads follow a schedule")
        self._wanted = self._loads.reached(point)
        if self.next_step == 0:
            self._point = self._wanted

    def next_block(self) -> LoadBlock:
        """Evaluate the loads of the next block."""
        first, samples = self.next_step, self._samples
        time = np.arange(first, first + samples) * self._dt
        if self._schedule is not None:
            self._wanted = self._loads.reached(self._schedule.at((first + samples) * self._dt))
        before, after = self._point, self._wanted
        if after.speed != before.speed:
            self._turning = float(time[0]), float(self._angle(before, time[:1])[0])
        angle = self._angle(after, time)
        values = self._loads.evaluate(before, after, time, angle)
        self._point = after
        self.next_step += samples
        return LoadBlock(first, values, float(angle[0] % (2.0 * np.pi)), after)

    def _angle(self, point: OperatingPoint, time: np.ndarray) -> np.ndarray:
        """Angle of the head (n,) at times (n,), rad, over all turns, since the chips follow each other along it."""
        since, angle = self._turning
        return angle + point.speed * (time - since)


class DynamicsStream:
    """Response block by block; a lost block of loads is bridged without a jump of the state.

    Parameters
    ----------
    machine : Machine
    rate_hz : float
        Rate of the loads, and 1/time step.
    level : "spectral" or "cutter"
        Of the received loads: a run starts under their mean.
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
    lost_steps, restarts, dropped : int
        Missing load samples; fresh starts after the first; blocks that did not belong to the stream.
    """

    def __init__(
        self, machine: Machine, rate_hz: float, level: LoadModel = "spectral", longest_bridge: float = 2.0
    ) -> None:
        self._loads = load_stepper(machine, level)
        self._system = machine.assemble()
        self._rate = rate_hz
        self._step = step_ns(rate_hz)
        self._longest = round(longest_bridge * rate_hz)
        self.nodes = default_outputs(machine)
        self._continuity: Continuity[np.ndarray] = Continuity(self._longest * self._step)
        self.lost_steps = self.restarts = 0
        self.meshes = self._system.couplings.drives
        self._point = self._loads.reached(machine.operating_point)
        self._ahead: list[tuple[int, OperatingPoint]] = []  # operating points, by the time from which they hold
        self._last = np.zeros(6)
        self.epoch_ns = 0
        self._started = False
        self._diverged = False
        self._simulator = self._new_simulator()

    def _new_simulator(self) -> Simulator:
        """Return a simulator in the static equilibrium of the operating point that holds now."""
        from tbm_dynamics.integration.simulator import Simulator  # noqa: PLC0415 - a stream of loads needs none

        self._changed = False  # the operating point, since the last block
        started = self._system.under(self._point, self.mean_loads)
        return Simulator(started, self.nodes, 1.0 / self._rate, ramp=LOAD_RAMP)

    @property
    def dropped(self) -> int:
        """Blocks that did not belong to the stream."""
        return self._continuity.dropped

    @property
    def operating_point(self) -> OperatingPoint:
        """That which holds now."""
        return self._point

    @property
    def mean_loads(self) -> np.ndarray:
        """Mean loads at the operating point that holds now, (6,), N and N·m."""
        return self._loads.mean(self._point)

    def warm_up(self) -> None:
        """Compile the kernel before the first block is due; the run itself stays at its start."""
        copy.deepcopy(self._simulator).step(np.tile(self.mean_loads, (2, 1)))

    def set_operating_point(self, point: OperatingPoint, stamp_ns: int = 0) -> None:
        """Speed from the first block on that begins at `stamp_ns` or later, torque linearly over it, as the loads.

        A run begins at the point of an earlier stamp. The point that holds already changes no bit of the run, whenever
        its message comes.

        Raises
        ------
        MachineError
            A point that the machine or its rock does not allow.
        """
        self._ahead.append((stamp_ns, self._loads.reached(point)))

    def _apply_points(self, stamp_ns: int) -> None:
        """Apply the operating points up to a time; the last one holds."""
        for stamp, point in self._ahead:
            if stamp <= stamp_ns and point != self._point:
                self._point, self._changed = point, True
        self._ahead = [(stamp, point) for stamp, point in self._ahead if stamp > stamp_ns]

    def process(self, stamp_ns: int, loads: np.ndarray) -> list[Chunk]:
        """Integrate over a block of loads (n, 6) whose first sample belongs to `stamp_ns`.

        Returns the chunk of the block; none while it waits, and several when blocks that waited are admitted, the
        straight line over a gap before them among these: see `Continuity`.

        Raises
        ------
        SimulationError
            Loads that are not finite: nothing has changed. A run that diverges: the next block starts afresh.
        """
        if not np.isfinite(loads).all():
            raise SimulationError("loads hold a value that is not finite")
        begins = self._diverged or not self._started
        end = None if begins else self.epoch_ns + self._simulator.next_step * self._step
        block = StreamBlock(stamp_ns, stamp_ns + len(loads) * self._step, self._step / 2, len(loads), loads)
        admitted = self._continuity.add(block, end)
        return [chunk for block in admitted for chunk in self._integrate(block.begin_ns, block.content)]

    def _integrate(self, stamp_ns: int, loads: np.ndarray) -> list[Chunk]:
        """Integrate over a block of the stream, and over the gap before it."""
        self._apply_points(stamp_ns - 1)
        missing = self._missing(stamp_ns)
        self._apply_points(stamp_ns)
        self._diverged = True
        bridge = []
        if missing:
            self.lost_steps += missing
            share = np.arange(1, missing + 1)[:, None] / (missing + 1)
            bridge.append(self._simulator.step(self._last + share * (loads[0] - self._last)))
        if self._changed:
            self._simulator.set_operating_point(self._point, over=len(loads))
        self._changed = False
        chunk = self._simulator.step(loads)
        self._diverged = False
        self._last = loads[-1].copy()
        return [*bridge, chunk]

    def _missing(self, stamp_ns: int) -> int:
        """Return the number of steps missing before a stamp; one that does not follow starts the run afresh."""
        if self._started:
            missing = round((stamp_ns - self.epoch_ns) / self._step) - self._simulator.next_step
            if 0 <= missing <= self._longest and not self._diverged:
                return missing
            self.restarts += 1
        if self._started or self._changed:
            self._simulator = self._new_simulator()
        self.epoch_ns, self._started = stamp_ns, True
        return 0
