"""A run from start to end: machine → response."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Literal

import numpy as np

from tbm_dynamics.integration.errors import SimulationError
from tbm_dynamics.integration.simulator import DEFAULT_STEP, Chunk, MethodName, Simulator
from tbm_dynamics.loads.cutters import CutterLoads
from tbm_dynamics.loads.spectral import SpectralLoads
from tbm_dynamics.machine.machine import Machine
from tbm_dynamics.response import Response
from tbm_dynamics.structure.drive import gear_pair
from tbm_dynamics.structure.system import System

_CHUNK_STEPS = 8192

LoadLevel = Literal["spectral", "cutter"]

Progress = Callable[[float], None]
"""Called with the share of the run that is done, 0 to 1."""


def default_outputs(machine: Machine) -> tuple[int, ...]:
    """Nodes of the test points, the ring gear's mesh plane and the first pinion's mesh node."""
    drive = machine.description.driveshaft
    nodes = [*machine.description.test_points.values(), drive.ring_node, drive.pinion_nodes_from + 1]
    return tuple(dict.fromkeys(nodes))


def simulate(
    machine: Machine,
    duration: float = 3.0,
    seed: int = 0,
    *,
    time_step: float = DEFAULT_STEP,
    method: MethodName = "reduced",
    loads: LoadLevel = "spectral",
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
    outputs : iterable of int, optional
        Nodes whose motion is kept; test points, 8 and 14 by default. The indicators need the last two.
    progress : callable, optional

    Raises
    ------
    MachineError
        A machine that cannot be assembled, an unknown node, a file without cutters.
    SimulationError
        A duration without steps, a run that diverges.
    """
    steps = round(duration / time_step) if duration > 0.0 and np.isfinite(duration) else 0
    if steps < 1:
        raise SimulationError(f"duration {duration} s: must be at least one time step of {time_step} s")
    nodes = default_outputs(machine) if outputs is None else tuple(outputs)
    system, wanted = _under(machine, seed, loads)
    simulator = Simulator(system, nodes, time_step, method)
    time = np.arange(steps) * time_step
    run = Chunk(0, np.empty((steps, 2, len(nodes), 6)), np.empty((steps, system.couplings.drives)))
    for first in range(0, steps, _CHUNK_STEPS):
        part = slice(first, min(first + _CHUNK_STEPS, steps))
        simulator.step(wanted.evaluate(time[part]), Chunk(first, run.motion[part], run.mesh_force[part]))
        if progress is not None:
            progress(part.stop / steps)
    drive = machine.description.driveshaft
    return Response(
        time=time,
        nodes=nodes,
        displacements=run.displacement,
        accelerations=run.acceleration,
        mesh_force=run.mesh_force,
        ring_node=drive.ring_node,
        pinion_node=drive.pinion_nodes_from + 1,
        static_mesh_force=system.operating_point.torque / (drive.count * gear_pair(drive).ring_base_radius),
        states=simulator.states,
    )


def _under(machine: Machine, seed: int, level: LoadLevel) -> tuple[System, SpectralLoads | CutterLoads]:
    """Assemble the system that stands under the mean of a level's loads, and give these."""
    system = machine.assemble()
    if level == "spectral":
        return system, machine.loads(seed)
    loads = machine.cutter_loads(seed)
    point = replace(system.operating_point, torque=-float(loads.mean[3]))
    return replace(system, mean_load=loads.mean, operating_point=point), loads
