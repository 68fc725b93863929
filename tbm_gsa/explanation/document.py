"""The JSON document of an explanation; its keys are a contract, docs/sensitivity.md lists them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tbm_gsa.explanation.causes import Cause, Misfit
from tbm_gsa.explanation.joint import JointPosterior
from tbm_gsa.explanation.observed import Observed
from tbm_gsa.explanation.shifts import Shifts
from tbm_gsa.explanation.verdict import explains
from tbm_gsa.provenance import package_versions
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_msgs_py.base.arrays import Array


@dataclass(frozen=True, eq=False)
class Explained:
    """Everything an explanation found.

    Attributes
    ----------
    facts : Observed
    inputs : InputSet
    nominal : ndarray, shape (d,)
        Where the machine stands in the unit cube.
    shifts : Shifts
    misfit : Misfit
    causes : tuple of Cause
        The most probable first.
    joint : JointPosterior
    predicted : ndarray, shape (k,)
        Shifts of the logarithms at the median of the first cause that is an input, by the surrogates.
    checked : ndarray, shape (k,)
        Statistics that the model itself gives there, m/s².
    """

    facts: Observed
    inputs: InputSet
    nominal: Array
    shifts: Shifts
    misfit: Misfit
    causes: tuple[Cause, ...]
    joint: JointPosterior
    predicted: Array
    checked: Array


def explanation_document(
    comparison: Mapping[str, Any], found: Explained, settings: Mapping[str, Any], seconds: float
) -> dict[str, Any]:
    """Gather an explanation: what JSON can hold."""
    recording = comparison["recording"]
    logs, standardised = _misfits(found)
    after = "model" if found.causes[0].place < 0 else "checked"
    return {
        "recording": {"path": recording["path"], "sha256": recording["sha256"]},
        "machine": comparison["machine"],
        "machine_file": comparison["machine_file"],
        "operating_point": comparison["operating_point"],
        "causes": [_cause(cause, found) for cause in found.causes],
        "joint": _joint(found),
        "statistics": [_statistic(place, found) for place in range(len(found.facts.statistics))],
        "misfit": logs,
        "standardised_misfit": standardised,
        "explained": explains(standardised[after]),
        "settings": dict(settings),
        "seconds": seconds,
        "versions": package_versions(),
    }


def _at(found: Explained, place: int, unit: float) -> float:
    return float(found.inputs.inputs[place].distribution.from_unit(np.array([unit]))[0])


def _cause(cause: Cause, found: Explained) -> dict[str, Any]:
    row: dict[str, Any] = {"probability": cause.probability, "log_evidence": cause.log_evidence}
    if cause.place < 0:
        return {"input": None, "name": "nothing has changed", **row}
    item = found.inputs.inputs[cause.place]
    value, low, high = (_at(found, cause.place, float(place)) for place in cause.quantiles)
    texts = {"input": item.code, "name": item.name, "symbol": item.symbol, "unit": item.unit, "kind": item.kind}
    return {**texts, **row, "value": value, "interval": [low, high], "machine_value": item.initial}


def _joint(found: Explained) -> dict[str, Any]:
    low, middle, high = np.quantile(found.joint.samples, (0.05, 0.5, 0.95), axis=0)
    inputs = {
        item.code: {
            "value": _at(found, place, float(middle[place])),
            "interval": [_at(found, place, float(low[place])), _at(found, place, float(high[place]))],
            "machine_value": item.initial,
            "learnt": float(1.0 - (high[place] - low[place]) / 0.9),
            "lower": item.lower,
            "upper": item.upper,
            "distribution": item.distribution.name,
        }
        for place, item in enumerate(found.inputs.inputs)
    }
    left = found.misfit.observed - found.shifts(found.joint.best[None])[0]
    return {
        "inputs": inputs,
        "accepted": found.joint.accepted,
        "effective_samples": found.joint.effective,
        "standardised_misfit": _standardised(left, found.misfit),
    }


def _statistic(place: int, found: Explained) -> dict[str, Any]:
    fact = found.facts.statistics[place]
    return {
        "name": fact.name,
        "field": fact.field,
        "model": fact.model,
        "predicted": float(fact.model * np.exp(found.predicted[place])),
        "checked": float(found.checked[place]),
        "deviation": float(np.sqrt(found.misfit.covariance[place, place])),
        "r2_cv": float(found.shifts.r2[place]),
    }


def _misfits(found: Explained) -> tuple[dict[str, float], dict[str, float]]:
    """Root mean square of the logarithm of field over model: compared, predicted, checked; the same in deviations."""
    logs = found.misfit.observed
    models = np.array([fact.model for fact in found.facts.statistics])
    after = {"model": logs, "predicted": logs - found.predicted, "checked": logs - np.log(found.checked / models)}
    return (
        {name: float(np.sqrt(np.mean(left**2))) for name, left in after.items()},
        {name: _standardised(left, found.misfit) for name, left in after.items()},
    )


def _standardised(left: Array, misfit: Misfit) -> float:
    return float(np.sqrt(np.mean(left**2 / np.diag(misfit.covariance))))
