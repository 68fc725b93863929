"""Speed and memory of the dynamics, in one run of `python benchmarks/dynamics.py [--quick]`.

1. Methods on the shipped machine, 0.3 s under its loads: the production kernel, the reference method compiled and in
   numpy, scipy's BDF and Radau. Each must first give the eight indicators within 1 % of Radau at a tolerance of 1e-7;
   the ODE solvers run at the loosest tolerance that does. Then they are timed, the shortest of several runs.
2. Streaming: loads and steps together, five test points, in blocks; what a live node does.
3. How the cost grows with drives, states and step, and with drives that are not like the others.
4. Set-up of a varied machine; a run of 60 s with stored test points in a process of its own; a start with nothing
   compiled.

One core: BLAS is held to one thread. Timings of shared machines vary by a third; ratios are of one run.
"""

from __future__ import annotations

import argparse
import functools
import math
import os
import subprocess
import sys
import tempfile
import time
import timeit
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "test" / "dynamics"))  # the ODE written out once more

import numpy as np
from numpy_full_size import NumpyLobatto
from reference_motion import reference_motion, start_of

from tbm_dynamics import Machine, Simulator, load_machine
from tbm_dynamics.indicators import indicators
from tbm_dynamics.integration.basis import split_basis
from tbm_dynamics.integration.lobatto import Lobatto
from tbm_dynamics.integration.simulator import Chunk
from tbm_dynamics.machine.description import MachineDescription
from tbm_dynamics.structure.system import System

STEP = 1e-4
DURATION = 0.3
ALLOWED = 0.01
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


def shortest(run: Callable[[], object], repeats: int) -> float:
    """Shortest time of several runs, s."""
    return min(timeit.repeat(run, number=1, repeat=repeats))


class Case:
    """The shipped machine for 0.3 s, and how well a method does on it."""

    def __init__(self) -> None:
        self.machine = load_machine("dz101")
        self.system = self.machine.assemble()
        self.times = np.arange(round(DURATION / STEP)) * STEP
        self.loads = self.machine.loads(3).evaluate(self.times)
        self.start = start_of(self.system)
        self.exact = self.by_solver("Radau", 1e-7)

    def by_solver(self, solver: str, tolerance: float) -> np.ndarray:
        """Return the indicators of one of scipy's solvers."""
        speed = self.machine.operating_point.speed
        loads = functools.partial(_interpolated, self.times, self.loads)
        motion = reference_motion(
            self.system, self.start, loads, self.times, lambda t: speed * t, tolerance=tolerance, solver=solver
        )
        displacement, acceleration = (part.reshape(len(self.times), -1, 6) for part in motion[:2])
        ring, pinion = (self.system.nodes.index(node) for node in (8, 14))
        return _table_3(displacement[:, ring], acceleration[:, pinion], motion[2])

    def by_simulator(self, method: str) -> np.ndarray:
        """Return the indicators of one of the simulator's methods."""
        chunk = Simulator(self.system, (8, 14), STEP, method).step(self.loads)
        return _table_3(chunk.displacement[:, 0], chunk.acceleration[:, 1], chunk.mesh_force)

    def error(self, computed: np.ndarray) -> float:
        """Largest relative error of an indicator."""
        return float(np.abs(computed / self.exact - 1.0).max())


def _interpolated(times: np.ndarray, loads: np.ndarray, t: float) -> np.ndarray:
    return np.array([np.interp(t, times, column) for column in loads.T])


def _table_3(ring: np.ndarray, pinion: np.ndarray, force: np.ndarray) -> np.ndarray:
    return np.array(list(indicators(ring, pinion, force, 1.0).values()))


def compare_methods(quick: bool) -> None:
    """Print time and error of each method."""
    case = Case()
    rows = []
    for name, method, repeats in (
        ("production (reduced)", "reduced", 10),
        ("reference (full), compiled", "full", 3),
        ("reference (full), numpy", "full", 1),
    ):
        with patch("tbm_dynamics.integration.simulator.Lobatto", NumpyLobatto if "numpy" in name else Lobatto):
            error = case.error(case.by_simulator(method))
            if error > ALLOWED:
                sys.exit(f"{name}: an indicator is off by {error:.1%}, allowed is {ALLOWED:.0%}")
            simulator = Simulator(case.system, (8, 14), STEP, method)
            rows.append((name, error, shortest(functools.partial(simulator.step, case.loads), repeats)))
    for solver in ("Radau",) if quick else ("Radau", "BDF"):
        for tolerance in TOLERANCES:
            start = time.perf_counter()
            error = case.error(case.by_solver(solver, tolerance))
            seconds = time.perf_counter() - start
            if error <= ALLOWED:
                rows.append((f"scipy {solver}, tolerance {tolerance:g}", error, seconds))
                break
        else:
            print(f"scipy {solver}: no tolerance down to {TOLERANCES[-1]:g} gives every indicator within 1 %")
    print("\n| method, 0.3 s of dz101 | largest error of an indicator | times real time | production is faster by |")
    print("| --- | --- | --- | --- |")
    for name, error, seconds in rows:
        print(f"| {name} | {error:.2%} | {DURATION / seconds:.3g} | {seconds / rows[0][2]:.3g} |")


def streaming(
    machine: Machine, system: System, step: float = STEP, blocks: int = 100, with_loads: bool = True
) -> tuple[float, float, int]:
    """Shortest and median time of a step (s) and number of states, five test points, blocks of 2048 steps."""
    nodes, size = tuple(machine.description.test_points.values()), 2048
    simulator, loads = Simulator(system, nodes, step), machine.loads(0)
    into = Chunk(0, np.empty((size, 2, len(nodes), 6)), np.empty((size, system.couplings.drives)))
    known = loads.evaluate(np.arange(size) * step)
    times = []
    for block in range(blocks + 5):
        start = time.perf_counter()
        instants = (block * size + np.arange(size)) * step
        simulator.step(loads.evaluate(instants) if with_loads else known, into)
        times.append((time.perf_counter() - start) / size)
    return min(times[5:]), float(np.median(times[5:])), simulator.states


def print_streaming() -> None:
    """Print the streaming speed of both shipped machines."""
    print("\n| streaming, loads included | states | µs a step, shortest | times real time | median |")
    print("| --- | --- | --- | --- | --- |")
    for name in ("dz101", "open380"):
        machine = load_machine(name)
        best, median, states = streaming(machine, machine.assemble(), blocks=300)
        print(f"| {name} | {states} | {best * 1e6:.2f} | {STEP / best:.1f} | {STEP / median:.1f} |")


def print_growth() -> None:
    """Print how the cost grows."""
    machine = load_machine("dz101")
    system = machine.assemble()
    print("\n| without loads | states | µs a step | times real time |")
    print("| --- | --- | --- | --- |")

    def row(label: str, machine: Machine, system: System, step: float = STEP) -> None:
        best, _, states = streaming(machine, system, step, with_loads=False)
        print(f"| {label} | {states} | {best * 1e6:.2f} | {step / best:.1f} |")

    for count in (1, 2, 5, 8, 10, 16, 20, 40):
        drive = machine.base.driveshaft.model_copy(update={"count": count})
        other = Machine(machine.base.model_copy(update={"driveshaft": drive}))
        row(f"{count} drives", other, other.assemble())
    for tolerance in (3e-2, 1e-2, 3e-3, 1e-3, 1e-4):
        with patch(
            "tbm_dynamics.integration.condensed.split_basis", functools.partial(split_basis, tolerance=tolerance)
        ):
            row(f"basis to {tolerance:g}", machine, system)
    for step in (2.5e-5, 5e-5, 1e-4, 2e-4, 4e-4):
        row(f"step {step:g} s", machine, system, step)


ODD = {
    "alike": {},
    "two worn": {3: {"backlash": 450e-6, "mesh_error": 2.0}, 8: {"tooth_stiffness": 0.8, "torque_share": 1.05}},
    "two with a bad tooth": {3: {"tooth": {"fault": "crack", "share": 0.3}}, 8: {"tooth": {"fault": "missing"}}},
    "two elsewhere": {3: {"angle": 70.0}, 8: {"angle": 250.0}},
    "two on softer seats": {3: {"seat_stiffness": 0.5}, 8: {"seat_stiffness": 0.7}},
    "two off": {3: {"off": True}, 8: {"off": True}},
}
"""Drives of dz101 that differ."""


def print_odd() -> None:
    """Print the cost of two odd drives over that of alike ones, in turns of one run: the shortest of all blocks."""
    base = load_machine("dz101").base.model_dump()
    machines = {name: Machine(MachineDescription.model_validate({**base, "drives": odd})) for name, odd in ODD.items()}
    times = dict.fromkeys(ODD, math.inf)
    for _ in range(5):
        for name, machine in machines.items():
            times[name] = min(times[name], streaming(machine, machine.assemble(), blocks=15)[0])
    print("\n| ten drives, loads included | µs a step, shortest | of alike |")
    print("| --- | --- | --- |")
    for name, best in times.items():
        print(f"| {name} | {best * 1e6:.2f} | {best / times['alike']:.2f} |")


def print_setup() -> None:
    """Print the time from changed inputs to a simulator that is ready."""
    machine = load_machine("dz101")
    nodes = tuple(machine.description.test_points.values())
    factor = iter(np.linspace(0.9, 1.1, 20))

    def build() -> None:
        Simulator(machine.with_inputs(x11=float(next(factor))).assemble(), nodes)

    print(f"\nset-up of a varied machine, assembly and basis: {shortest(build, 15) * 1e3:.0f} ms")


_RUN = """
import resource, time
from tbm_dynamics import load_machine, simulate
machine = load_machine("dz101")
simulate(machine, 0.01)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
start = time.perf_counter()
response = simulate(machine, 60.0)
seconds = time.perf_counter() - start
after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
size = sum(part.nbytes for part in (response.time, response.displacements, response.accelerations, response.mesh_force))
print(f"60 s with stored test points: {size / 1e6:.0f} MB of arrays, {after / 1e3:.0f} MB of the process at most "
      f"({before / 1e3:.0f} MB before), {60.0 / seconds:.1f} times real time")
"""

_COLD = """
import time
import timeit
start = time.perf_counter()
from tbm_dynamics import Simulator, load_machine
machine = load_machine("dz101")
Simulator(machine.assemble(), (3,)).step(machine.loads().evaluate([0.0, 1e-4]))
print(f"from an empty cache of compiled code to the first block: {time.perf_counter() - start:.1f} s")
"""


def print_processes() -> None:
    """Print memory of a long run, and a start with nothing compiled."""
    subprocess.run([sys.executable, "-c", _RUN], check=True)
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-c", _COLD], check=True, env={**os.environ, "NUMBA_CACHE_DIR": folder})


def main() -> None:
    """Run all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="leave out BDF")
    quick = parser.parse_args().quick
    print_streaming()
    print_growth()
    print_odd()
    print_setup()
    sys.stdout.flush()
    print_processes()
    compare_methods(quick)


if __name__ == "__main__":
    main()
