"""What a campaign costs beside its simulations, in one run of `python benchmarks/campaign.py`.

The same samples one after the other in this process, then as a campaign in two processes: first the outputs are held
against each other, bit for bit.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np

from tbm_gsa.sensitivity.study.campaign import run_campaign
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS
from tbm_gsa.sensitivity.study.problem import StudyProblem
from tbm_gsa.sensitivity.study.store import Store

SAMPLES, WORKERS = 60, 2


def main() -> None:
    """Run all."""
    evaluate = MachineEvaluation.of("dz101", 3.0, 0)
    problem = StudyProblem(PAPER_INPUTS, evaluate.outputs, SAMPLES, 0, 0, evaluate.settings)
    with tempfile.TemporaryDirectory() as folder, Store.create_or_open(Path(folder) / "store.sqlite", problem) as store:
        samples = [sample for _, sample in store.pending()]
        evaluate(samples[0])  # compiled and loaded
        start = time.perf_counter()
        direct = np.array([list(evaluate(sample).values()) for sample in samples])
        loop = time.perf_counter() - start
        ended: list[float] = []
        start = time.perf_counter()
        run_campaign(store, evaluate, workers=WORKERS, progress=lambda *_: ended.append(time.perf_counter() - start))
        campaign = time.perf_counter() - start
        if not np.array_equal(store.results("train")[1], direct):
            raise SystemExit("campaign and loop differ")
        simulated = store.simulation_seconds()
    running = campaign - ended[1]  # from the first result on
    print(f"| {SAMPLES} simulations of 3 s | s | a simulation, ms |")
    print("| --- | --- | --- |")
    print(f"| one after the other, one process | {loop:.1f} | {1e3 * loop / SAMPLES:.0f} |")
    print(f"| campaign in {WORKERS} processes | {campaign:.1f} | {1e3 * campaign / SAMPLES:.0f} |")
    print(f"| of it until the first result | {ended[1]:.1f} | |")
    print(f"faster by {loop / campaign:.2f}; workers busy for {simulated / WORKERS / campaign:.0%} of the whole,")
    print(f"once started {1e3 * running / (SAMPLES - 1):.0f} ms between results")


if __name__ == "__main__":
    main()
