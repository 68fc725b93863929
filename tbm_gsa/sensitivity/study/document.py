"""The JSON document of a study; its keys are a contract with whoever reads it."""

from collections.abc import Mapping
from typing import Any

from tbm_gsa.provenance import package_versions
from tbm_gsa.sensitivity.sobol import PathIndices, SobolIndices
from tbm_gsa.sensitivity.study.analysis import Comparison, OutputAnalysis
from tbm_gsa.sensitivity.study.candidates import Candidate
from tbm_gsa.sensitivity.study.store import Store
from tbm_msgs_py.base.arrays import Array

# Interactions below this share of the variance are left out.
SMALLEST_INTERACTION = 1e-3


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
        total_interval, …}}``, ``seconds`` and the provenance of the numbers; all keys in ``docs/sensitivity.md``.
    """
    problem, counts = store.problem, store.counts()
    return {
        "outputs": {
            name: _output(analysis, problem.inputs.codes, tuple(problem.inputs.groups))
            for name, analysis in analyses.items()
        },
        "seconds": seconds,
        "campaign_seconds": campaign_seconds,
        "simulation_seconds": store.simulation_seconds(),
        "groups": {name: list(codes) for name, codes in problem.inputs.groups.items()},
        "inputs": {item["code"]: item for item in problem.inputs.to_list()},
        "samples": {"train": problem.train, "test": problem.test, "failed": counts.failed},
        "failures": [{"row": row, "reason": reason} for row, reason in store.failures()],
        "design": problem.design,
        "seed": problem.seed,
        "settings": dict(problem.settings),
        "indices": "closed form of the surrogate, sampled where its output was transformed; "
        "intervals: delete-a-group jackknife over the folds, 95 %",
        "versions": package_versions(),
    }


def _output(analysis: OutputAnalysis, codes: tuple[str, ...], groups: tuple[str, ...]) -> dict[str, Any]:
    """Gather the part of one output."""
    indices = analysis.indices
    return {
        "surrogate": analysis.chosen,
        **_scores(analysis.best),
        "r2_nested": analysis.nested_r2,
        "source": source(indices),
        **_indices(indices, codes),
        "second": _interactions(indices, codes),
        "groups": {} if analysis.groups is None else _indices(analysis.groups, groups),
        "paths": None if analysis.paths is None else _paths(analysis.paths, codes),
        **_comparison(analysis.comparison, codes),
        "scores": {method: _scores(candidate) for method, candidate in analysis.candidates.items()},
    }


def source(indices: SobolIndices) -> str:
    """Say how indices were found."""
    return f"sampling, {indices.evaluations} evaluations" if indices.evaluations else "closed form"


def _scores(candidate: Candidate) -> dict[str, Any]:
    """Quality of a surrogate; errors in the unit of the output."""
    return {
        "transform": candidate.transform,
        "r2_test": candidate.r2_test,
        "r2_cv": candidate.r2_cv,
        "rmse_test": candidate.rmse_test,
        "rmse_cv": candidate.validation.rmse,
        "largest_error_test": candidate.largest_error_test,
        "largest_error_cv": candidate.validation.largest_error,
    }


def _indices(indices: SobolIndices, codes: tuple[str, ...]) -> dict[str, Any]:
    """First and total indices with intervals."""
    return {
        "first": _by_code(codes, indices.first),
        "total": _by_code(codes, indices.total),
        "first_interval": _by_code(codes, indices.first_interval),
        "total_interval": _by_code(codes, indices.total_interval),
    }


def _interactions(indices: SobolIndices, codes: tuple[str, ...]) -> list[dict[str, Any]]:
    """Second-order indices with intervals, largest first."""
    second, interval = indices.second, indices.second_interval
    if second is None or interval is None:
        return []
    pairs = [(j, k) for j in range(len(codes)) for k in range(j) if second[j, k] >= SMALLEST_INTERACTION]
    return [
        {"inputs": [codes[k], codes[j]], "index": float(second[j, k]), "interval": interval[j, k].tolist()}
        for j, k in sorted(pairs, key=lambda pair: -second[pair])
    ]


def _paths(paths: PathIndices, codes: tuple[str, ...]) -> dict[str, Any]:
    """Gather indices over conditional Kriging paths, and what they scatter by."""
    return {
        "samples": paths.samples,
        "paths": paths.paths,
        "resamples": paths.resamples,
        **{
            name: {
                key: _by_code(codes, getattr(spread, key)) for key in ("mean", "interval", "metamodel", "monte_carlo")
            }
            for name, spread in (("first", paths.first), ("total", paths.total))
        },
    }


def _comparison(comparison: Comparison, codes: tuple[str, ...]) -> dict[str, Any]:
    """Gather what other ways of asking gave."""
    followed = tuple(codes[k] for k in comparison.places)
    morris = comparison.morris
    return {
        "by_surrogate": {
            method: {"source": source(indices), **_indices(indices, codes)}
            for method, indices in comparison.surrogates.items()
        },
        "convergence": [
            {"asked": list(step.asked), "samples": step.samples, **_indices(step.indices, followed)}
            for step in comparison.convergence
        ],
        "fast": _indices(comparison.fast, codes),
        "morris": {
            "mean": _by_code(codes, morris.mean),
            "mean_absolute": _by_code(codes, morris.mean_absolute),
            "mean_absolute_interval": _by_code(codes, morris.mean_absolute_interval),
            "deviation": _by_code(codes, morris.deviation),
        },
    }


def _by_code(codes: tuple[str, ...], values: Array | None) -> dict[str, Any]:
    """Rows of an array under the codes of the inputs."""
    return {} if values is None else dict(zip(codes, values.tolist(), strict=True))
