"""The model's side: one run a level of operation, reduced while it runs."""

from collections.abc import Callable, Mapping

import numpy as np

from tbm_dynamics import Machine, Simulator
from tbm_dynamics.integration.simulator import DEFAULT_STEP
from tbm_gsa.signals.reduction import ReducedSignal, SignalReducer

MODEL_RATE_HZ = 1.0 / DEFAULT_STEP
_CHUNK_STEPS = 8192


def run_model(
    machine: Machine,
    duration: float,
    seed: int,
    reducers: Mapping[str, SignalReducer],
    progress: Callable[[float], None] = lambda _: None,
) -> dict[str, ReducedSignal]:
    """Simulate a machine at its operating point and reduce the accelerations of test points, at the default step.

    Parameters
    ----------
    machine : Machine
    duration : float
        s.
    seed : int
        Of the loads.
    reducers : mapping of str to SignalReducer
        By test point.
    progress : callable
        Called with the share that is done, 0 to 1.
    """
    nodes = machine.description.test_points
    simulator = Simulator(machine.assemble(), [nodes[point] for point in reducers])
    loads = machine.loads(seed)
    steps = round(duration / DEFAULT_STEP)
    for first in range(0, steps, _CHUNK_STEPS):
        time = np.arange(first, min(first + _CHUNK_STEPS, steps), dtype=np.float64) * DEFAULT_STEP
        acceleration = simulator.step(loads.evaluate(time)).acceleration
        for place, reducer in enumerate(reducers.values()):
            reducer.feed(time, np.ascontiguousarray(acceleration[:, place, :3]))
        progress((first + len(time)) / steps)
    return {point: reducer.finish() for point, reducer in reducers.items()}
