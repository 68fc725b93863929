"""The model's side: one run a level of operation, reduced while it runs."""

from collections.abc import Mapping

import numpy as np

from tbm_dynamics import Machine
from tbm_dynamics.integration.simulator import MethodName
from tbm_dynamics.response import default_outputs
from tbm_dynamics.streaming.simulation import ModelRun
from tbm_gsa.comparison.drive_sides import DriveReducer
from tbm_gsa.signals.conditioning import LOW_PASS_LIMIT_HZ
from tbm_gsa.signals.reduction import ReducedSignal, SignalReducer
from tbm_msgs_py.base.progress import ShareDone


def run_model(
    machine: Machine,
    duration: float,
    seed: int,
    reducers: Mapping[str, SignalReducer],
    time_step: float,
    settling: float,
    progress: ShareDone = lambda _: None,
    high_hz: float = LOW_PASS_LIMIT_HZ,
    drives: DriveReducer | None = None,
) -> dict[str, ReducedSignal]:
    """Simulate a machine at its operating point and reduce the accelerations of test points, the settling left out.

    Parameters
    ----------
    machine : Machine
    duration : float
        s.
    seed : int
        Of the loads.
    reducers : mapping of str to SignalReducer
        By test point; of the rate of the run.
    time_step, settling : float
        s.
    progress : callable
        Called with the share that is done, 0 to 1.
    high_hz : float
        Up to which the accelerations are wanted: what the reduced basis does not hold comes from the full system.
    drives : DriveReducer, optional
        Fed with the drives.
    """
    places = [machine.description.sensor_places[point] for point in reducers]
    method: MethodName = "reduced" if high_hz <= LOW_PASS_LIMIT_HZ else "full"
    rotors = drives.nodes if drives else ()
    nodes = [*(place.node for place in places), *rotors] or default_outputs(machine)[:1]  # a run has one at least
    run = ModelRun(machine, duration, seed, nodes, time_step=time_step, settling=settling, method=method)
    for chunk in run.chunks(progress=progress):
        time = np.arange(chunk.first_step, chunk.first_step + len(chunk.mesh_force), dtype=np.float64) * time_step
        for k, (place, reducer) in enumerate(zip(places, reducers.values(), strict=True)):
            reducer.feed(time, np.ascontiguousarray(place.translation(chunk.acceleration[:, k])))
        if drives:
            drives.feed(chunk)
    return {point: reducer.finish() for point, reducer in reducers.items()}
