"""A run from start to end: from a machine to its response."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np

from tbm_dynamics.integration import LOAD_RAMP
from tbm_dynamics.integration.condensed import own_step
from tbm_dynamics.integration.simulator import Chunk, MethodName, Simulator
from tbm_dynamics.loads.stepper import LoadModel
from tbm_dynamics.machine.machine import Machine
from tbm_dynamics.machine.sensor_place import SensorPlace, place_of
from tbm_dynamics.response import Response, default_outputs
from tbm_dynamics.streaming.schedule import Schedule
from tbm_dynamics.streaming.streams import LoadStream
from tbm_dynamics.structure.drive import gear_pair
from tbm_msgs_py.base.errors import SimulationError
from tbm_msgs_py.base.progress import ShareDone

_BLOCK_STEPS = 8192
_CHANGE_S = 0.05  # blocks of a schedule: those of the load node

"""Called with the fraction of the run that is done, 0 to 1."""


class ModelRun:
    """A run of a machine from its static equilibrium under its loads, chunk by chunk.

    Parameters
    ----------
    machine, duration, seed, time_step, settling, method, loads, schedule
        As for `simulate`.
    nodes : iterable of int
        Nodes whose motion is wanted.

    Attributes
    ----------
    settled, steps : int
        Step at which the settling ends, and their number in all.
    time_step : float
        s.
    torque : float
        Mean torque of the cutterhead over the steps that are done, the settling left out, N·m.
    """

    def __init__(
        self,
        machine: Machine,
        duration: float,
        seed: int,
        nodes: Iterable[int],
        *,
        time_step: float | None = None,
        settling: float = 0.0,
        method: MethodName = "reduced",
        loads: LoadModel = "spectral",
        schedule: Schedule | None = None,
    ) -> None:
        system = machine.assemble()
        self.time_step = time_step = own_step(system) if time_step is None else time_step
        steps = round(duration / time_step) if duration > 0.0 and np.isfinite(duration) else 0
        self.settled = round(settling / time_step)
        self.steps = self.settled + steps
        if steps < 1:
            raise SimulationError(f"duration {duration} s: must be at least one time step of {time_step} s")
        samples = _BLOCK_STEPS if schedule is None else max(1, round(_CHANGE_S / time_step))
        self._stream = LoadStream(machine, seed, time_step, min(samples, self.steps), loads, schedule)
        started = system.under(self._stream.operating_point, self._stream.mean)
        self.simulator = Simulator(started, nodes, time_step, method, ramp=LOAD_RAMP)
        self.torque = 0.0

    def chunks(self, into: Chunk | None = None, progress: ShareDone | None = None) -> Iterator[Chunk]:
        """Chunks of the run after its settling, written to the rows of `into` if it is given."""
        stream, impulse = self._stream, 0.0
        while (first := stream.next_step) < self.steps:
            before, block = stream.operating_point, stream.next_block()
            part = slice(first, min(stream.next_step, self.steps))
            if block.operating_point != before:
                self.simulator.set_operating_point(block.operating_point, over=len(block.loads))
            for begin, stop in self._pieces(first, part.stop):
                rows = (
                    None
                    if into is None or begin < self.settled
                    else into.rows(begin - self.settled, stop - self.settled)
                )
                chunk = self.simulator.step(block.loads[begin - first : stop - first], rows)
                if begin >= self.settled:
                    impulse += 0.5 * (before.torque + block.operating_point.torque) * (stop - begin)
                    self.torque = impulse / (stop - self.settled)
                    yield chunk
            if progress:
                progress(part.stop / self.steps)

    def _pieces(self, first: int, stop: int) -> list[tuple[int, int]]:
        """Parts of a block before and after the end of the settling."""
        borders = sorted({first, min(max(first, self.settled), stop), stop})
        return list(pairwise(borders))


def _nodes(outputs: Iterable[int | SensorPlace]) -> tuple[int, ...]:
    return tuple(dict.fromkeys(place_of(output).node for output in outputs))


def simulate(
    machine: Machine,
    duration: float = 3.0,
    seed: int = 0,
    *,
    time_step: float | None = None,
    settling: float = 0.0,
    method: MethodName = "reduced",
    loads: LoadModel = "spectral",
    schedule: Schedule | None = None,
    outputs: Iterable[int | SensorPlace] | None = None,
    progress: ShareDone | None = None,
) -> Response:
    """Run a machine from its static equilibrium under its loads.

    Parameters
    ----------
    machine : Machine
    duration : float
        s.
    seed : int
        Of the load realisation.
    time_step : float, optional
        s; the machine's own without it.
    settling : float
        Time that is run before, and left out of the response (s): `Machine.settling` of what statistics are taken of.
    method : "reduced" or "full"
    loads : "spectral" or "cutter"
        The spectra of the file, or the discs' forces; the motors then hold the mean torque of the discs.
    schedule : Schedule, optional
        Operating point over time, taken every 50 ms and linear in between; the machine's own without it.
    outputs : iterable of int or SensorPlace, optional
        Nodes or test points whose motion is kept; test points, 8 and 14 by default. The indicators need the last two.
    progress : callable, optional

    Raises
    ------
    MachineError
        A machine that cannot be assembled, an unknown node, a file without cutters, an operating point that the
        machine or its rock does not allow.
    SimulationError
        A duration without steps, a run that diverges.
    """
    nodes = default_outputs(machine) if outputs is None else _nodes(outputs)
    run = ModelRun(
        machine,
        duration,
        seed,
        nodes,
        time_step=time_step,
        settling=settling,
        method=method,
        loads=loads,
        schedule=schedule,
    )
    drive, steps = machine.description.driveshaft, np.arange(run.settled, run.steps)
    whole = Chunk(run.settled, np.empty((len(steps), 2, len(nodes), 6)), np.empty((len(steps), drive.count)))
    for _ in run.chunks(whole, progress):
        pass
    return Response(
        time=steps * run.time_step,
        nodes=nodes,
        displacements=whole.displacement,
        accelerations=whole.acceleration,
        mesh_force=whole.mesh_force,
        ring_node=drive.ring_node,
        pinion_node=drive.pinion_nodes_from + 1,
        static_mesh_force=run.torque / (drive.count * gear_pair(drive).driven_base_radius),
        states=run.simulator.states,
    )
