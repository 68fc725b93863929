"""The page of an explanation: its document → one HTML file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tbm_gsa.explanation.verdict import verdict
from tbm_gsa.report.page import embed_figure, render_page
from tbm_gsa.study.distributions import LogUniform, distribution_from
from tbm_gsa.study.inputs import PAPER_INPUTS
from tbm_msgs_py.files import write_whole

BEFORE, AFTER, RANGE = "#D55E00", "#0072B2", "#d8dee6"


def write_explanation_page(document: Mapping[str, Any], path: Path) -> None:
    """Write the page of an explanation."""
    write_whole(path, explanation_page(document).encode())


def explanation_page(document: Mapping[str, Any]) -> str:
    """Render the page of an explanation; everything in it is escaped."""
    context = {
        "title": "What explains the recording",
        "subtitle": f"{document['recording']['path']} against {document['machine']}",
        "causes": document["causes"],
        "statistics": len(document["statistics"]),
        "model_error": document["settings"]["model_error"],
        "off": {name: math.exp(value) for name, value in document["misfit"].items()},
        "explained": document["explained"],
        "verdict": verdict(document),
        "before_after": embed_figure(before_after(document), "Field over model before and after, every statistic"),
        "joint": embed_figure(joint_intervals(document), "Intervals of all inputs"),
        "provenance": _provenance(document),
    }
    return render_page("explanation.html", context)


def before_after(document: Mapping[str, Any]) -> Figure:
    """Field over model of every statistic, as compared and after the first cause, with what may be expected."""
    rows = document["statistics"]
    figure = Figure(figsize=(12.0, 1.0 + 0.16 * len(rows)), layout="constrained")
    panel: Axes = figure.subplots()
    place = np.arange(len(rows), dtype=np.float64)
    deviation = np.array([row["deviation"] for row in rows])
    panel.barh(place, 4.0 * deviation, left=-2.0 * deviation, height=0.8, color=RANGE, label="±2 standard deviations")
    for key, colour, label in (("model", BEFORE, "as compared"), ("checked", AFTER, "first cause, run of the model")):
        ratio = np.log([row["field"] / row[key] for row in rows])
        panel.plot(ratio, place, "o", color=colour, markersize=4, label=label)
    panel.axvline(0.0, color="#555555", linewidth=0.8)
    panel.set_yticks(place, [row["name"] for row in rows], fontsize=7)
    panel.invert_yaxis()
    panel.margins(y=0.01)
    panel.set_xlabel("logarithm of field over model")
    panel.legend(frameon=False, loc="lower right", fontsize=8)
    return figure


def joint_intervals(document: Mapping[str, Any]) -> Figure:
    """90 % intervals of all inputs over the ranges that were searched, each in the space of its distribution."""
    inputs = document["joint"]["inputs"]
    figure = Figure(figsize=(12.0, 0.8 + 0.24 * len(inputs)), layout="constrained")
    panel: Axes = figure.subplots()
    for place, row in enumerate(inputs.values()):
        law = distribution_from({key: row[key] for key in ("distribution", "lower", "upper")})
        (begin, end), own = law.to_unit(row["interval"]), float(law.to_unit(row["machine_value"]))
        panel.barh(place, 1.0, height=0.75, color=RANGE)
        panel.barh(place, end - begin, left=begin, height=0.45, color=AFTER)
        panel.plot([own, own], [place - 0.38, place + 0.38], color=BEFORE, linewidth=1.5)
    panel.set_yticks(range(len(inputs)), [_range_label(code, row) for code, row in inputs.items()], fontsize=8)
    panel.invert_yaxis()
    panel.set_xlim(0.0, 1.0)
    panel.set_xlabel("share of the range searched, from lower to upper bound (log: of its logarithm)")
    return figure


def _range_label(code: str, row: Mapping[str, Any]) -> str:
    log = ", log" if row["distribution"] == LogUniform.name else ""
    item = PAPER_INPUTS[code]
    return f"{code} {item.symbol}: {row['lower']:.3g} to {row['upper']:.3g} {item.unit}".rstrip() + log


def _provenance(document: Mapping[str, Any]) -> dict[str, object]:
    chosen = document["settings"]
    return {
        "recording": f"{document['recording']['path']}, sha256 {document['recording']['sha256']}",
        "machine": f"{document['machine_file']['origin']}, sha256 {document['machine_file']['sha256']}",
        "operating point": ", ".join(f"{key} {value}" for key, value in document["operating_point"].items()),
        "campaign": f"{chosen['samples']} runs of {chosen['duration']:g} s, {chosen['seeds']} with other loads, "
        f"seed {chosen['seed']}",
        "joint posterior": f"{document['joint']['effective_samples']:.0f} effective samples, "
        f"{document['joint']['accepted']:.0%} of the steps accepted",
        "versions": ", ".join(f"{name} {number}" for name, number in document["versions"].items()),
    }
