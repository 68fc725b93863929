"""Speed of band powers over the level of the loads, in one run of `python benchmarks/load_transfer.py`.

Prediction of dz101 and of varied machines, its scatter, and the factors found from one recording. The accelerance is
held against numpy's solution of the full matrices, and the prediction against a run, before the times are printed.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from tbm_dynamics import Machine, Simulator, load_machine
from tbm_dynamics.frequency_response import FrequencyResponse
from tbm_dynamics.integration import DEFAULT_STEP
from tbm_dynamics.loads.description import LOAD_GROUPS, LoadFactors
from tbm_gsa.explanation.band_reading import BandReading, Sensor
from tbm_gsa.explanation.load_posterior import BandObservation, load_posterior
from tbm_gsa.explanation.load_scatter import load_scatter
from tbm_gsa.explanation.load_transfer import load_transfer, machine_motion
from tbm_gsa.signals.reduction import SignalReducer
from tbm_gsa.signals.settings import Settings

START_S, RUN_S, CHUNK = 3.0, 24.0, 10_000
VARIED = 8
Result = TypeVar("Result")


def timed(call: Callable[[], Result]) -> tuple[Result, float, float]:
    """Give what a call gives, and how long it took: s by the clock, s of the processor."""
    clock, processor = time.perf_counter(), time.process_time()
    result = call()
    return result, time.perf_counter() - clock, time.process_time() - processor


def of_a_run(machine: Machine, reading: BandReading) -> np.ndarray:
    """Band powers of a run."""
    nodes = [machine.description.test_points[point] for point in reading.sensors]
    simulator, loads = Simulator(machine.assemble(), nodes), machine.loads(1)
    reducers = [SignalReducer(reading.rate_hz, reading.band, "fixed", Settings()) for _ in nodes]
    for first in range(0, round((START_S + RUN_S) / DEFAULT_STEP), CHUNK):
        moment = np.arange(first, first + CHUNK) * DEFAULT_STEP
        values = simulator.step(loads.evaluate(moment)).acceleration
        if moment[0] >= START_S:
            for place, reducer in enumerate(reducers):
                reducer.feed(moment - START_S, np.ascontiguousarray(values[:, place, :3]))
    return reading.of({point: reducer.finish() for point, reducer in zip(reading.sensors, reducers, strict=True)})


def largest_error(machine: Machine) -> float:
    """Error of the accelerance at the test points over the largest value at the frequency under the load."""
    system, frequency = machine.assemble(), np.array([1.0, 13.0, 105.0, 130.3])
    dofs = [system.dof(node, axis) for node in machine.description.test_points.values() for axis in ("ux", "uy", "uz")]
    found = FrequencyResponse(system, np.eye(system.size)[dofs]).accelerance(frequency)
    omega = 2.0 * np.pi * frequency[:, None, None]
    forces = np.broadcast_to(np.eye(system.size)[:, system.load_dofs], (len(omega), system.size, 6))
    exact = -(omega**2) * np.linalg.solve(system.K + 1j * omega * system.C - omega**2 * system.M, forces)[:, dofs]
    # The torque moves no point on the axis.
    largest = np.abs(exact).max(axis=1)
    felt = np.array([0, 1, 2, 4, 5])
    return float((np.abs(found - exact).max(axis=1) / largest)[:, felt].max())


def main() -> None:
    """Hold results against others and print times."""
    machine = load_machine("dz101")
    reading = BandReading(
        {point: Sensor() for point in machine.description.test_points}, machine.description.loads.bands
    )
    names, noise = [one.name for one in reading.statistics], np.full(len(reading.statistics), (1e-4 * 9.81) ** 2)
    print(f"accelerance against the full matrices: {100.0 * largest_error(machine):.2g} % of the largest")
    motion, first, _ = timed(lambda: machine_motion(machine, reading))
    scatter, scatter_s, scatter_cpu = timed(lambda: load_scatter(motion))
    powers = of_a_run(machine, reading) + scatter.width * noise
    found, posterior_s, posterior_cpu = timed(
        lambda: load_posterior(BandObservation(powers, noise, RUN_S), scatter, LoadFactors())
    )
    worst = int(np.abs(found.standardised).argmax())
    print(
        f"a run of {RUN_S:g} s against the prediction: χ² {found.misfit:.1f} of {found.freedom:.1f} degrees of "
        f"freedom, farthest {names[found.used[worst]]} by {found.standardised[worst]:.1f} standard deviations"
    )
    for group, factor, ends, learnt in zip(LOAD_GROUPS, found.factors, found.interval, found.learnt, strict=True):
        print(f"  {group:13s} {factor:5.2f} ({ends[0]:.2f} to {ends[1]:.2f}), learnt {learnt:.2f}")
    print("\n                              clock, s   processor, s")
    print(f"first machine, compiling        {first:6.2f}")
    _, nominal_s, nominal_cpu = timed(lambda: load_transfer(machine, reading))
    print(f"a machine                       {nominal_s:6.2f}   {nominal_cpu:6.2f}")
    values = np.linspace(0.5, 1.6, VARIED)
    _, varied_s, varied_cpu = timed(
        lambda: [load_transfer(machine.with_inputs(x16=float(value)), reading) for value in values]
    )
    print(f"a varied machine, mean of {VARIED}     {varied_s / VARIED:6.2f}   {varied_cpu / VARIED:6.2f}")
    print(f"scatter                         {scatter_s:6.2f}   {scatter_cpu:6.2f}")
    print(f"factors of one recording        {posterior_s:6.3f}   {posterior_cpu:6.3f}")


if __name__ == "__main__":
    main()
