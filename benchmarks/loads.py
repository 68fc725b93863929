"""Speed of the cutterhead loads, in one run of `python benchmarks/loads.py`.

Blocks of 500 samples at 10 kHz, as the loads node asks for them; first each is held against one call for the whole, bit
for bit. One core.
"""

from __future__ import annotations

import time

import numpy as np

from tbm_dynamics import OperatingPoint, load_machine
from tbm_dynamics.loads.stepper import LOAD_MODELS
from tbm_dynamics.streaming.schedule import Schedule
from tbm_dynamics.streaming.streams import LoadStream

RATE, BLOCK, BLOCKS = 10_000.0, 500, 1200


def main() -> None:
    """Run all."""
    machine = load_machine("dz101")
    print("| model | operating point | times real time, shortest second | over the whole minute |")
    print("| --- | --- | --- | --- |")
    for model in LOAD_MODELS:
        loads = machine.cutter_loads(1) if model == "cutter" else machine.loads(1)
        times = np.arange(BLOCK * BLOCKS) * (1.0 / RATE)
        stream = LoadStream(machine, 1, 1.0 / RATE, BLOCK, model)
        pieces = [stream.next_block().loads for _ in range(40)]
        if not np.array_equal(np.concatenate(pieces), loads.evaluate(times[: 40 * BLOCK])):
            raise SystemExit(f"{model}: pieces and the whole differ")
        for name, schedule in (("constant", None), ("changing in every block", _ramp(machine.operating_point))):
            report(f"{model} | {name}", LoadStream(machine, 1, 1.0 / RATE, BLOCK, model, schedule))


def _ramp(point: OperatingPoint) -> Schedule:
    """Down to three quarters of the thrust and the speed in a minute."""
    low = 0.75
    return Schedule(
        [0.0, 60.0], [point.speed, low * point.speed], [point.torque] * 2, [point.thrust, low * point.thrust]
    )


def report(name: str, stream: LoadStream) -> None:
    """Print a row of the table."""
    taken = []
    for _ in range(BLOCKS):
        start = time.perf_counter()
        stream.next_block()
        taken.append(time.perf_counter() - start)
    seconds = np.array(taken).reshape(-1, round(RATE) // BLOCK).sum(axis=1)
    print(f"| {name} | {1.0 / seconds.min():.0f} | {len(seconds) / seconds.sum():.0f} |")


if __name__ == "__main__":
    main()
