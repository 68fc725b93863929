"""The HTML page of a sensitivity study."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from tbm_gsa.app.report import gsa_comparison, gsa_figures
from tbm_gsa.app.report.page import embed_figure, render_page
from tbm_gsa.sensitivity.study.analysis import OutputAnalysis, strongest
from tbm_gsa.sensitivity.study.document import source
from tbm_gsa.sensitivity.study.inputs import InputSet

SHOWN: Final = 5
# Below the lowest R² the paper accepts (its Table 6, PAcc_A) the page says so.
POOR_R2: Final = 0.7


def gsa_page(document: Mapping[str, Any], analyses: Mapping[str, OutputAnalysis]) -> str:
    """Render a study.

    Parameters
    ----------
    document : mapping
        See `tbm_gsa.sensitivity.study.document.study_document`.
    analyses : mapping of str to OutputAnalysis

    Returns
    -------
    str
        A page that holds its figures and style.
    """
    inputs = InputSet.from_list(list(document["inputs"].values()))
    outputs = list(analyses.values())
    samples = document["samples"]
    planned = samples["train"] + samples["test"]
    context = {
        "title": "Global sensitivity of the driving system",
        "subtitle": f"{len(inputs)} inputs, {len(outputs)} outputs, "
        f"{samples['train']} training and {samples['test']} test points",
        "planned": planned,
        "failed": samples["failed"],
        "first_failure": document["failures"][0]["reason"] if document["failures"] else "",
        "poor": [analysis.name for analysis in outputs if analysis.best.r2_cv < POOR_R2],
        "poor_limit": POOR_R2,
        "ranks": range(1, min(SHOWN, len(inputs)) + 1),
        "rows": [_row(analysis, inputs) for analysis in outputs],
        "inputs": inputs.inputs,
        "groups": _groups(document),
        "group_names": list(document["groups"]),
        "convergence_rows": _convergence(outputs),
        "provenance": _provenance(document),
        **_figures(outputs, inputs),
    }
    return render_page("gsa.html", context)


def _row(analysis: OutputAnalysis, inputs: InputSet) -> dict[str, Any]:
    """One output in the table of strongest parameters."""
    total = analysis.indices.total
    places = strongest(analysis.indices, SHOWN)
    return {
        "name": analysis.name,
        "strongest": [
            {"code": item.code, "symbol": item.symbol, "name": item.name, "total": total[k]}
            for k, item in ((k, inputs.inputs[k]) for k in places)
        ],
        "sum": float(np.sum(analysis.indices.first)),
        "r2_cv": analysis.best.r2_cv,
        "r2_nested": analysis.nested_r2,
        "r2_test": analysis.best.r2_test,
        "rmse": analysis.best.validation.rmse,
        "largest": analysis.best.validation.largest_error,
        "surrogate": analysis.chosen + (" of log" if analysis.best.transform == "log" else ""),
        "source": source(analysis.indices),
    }


def _groups(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """First and total index of every group, a row an output."""
    return [
        {
            "name": name,
            "cells": [
                {
                    "first": output["groups"]["first"][group],
                    "first_interval": output["groups"]["first_interval"][group],
                    "total": output["groups"]["total"][group],
                }
                for group in document["groups"]
            ],
        }
        for name, output in document["outputs"].items()
        if document["groups"]
    ]


def _convergence(outputs: list[OutputAnalysis]) -> list[dict[str, Any]]:
    """Largest distance of sampled first and total indices from those the study reports, a row an output."""
    rows = []
    for analysis in outputs:
        places = list(analysis.comparison.places)
        cells = []
        for step in analysis.comparison.convergence:
            first = np.abs(step.indices.first - analysis.indices.first[places]).max()
            total = np.abs(step.indices.total - analysis.indices.total[places]).max()
            asked = ", ".join(f"{number:,}".replace(",", "\u202f") for number in step.asked)
            cells.append({"asked": asked, "samples": step.samples, "first": first, "total": total})
        rows.append({"name": analysis.name, "cells": cells})
    return rows


def _figures(outputs: list[OutputAnalysis], inputs: InputSet) -> dict[str, str]:
    """Draw the figures as image elements."""
    return {
        "bars": embed_figure(gsa_figures.index_bars(outputs, inputs), "Bars of the Sobol indices of every output"),
        "curves": embed_figure(gsa_figures.response_curves(outputs, inputs), "Response along the strongest inputs"),
        "scores": embed_figure(gsa_figures.score_bars(outputs), "Bars of R² by output and surrogate"),
        "designs": embed_figure(gsa_figures.design_points(outputs, inputs), "Training and test points"),
        "interactions": embed_figure(gsa_comparison.interaction_bars(outputs, inputs), "Bars of second-order indices"),
        "convergence": embed_figure(gsa_comparison.convergence(outputs, inputs), "First indices over the base size"),
        "split": embed_figure(
            gsa_comparison.uncertainty_split(outputs, inputs), "Bars of metamodel and sampling error"
        ),
        "methods": embed_figure(gsa_comparison.method_comparison(outputs, inputs), "First indices by other methods"),
        "morris": embed_figure(
            gsa_comparison.morris_scatter(outputs, inputs), "Elementary effects, mean and deviation"
        ),
        "predictions": embed_figure(gsa_figures.prediction_scatter(outputs), "Simulated against predicted values"),
    }


def _provenance(document: Mapping[str, Any]) -> dict[str, object]:
    """Where the numbers come from, as rows of a table."""
    versions = ", ".join(f"{name} {number}" for name, number in document["versions"].items())
    times = (
        f"{document['seconds']:.1f} s in all, {document['campaign_seconds']:.1f} s of it campaign; "
        f"{document['simulation_seconds']:.1f} s of processor time in simulations"
    )
    return {
        **document["settings"],
        "design": f"{document['design']}, seed {document['seed']}",
        "indices": document["indices"],
        "time": times,
        "versions": versions,
    }
