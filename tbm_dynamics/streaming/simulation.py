"""A run from start to end: from a machine to its response."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from tbm_dynamics.integration.simulator import DEFAULT_STEP, Chunk, MethodName, Simulator
from tbm_dynamics.loads.stepper import LoadModel
from tbm_dynamics.machine.machine import Machine
from tbm_dynamics.response import Response, default_outputs
from tbm_dynamics.streaming.schedule import Schedule
from tbm_dynamics.streaming.streams import LoadStream
from tbm_dynamics.structure.drive import gear_pair
from tbm_msgs_py.base.errors import SimulationError

_BLOCK_STEPS = 8192
_CHANGE_S = 0.05  # blocks of a schedule: those of the load node

Progress = Callable[[float], None]
"""Called with the fraction of the run that is done, 0 to 1."""


def simulate(
    machine: Machine,
    duration: float = 3.0,
    seed: int = 0,
    *,
    time_step: float = DEFAULT_STEP,
    method: MethodName = "reduced",
    loads: LoadModel = "spectral",
    schedule: Schedule | None = None,
    outputs: Iterable[int] | None = None,
    progress: Progress | None = None,
) -> Response:
    """Run a machine from its static equilibrium under its loads.

    Parameters
    ----------
    machine : Machine
    duration : float
        s.
    seed : int
        Of the load realisation.
    time_step : float
        s.
    method : "reduced" or "full"
    loads : "spectral" or "cutter"
        Table 1's spectra, or the discs' forces; the motors then hold the mean torque of the discs.
    schedule : Schedule, optional
        Operating point over time, taken every 50 ms and linear in between; the machine's own without it.
    outputs : iterable of int, optional
        Nodes whose motion is kept; test points, 8 and 14 by default. The indicators need the last two.
    progress : callable, optional

    Raises
    ------
    MachineError
        A machine that cannot be assembled, an unknown node, a file without cutters, an operating point that the
        machine or its rock does not allow.
    SimulationError
        A duration without steps, a run that diverges.
    """
    steps = round(duration / time_step) if duration > 0.0 and np.isfinite(duration) else 0
    if steps < 1:
        raise SimulationError(f"duration {duration} s: must be at least one time step of {time_step} s")
    nodes = default_outputs(machine) if outputs is None else tuple(outputs)
    samples = _BLOCK_STEPS if schedule is None else max(1, round(_CHANGE_S / time_step))
    system = machine.assemble()
    stream = LoadStream(machine, seed, time_step, min(samples, steps), loads, schedule)
    simulator = Simulator(system.under(stream.operating_point, stream.mean), nodes, time_step, method)
    run = Chunk(0, np.empty((steps, 2, len(nodes), 6)), np.empty((steps, system.couplings.drives)))
    torque = _integrate(stream, simulator, run, progress)
    drive = machine.description.driveshaft
    return Response(
        time=np.arange(steps) * time_step,
        nodes=nodes,
        displacements=run.displacement,
        accelerations=run.acceleration,
        mesh_force=run.mesh_force,
        ring_node=drive.ring_node,
        pinion_node=drive.pinion_nodes_from + 1,
        static_mesh_force=torque / (drive.count * gear_pair(drive).ring_base_radius),
        states=simulator.states,
    )


def _integrate(stream: LoadStream, simulator: Simulator, run: Chunk, progress: Progress | None) -> float:
    """Integrate a run into its arrays; returns the mean torque of the cutterhead over it, N·m."""
    steps, torque = len(run.mesh_force), 0.0
    while (first := stream.next_step) < steps:
        before = stream.operating_point
        block = stream.next_block()
        part = slice(first, min(stream.next_step, steps))
        if block.operating_point != before:
            simulator.set_operating_point(block.operating_point, over=len(block.loads))
        simulator.step(block.loads[: part.stop - first], Chunk(first, run.motion[part], run.mesh_force[part]))
        torque += 0.5 * (before.torque + block.operating_point.torque) * (part.stop - first)
        if progress:
            progress(part.stop / steps)
    return torque / steps
