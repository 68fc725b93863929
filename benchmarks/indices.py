"""Speed of Sobol indices, in one run of `python benchmarks/indices.py`.

Closed form of a surrogate of 200 points in 25 inputs; then the paper's 100 000 samples (base 2^17) of one support
vector regression, by scikit-learn and SALib used directly and by this package. Both are held against each other before
their times are printed: equal surrogates, equal designs, equal indices.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import TypeVar

import numpy as np
from SALib.analyze import sobol as analysis
from SALib.sample import sobol as sampling
from scipy.stats import qmc
from sklearn.svm import SVR

from tbm_gsa import fit_surrogate, sobol_closed_form, sobol_monte_carlo
from tbm_gsa.sensitivity.surrogates import SURROGATES, Surrogate
from tbm_gsa.sensitivity.surrogates.expansion import KernelExpansion

INPUTS, POINTS, SAMPLES, SEED = 25, 200, 2**17, 1
Result = TypeVar("Result")


def function(X: np.ndarray) -> np.ndarray:
    """Five of the inputs matter, two of them together."""
    return 1.0 / (0.5 + 1.5 * X[:, 15]) + 0.5 * np.sin(5.0 * X[:, 3]) + X[:, 1] * X[:, 20] + 0.3 * X[:, 7]


def timed(call: Callable[[], Result]) -> tuple[Result, float]:
    """Give what a call gives, and how long it took, s."""
    start = time.perf_counter()
    result = call()
    return result, time.perf_counter() - start


def directly(model: Surrogate) -> dict[str, np.ndarray]:
    """Find the same indices of the same surrogate by the libraries."""
    if not isinstance(model.expansion, KernelExpansion):
        raise SystemExit("a kernel surrogate is needed")
    weights = np.sqrt(model.expansion.theta)
    machine = SVR(gamma=1.0, C=model.settings["C"], epsilon=model.settings["epsilon"])
    machine.fit(model.samples.unit * weights, model.samples.standardised)
    problem = {"num_vars": INPUTS, "names": [f"x{k + 1}" for k in range(INPUTS)], "bounds": [[0.0, 1.0]] * INPUTS}
    points = sampling.sample(problem, SAMPLES, calc_second_order=False, scramble=True, seed=SEED)
    found: dict[str, np.ndarray] = analysis.analyze(
        problem, machine.predict(points * weights), calc_second_order=False, num_resamples=200, seed=SEED
    )
    return found


def main() -> None:
    """Run all."""
    X = qmc.LatinHypercube(INPUTS, seed=0).random(POINTS)
    models = {method: fit_surrogate(method, X, function(X), bounds=[[0.0, 1.0]] * INPUTS) for method in SURROGATES}
    print(f"| closed form, {POINTS} points, {INPUTS} inputs | best of 5, s |")
    print("| --- | --- |")
    for method, model in models.items():
        both, second = (
            min(timed(partial(sobol_closed_form, model, second=more))[1] for _ in range(5)) for more in (False, True)
        )
        print(f"| {method}, first and total (with second order) | {both:.3f} ({second:.3f}) |")
    model = models["svr"]
    theirs, slow = timed(partial(directly, model))
    ours, fast = timed(partial(sobol_monte_carlo, model.predict, model.bounds, samples=SAMPLES, seed=SEED))
    difference = max(np.abs(ours.first - theirs["S1"]).max(), np.abs(ours.total - theirs["ST"]).max())
    if difference > 1e-6:
        raise SystemExit(f"the indices differ by {difference:.2g}")
    print(f"\n| {SAMPLES} samples of {INPUTS} inputs, 200 bootstraps | s |")
    print("| --- | --- |")
    print(f"| scikit-learn's SVR and SALib, used directly | {slow:.1f} |")
    print(f"| this package | {fast:.1f} |")
    print(f"faster by {slow / fast:.1f}; the indices differ by {difference:.1g}")


if __name__ == "__main__":
    main()
