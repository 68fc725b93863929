"""Speed of the cutterhead loads, in one run of `python benchmarks/loads.py`.

Blocks of 500 samples at 10 kHz, as the loads node asks for them; first each is held against one call for the whole, bit
for bit. One core.
"""

from __future__ import annotations

import time

import numpy as np

from tbm_dynamics import load_machine

RATE, BLOCK, BLOCKS = 10_000.0, 500, 1200


def main() -> None:
    """Run all."""
    machine = load_machine("dz101")
    print("| level | times real time, shortest second | over the whole minute |")
    print("| --- | --- | --- |")
    for name, loads in (("spectral", machine.loads(1)), ("cutter", machine.cutter_loads(1))):
        times = np.arange(BLOCK * BLOCKS) / RATE
        pieces = [loads.evaluate(part) for part in np.split(times[: 40 * BLOCK], 40)]
        if not np.array_equal(np.concatenate(pieces), loads.evaluate(times[: 40 * BLOCK])):
            raise SystemExit(f"{name}: pieces and the whole differ")
        taken = []
        for part in np.split(times, BLOCKS):
            start = time.perf_counter()
            loads.evaluate(part)
            taken.append(time.perf_counter() - start)
        seconds = np.array(taken).reshape(-1, round(RATE) // BLOCK).sum(axis=1)
        print(f"| {name} | {1.0 / seconds.min():.0f} | {len(seconds) / seconds.sum():.0f} |")


if __name__ == "__main__":
    main()
