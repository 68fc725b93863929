"""The HTML page of a sensitivity study."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from tbm_gsa.report import gsa_figures
from tbm_gsa.report.page import embed_figure, render_page
from tbm_gsa.study.analysis import OutputAnalysis, strongest
from tbm_gsa.study.inputs import InputSet

SHOWN: Final = 5
# Below the lowest R² the paper accepts (its Table 6, PAcc_A) the page says so.
POOR_R2: Final = 0.7


def gsa_page(document: Mapping[str, Any], analyses: Mapping[str, OutputAnalysis]) -> str:
    """Render a study.

    Parameters
    ----------
    document : mapping
        See `tbm_gsa.study.document.study_document`.
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
        f"Latin hypercubes of {samples['train']} training and {samples['test']} test points",
        "planned": planned,
        "failed": samples["failed"],
        "first_failure": document["failures"][0]["reason"] if document["failures"] else "",
        "poor": [analysis.name for analysis in outputs if analysis.best.r2_cv < POOR_R2],
        "poor_limit": POOR_R2,
        "ranks": range(1, min(SHOWN, len(inputs)) + 1),
        "rows": [_row(analysis, inputs) for analysis in outputs],
        "inputs": inputs.inputs,
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
        "r2_test": analysis.best.r2_test,
        "surrogate": analysis.chosen,
    }


def _figures(outputs: list[OutputAnalysis], inputs: InputSet) -> dict[str, str]:
    """Draw the figures as image elements."""
    return {
        "bars": embed_figure(gsa_figures.index_bars(outputs, inputs), "Bars of the Sobol indices of every output"),
        "curves": embed_figure(gsa_figures.response_curves(outputs, inputs), "Response along the strongest inputs"),
        "scores": embed_figure(gsa_figures.score_bars(outputs), "Bars of R² by output and surrogate"),
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
        "design seed": document["seed"],
        "indices": document["indices"],
        "time": times,
        "versions": versions,
    }
