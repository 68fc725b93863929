"""Ways to give simulations their loads, at equal cost: `python benchmarks/realisations.py BANK.npz [STUDIES]`.

A bank holds every point of two designs of 200 under 32 realisations of the loads (12 800 runs of 3 s of `dz101`, half
an hour on a core; it is made where it is missing). The reference is a study of both designs' means over the
realisations. Studies of 200 runs are drawn from the bank: one realisation common to all runs, one for each, or 20 that
are shared out. Of each output's five leading inputs: error of S1, half-width of its interval, how often S1's and ST's
hold the reference; and R² of the ten folds.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tbm_dynamics import load_machine, simulate
from tbm_dynamics.indicators import INDICATORS
from tbm_gsa.sensitivity.study.analysis import OutputFit, _fit_output, _Task
from tbm_gsa.sensitivity.study.candidates import Data
from tbm_gsa.sensitivity.study.design import make_design
from tbm_gsa.sensitivity.study.evaluate import _seed_of
from tbm_gsa.sensitivity.study.machine_inputs import default_inputs

DESIGNS, POINTS, REALISATIONS, SHARED, LEADING = 2, 200, 32, 20, 5
METHODS = ("krg", "svr", "prs")  # radial basis functions are within 0.002 of Kriging and take longer than all others
WAYS = ("common", "own", "shared")


def make_bank(path: Path) -> None:
    """Simulate the bank."""
    machine = load_machine("dz101")
    inputs, settling = default_inputs(machine), machine.settling()
    designs = np.stack([make_design(inputs, POINTS, 0, 100 + d).train for d in range(DESIGNS)])
    found = np.empty((DESIGNS, POINTS, REALISATIONS, len(INDICATORS)))
    drive = machine.description.driveshaft
    nodes = drive.ring_node, drive.pinion_nodes_from + 1
    for place in np.ndindex(DESIGNS, POINTS):
        varied = machine.with_inputs(**inputs.sample(designs[place]))
        for k in range(REALISATIONS):
            run = simulate(varied, 3.0, _seed_of(0, k), time_step=1e-4, settling=settling, outputs=nodes)
            found[place][k] = list(run.indicators().values())
        print(f"\r{place}", end="", file=sys.stderr)
    np.savez(path, designs=designs, outputs=found)


def fitted(name: str, unit: np.ndarray, values: np.ndarray, labels: np.ndarray | None = None) -> OutputFit:
    """Fit an output as a study does."""
    data = Data(unit, values, unit[:0], values[:0], labels, None if labels is None else labels[:0])
    found = _fit_output(_Task(name, data, default_inputs(load_machine("dz101")), METHODS, 0))
    if not isinstance(found, OutputFit):
        raise SystemExit(f"{name}: {found.reason}")
    return found


def drawn(way: str, values: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Draw a study's output (n,) from all realisations (n, k) and, where they are shared, the number of each."""
    generator, (count, realisations) = np.random.default_rng([seed, 7]), values.shape
    labels = None
    if way == "common":
        chosen = np.full(count, generator.integers(realisations))
    elif way == "own":
        chosen = generator.integers(realisations, size=count)
    else:
        labels = generator.permutation(np.arange(count) % SHARED)
        chosen = generator.choice(realisations, SHARED, replace=False)[labels]
    return values[np.arange(count), chosen], labels


def studies(name: str, way: str, units: np.ndarray, values: np.ndarray, count: int) -> Iterator[OutputFit]:
    """Draw studies of one way, of the designs in turn."""
    for number in range(count):
        design = number % DESIGNS
        output, labels = drawn(way, values[design], number)
        yield fitted(name, units[design], output, labels)


def show(name: str, units: np.ndarray, values: np.ndarray, count: int) -> None:
    """Print one output."""
    reference = fitted(name, np.concatenate(units), np.concatenate(values.mean(axis=2)))
    leading = np.argsort(-reference.indices.first)[:LEADING]
    exact = reference.indices.first[leading], reference.indices.total[leading]
    print(f"{name}: S1 {exact[0].round(3)}, R² of the means {reference.best.r2_cv:.3f}")
    for way in WAYS:
        fits = list(studies(name, way, units, values, count))
        errors = np.array([fit.indices.first[leading] - exact[0] for fit in fits])
        ends = np.array([[fit.indices.first_interval[leading], fit.indices.total_interval[leading]] for fit in fits])
        held = [(ends[:, k, :, 0] <= exact[k]) & (exact[k] <= ends[:, k, :, 1]) for k in range(2)]
        r2 = [fit.best.r2_cv for fit in fits]
        chance = "" if fits[0].chance is None else f", chance {np.mean([fit.chance.first for fit in fits]):.3f}"
        print(
            f"  {way:7s} error {np.sqrt(np.mean(errors**2, axis=0)).round(4)}, half-width "
            f"{np.mean(0.5 * (ends[:, 0, :, 1] - ends[:, 0, :, 0]), axis=0).round(3)}, held {np.mean(held[0]):.2f} "
            f"{np.mean(held[1]):.2f}, R² {min(r2):.3f} {np.mean(r2):.3f} {max(r2):.3f}{chance}",
            flush=True,
        )


def main() -> None:
    """Print all outputs."""
    path, count = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 10
    if not path.exists():
        make_bank(path)
    bank, inputs = np.load(path), default_inputs(load_machine("dz101"))
    units = np.stack([inputs.to_unit(design) for design in bank["designs"]])
    for k, name in enumerate(INDICATORS):
        show(name, units, bank["outputs"][..., k], count)


if __name__ == "__main__":
    main()
