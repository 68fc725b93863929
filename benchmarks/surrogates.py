"""Surrogates against those of other libraries on equal points: `python benchmarks/surrogates.py [STUDY …]`.

Ten public test functions (S. Surjanovic, D. Bingham, Virtual Library of Simulation Experiments) from 100 points of a
Latin hypercube, judged on 2 000 others; and, where folders of finished studies are named, their outputs, judged on
their test points. Each library as its documentation starts with it: Kriging with one rate per input of scikit-learn and
SMT, Kriging and sparse polynomial chaos of OpenTURNS (if it is installed). `stacked` is the combination of our four
with weights that are not negative, by their predictions of held-out samples [1]_.

References
----------
.. [1] L. Breiman, "Stacked regressions", Machine Learning 24 (1996) 49–64.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.optimize import nnls
from scipy.stats import qmc
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.metrics import r2_score
from smt.surrogate_models import KRG

from tbm_gsa.sensitivity.study.candidates import Data, best_of, fit_candidates
from tbm_gsa.sensitivity.study.store import STORE_NAME, Store
from tbm_gsa.sensitivity.surrogates import SURROGATES
from tbm_gsa.sensitivity.surrogates.likelihood import _maximum_likelihood

try:
    import openturns
except ImportError:
    openturns = None

POINTS, JUDGES, SEEDS = 100, 2000, 2
Array = np.ndarray


def otl_circuit(x: Array) -> Array:
    """Mid-point voltage of a push-pull circuit."""
    b1, b2, f, c1, c2, beta = x.T
    vb1 = 12.0 * b2 / (b1 + b2)
    load = beta * (c2 + 9.0)
    return (vb1 + 0.74) * load / (load + f) + 11.35 * f / (load + f) + 0.74 * f * load / ((load + f) * c1)


def piston(x: Array) -> Array:
    """Cycle time of a piston."""
    mass, area, volume, spring, pressure, ambient, gas = x.T
    a = pressure * area + 19.62 * mass - spring * volume / area
    v = area / (2.0 * spring) * (np.sqrt(a**2 + 4.0 * spring * pressure * volume / gas * ambient) - a)
    return 2.0 * np.pi * np.sqrt(mass / (spring + area**2 * pressure * volume / gas * ambient / v**2))


def wing_weight(x: Array) -> Array:
    """Weight of a light aircraft's wing."""
    s, fuel, aspect, sweep, q, taper, thickness, load, dg, paint = x.T
    angle = np.radians(sweep)
    return (
        0.036 * s**0.758 * fuel**0.0035 * (aspect / np.cos(angle) ** 2) ** 0.6 * q**0.006 * taper**0.04
        * (100.0 * thickness / np.cos(angle)) ** -0.3 * (load * dg) ** 0.49 + s * paint
    )  # fmt: skip


def robot_arm(x: Array) -> Array:
    """Reach of an arm of four members."""
    angles, lengths = np.cumsum(x[:, :4], axis=1), x[:, 4:]
    return np.hypot((lengths * np.cos(angles)).sum(axis=1), (lengths * np.sin(angles)).sum(axis=1))


def borehole(x: Array) -> Array:
    """Flow through a borehole."""
    rw, r, tu, hu, tl, hl, length, k = x.T
    log = np.log(r / rw)
    return 2.0 * np.pi * tu * (hu - hl) / (log * (1.0 + 2.0 * length * tu / (log * rw**2 * k) + tu / tl))


def welch(x: Array) -> Array:
    """Twenty inputs, some without influence (Welch et al., 1992)."""
    return (
        5.0 * x[:, 11] / (1.0 + x[:, 0]) + 5.0 * (x[:, 3] - x[:, 19]) ** 2 + x[:, 4] + 40.0 * x[:, 18] ** 3
        - 5.0 * x[:, 18] + 0.05 * x[:, 1] + 0.08 * x[:, 2] - 0.03 * x[:, 5] + 0.03 * x[:, 6] - 0.09 * x[:, 8]
        - 0.01 * x[:, 9] - 0.07 * x[:, 10] + 0.25 * x[:, 12] ** 2 - 0.04 * x[:, 13] + 0.06 * x[:, 14]
        - 0.01 * x[:, 16] - 0.03 * x[:, 17]
    )  # fmt: skip


def friedman(x: Array) -> Array:
    """Five of ten inputs matter (Friedman, 1991)."""
    return 10.0 * np.sin(np.pi * x[:, 0] * x[:, 1]) + 20.0 * (x[:, 2] - 0.5) ** 2 + 10.0 * x[:, 3] + 5.0 * x[:, 4]


def ishigami(x: Array) -> Array:
    """Three inputs, one of them in an interaction alone."""
    return np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def g_function(x: Array) -> Array:
    """Kinks in the middle of every input (Sobol')."""
    a = np.array([0.0, 1.0, 4.5, 9.0, 99.0, 99.0, 99.0, 99.0])
    return np.prod((np.abs(4.0 * x - 2.0) + a) / (1.0 + a), axis=1)


def dette(x: Array) -> Array:
    """Highly curved, eight inputs (Dette and Pepelyshev, 2010)."""
    found = 4.0 * (x[:, 0] - 2.0 + 8.0 * x[:, 1] - 8.0 * x[:, 1] ** 2) ** 2 + (3.0 - 4.0 * x[:, 1]) ** 2
    found += 16.0 * np.sqrt(x[:, 2] + 1.0) * (2.0 * x[:, 2] - 1.0) ** 2
    for i in range(4, 9):
        found += i * np.log1p(x[:, 2:i].sum(axis=1))
    return found


UNIT = (0.0, 1.0)
FUNCTIONS: dict[str, tuple[Callable[[Array], Array], list[tuple[float, float]]]] = {
    "ishigami": (ishigami, [(-np.pi, np.pi)] * 3),
    "otl circuit": (otl_circuit, [(50, 150), (25, 70), (0.5, 3), (1.2, 2.5), (0.25, 1.2), (50, 300)]),
    "piston": (
        piston,
        [(30, 60), (0.005, 0.02), (0.002, 0.01), (1e3, 5e3), (9e4, 1.1e5), (290, 296), (340, 360)],
    ),
    "borehole": (
        borehole,
        [(0.05, 0.15), (100, 5e4), (63070, 115600), (990, 1110), (63.1, 116), (700, 820), (1120, 1680), (9855, 12045)],
    ),
    "robot arm": (robot_arm, [(0.0, 2.0 * np.pi)] * 4 + [UNIT] * 4),
    "g": (g_function, [UNIT] * 8),
    "dette": (dette, [UNIT] * 8),
    "wing weight": (
        wing_weight,
        [(150, 200), (220, 300), (6, 10), (-10, 10), (16, 45), (0.5, 1), (0.08, 0.18), (2.5, 6), (1700, 2500),
         (0.025, 0.08)],
    ),
    "friedman": (friedman, [UNIT] * 10),
    "welch": (welch, [(-0.5, 0.5)] * 20),
}  # fmt: skip
Predict = Callable[[Array, Array, Array], Array]


def by_scikit_learn(unit: Array, values: Array, points: Array) -> Array:
    """Predict by Kriging of scikit-learn."""
    kernel = ConstantKernel() * RBF([1.0] * unit.shape[1], (1e-2, 1e2)) + WhiteKernel(1e-3, (1e-8, 1.0))
    model = GaussianProcessRegressor(kernel, normalize_y=True, n_restarts_optimizer=1, random_state=0)
    return model.fit(unit, values).predict(points)


def by_smt(unit: Array, values: Array, points: Array) -> Array:
    """Predict by Kriging of SMT."""
    model = KRG(print_global=False)
    model.set_training_values(unit, values)
    model.train()
    return model.predict_values(points)[:, 0]


def by_openturns_kriging(unit: Array, values: Array, points: Array) -> Array:
    """Predict by Kriging of OpenTURNS."""
    dimension = unit.shape[1]
    basis, kernel = openturns.ConstantBasisFactory(dimension).build(), openturns.SquaredExponential([0.5] * dimension)
    fitter = openturns.GaussianProcessFitter(unit, values[:, None], kernel, basis)
    fitter.run()
    regression = openturns.GaussianProcessRegression(fitter.getResult())
    regression.run()
    return np.asarray(regression.getResult().getMetaModel()(points))[:, 0]


def by_openturns_chaos(unit: Array, values: Array, points: Array) -> Array:
    """Predict by sparse polynomial chaos of OpenTURNS."""
    law = openturns.JointDistribution([openturns.Uniform(0.0, 1.0)] * unit.shape[1])
    chaos = openturns.FunctionalChaosAlgorithm(unit, values[:, None], law)
    chaos.run()
    return np.asarray(chaos.getResult().getMetaModel()(points))[:, 0]


OTHERS: dict[str, Predict] = {"sklearn krg": by_scikit_learn, "smt krg": by_smt}
if openturns is not None:
    OTHERS |= {"openturns krg": by_openturns_kriging, "openturns pce": by_openturns_chaos}


def ours(data: Data) -> dict[str, tuple[float, float]]:
    """Find R² on the test points and seconds, of each method, of the one that a study chooses, and of all stacked."""
    start = time.perf_counter()
    candidates = fit_candidates(tuple(SURROGATES), data, 0)
    whole = time.perf_counter() - start
    held_out = np.stack([candidate.validation.predicted for candidate in candidates], axis=1)
    weights = nnls(held_out, candidates[0].validation.actual)[0]
    stacked = np.stack([candidate.test_predicted for candidate in candidates], axis=1) @ weights
    found = {}
    for candidate in candidates:
        if candidate.transform == "none":
            start = time.perf_counter()
            _maximum_likelihood.cache_clear()  # the others have it already
            SURROGATES[candidate.model.method].fit(candidate.model.samples)
            found[candidate.model.method] = candidate.r2_test, time.perf_counter() - start
    found["chosen"] = best_of(candidates).r2_test, whole
    found["stacked"] = float(r2_score(data.test_values, stacked)), whole
    return found


def theirs(data: Data) -> dict[str, tuple[float, float]]:
    """Find R² on the test points and seconds, of the other libraries; one that fails has no number."""
    found = {}
    for name, predict in OTHERS.items():
        start = time.perf_counter()
        try:
            predicted = predict(data.unit, data.values, data.test_unit)
            found[name] = float(r2_score(data.test_values, predicted)), time.perf_counter() - start
        except Exception as error:  # noqa: BLE001 - of another library
            print(f"  {name}: {type(error).__name__}: {str(error).splitlines()[0][:100]}")
            found[name] = float("nan"), time.perf_counter() - start
    return found


def of_function(name: str, seed: int) -> Data:
    """Sample a test function."""
    function, bounds = FUNCTIONS[name]
    low, high = np.array(bounds, dtype=float).T
    sets = [qmc.LatinHypercube(len(low), seed=np.random.default_rng([seed, n])).random(n) for n in (POINTS, JUDGES)]
    train, test = (low + unit * (high - low) for unit in sets)
    return Data(sets[0], function(train), sets[1], function(test))


def of_study(folder: Path) -> dict[str, Data]:
    """Read the outputs of a finished study."""
    with Store.open(folder / STORE_NAME) as store:
        inputs = store.problem.inputs
        (X, Y), (X_test, Y_test) = store.results("train"), store.results("test")
        return {
            name: Data(inputs.to_unit(X), Y[:, k], inputs.to_unit(X_test), Y_test[:, k])
            for k, name in enumerate(store.problem.outputs)
        }


def show(name: str, found: dict[str, tuple[float, float]]) -> None:
    """Print one line of R²."""
    print(f"{name:14s}" + "".join(f"{r2:14.4f}" for r2, _ in found.values()), flush=True)


def main() -> None:
    """Print R² by function and library, and how long each took beside the slowest of ours."""
    warnings.filterwarnings("ignore")
    if openturns is not None:
        openturns.Log.Show(openturns.Log.NONE)
    seconds: dict[str, float] = {}
    for number, name in enumerate(FUNCTIONS):
        runs = [ours(data) | theirs(data) for data in (of_function(name, seed) for seed in range(SEEDS))]
        if not number:
            print(" " * 14 + "".join(f"{key:>14s}" for key in runs[0]))
        show(name, {key: (float(np.mean([run[key][0] for run in runs])), 0.0) for key in runs[0]})
        for run in runs:
            for key, (_, took) in run.items():
                seconds[key] = seconds.get(key, 0.0) + took
    print("seconds a fit " + "".join(f"{took / SEEDS / len(FUNCTIONS):14.3f}" for took in seconds.values()))
    for folder in map(Path, sys.argv[1:]):
        for name, data in of_study(folder).items():
            show(name, ours(data) | theirs(data))


if __name__ == "__main__":
    main()
