"""The JSON document of a study; its keys are a contract with whoever reads it."""

import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from tbm_gsa.arrays import Array
from tbm_gsa.study.analysis import OutputAnalysis
from tbm_gsa.study.store import Store

PACKAGES = ("tbm_monitor", "numpy", "scipy", "scikit-learn", "SALib")


def study_document(
    store: Store, analyses: Mapping[str, OutputAnalysis], *, seconds: float, campaign_seconds: float
) -> dict[str, Any]:
    """Gather the results of a study.

    Parameters
    ----------
    store : Store
        Finished.
    analyses : mapping of str to OutputAnalysis
    seconds : float
        Wall time of this run, campaign and analysis, s; `campaign_seconds` of it for the campaign.

    Returns
    -------
    dict
        ``outputs{name: {surrogate, r2_test, r2_cv, first{code}, total{code}, first_interval{code: [low, high]},
        total_interval, scores{method: {r2_cv, r2_test}}}}``, ``seconds`` and the provenance of the numbers.
    """
    problem, counts = store.problem, store.counts()
    return {
        "outputs": {name: _output(analysis, problem.inputs.codes) for name, analysis in analyses.items()},
        "seconds": seconds,
        "campaign_seconds": campaign_seconds,
        "simulation_seconds": store.simulation_seconds(),
        "inputs": {item["code"]: item for item in problem.inputs.to_list()},
        "samples": {"train": problem.train, "test": problem.test, "failed": counts.failed},
        "failures": [{"row": row, "reason": reason} for row, reason in store.failures()],
        "seed": problem.seed,
        "settings": dict(problem.settings),
        "indices": "closed form of the surrogate; intervals: delete-a-group jackknife over the folds, 95 %",
        "versions": package_versions(),
    }


def _output(analysis: OutputAnalysis, codes: tuple[str, ...]) -> dict[str, Any]:
    """Gather the part of one output."""
    indices = analysis.indices
    return {
        "surrogate": analysis.chosen,
        "r2_test": analysis.best.r2_test,
        "r2_cv": analysis.best.r2_cv,
        "first": _by_code(codes, indices.first),
        "total": _by_code(codes, indices.total),
        "first_interval": _by_code(codes, indices.first_interval),
        "total_interval": _by_code(codes, indices.total_interval),
        "scores": {
            method: {"r2_cv": candidate.r2_cv, "r2_test": candidate.r2_test}
            for method, candidate in analysis.candidates.items()
        },
    }


def _by_code(codes: tuple[str, ...], values: Array | None) -> dict[str, Any]:
    """Rows of an array under the codes of the inputs."""
    return {} if values is None else dict(zip(codes, values.tolist(), strict=True))


def package_versions() -> dict[str, str]:
    """Versions of Python and of what the numbers come from; packages that are not installed are left out."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # run from the source tree
            continue
    return found
