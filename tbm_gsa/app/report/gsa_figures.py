"""Figures of the sensitivity page: analyses → matplotlib figures."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from tbm_gsa.sensitivity.study.analysis import OutputFit
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_msgs_py.base.arrays import Array

# Colours of Okabe and Ito, told apart by colour-blind readers too.
PALETTE: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
FIRST: Final = "#1f5f99"
TOTAL: Final = "#b9d3ea"
COLUMNS: Final = 2


def index_bars(analyses: Sequence[OutputFit], inputs: InputSet) -> Figure:
    """First and total indices of all inputs with intervals, one panel per output."""
    figure, panels = make_panels(len(analyses), height=2.6)
    place = np.arange(len(inputs), dtype=float)
    for panel, analysis in zip(panels, analyses, strict=True):
        indices = analysis.indices
        for side, values, interval, colour, label in (
            (-0.2, indices.first, indices.first_interval, FIRST, "first"),
            (0.2, indices.total, indices.total_interval, TOTAL, "total"),
        ):
            panel.bar(place + side, values, 0.4, color=colour, label=label)
            if interval is not None:
                whiskers(panel, place + side, values, interval)
        panel.set_title(analysis.name, loc="left")
        panel.set_xticks(place, inputs.codes, rotation=90)
        panel.set_xlim(-0.7, len(inputs) - 0.3)
        tops = indices.total if indices.total_interval is None else indices.total_interval[:, 1]
        panel.set_ylim(0.0, max(0.1, 1.05 * float(tops.max())))
        panel.set_ylabel("index")
    panels[0].legend(loc="upper right", frameon=False)
    return figure


def whiskers(panel: Axes, place: Array, values: Array, interval: Array) -> None:
    """Intervals (d, 2) around values (d,)."""
    reach = np.maximum(np.abs(interval.T - values), 0.0)
    panel.errorbar(place, values, yerr=reach, fmt="none", ecolor="#333333", elinewidth=0.8, capsize=1.5)


def response_curves(analyses: Sequence[OutputFit], inputs: InputSet) -> Figure:
    """Mean response along the strongest inputs, one panel per output."""
    figure, panels = make_panels(len(analyses), height=2.6)
    for panel, analysis in zip(panels, analyses, strict=True):
        for curve, colour in zip(analysis.curves, PALETTE, strict=False):
            item = inputs[curve.code]
            share = (curve.values - item.lower) / (item.upper - item.lower)
            panel.plot(share, curve.response, color=colour, label=f"{item.code} {item.symbol}")
        panel.set_title(analysis.name, loc="left")
        panel.set_xlabel("place in the input's range, lower (0) to upper (1) bound")
        panel.margins(x=0.0)
        panel.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def design_points(analyses: Sequence[OutputFit], inputs: InputSet) -> Figure:
    """Training and test points over the strongest input of every output."""
    figure, panels = make_panels(len(analyses), columns=4, height=2.8)
    for panel, analysis in zip(panels, analyses, strict=True):
        curve, best = analysis.curves[0], analysis.best
        k = inputs.codes.index(curve.code)
        item = inputs.inputs[k]
        values = item.distribution.from_unit(best.model.samples.X[:, k])
        panel.scatter(values, best.model.samples.y, s=9, color=PALETTE[0], alpha=0.5, label="training")
        tested = item.distribution.from_unit(best.test_unit[:, k])
        panel.scatter(tested, best.test_actual, s=16, color=PALETTE[1], marker="D", label="test")
        panel.set_title(analysis.name, loc="left")
        panel.set_xlabel(f"{item.code} {item.symbol}" + (f" ({item.unit})" if item.unit else ""))
        panel.locator_params(nbins=4)
        panel.ticklabel_format(scilimits=(-3, 4))
    panels[0].legend(frameon=False, fontsize=8)
    return figure


def prediction_scatter(analyses: Sequence[OutputFit]) -> Figure:
    """Scatter simulated against predicted values, one panel per output."""
    figure, panels = make_panels(len(analyses), columns=4, height=2.8)
    for panel, analysis in zip(panels, analyses, strict=True):
        validation = analysis.best.validation
        panel.scatter(validation.actual, validation.predicted, s=9, color=PALETTE[0], alpha=0.5, label="held out")
        panel.scatter(
            analysis.best.test_actual, analysis.best.test_predicted, s=16, color=PALETTE[1], marker="D", label="test"
        )
        panel.axline((validation.actual.mean(),) * 2, slope=1.0, color="#333333", linewidth=0.8)
        panel.set_title(analysis.name, loc="left")
        panel.set_xlabel("simulated")
        panel.set_ylabel("predicted")
        panel.locator_params(nbins=4)
        panel.ticklabel_format(scilimits=(-3, 4))
    panels[0].legend(frameon=False, fontsize=8)
    return figure


def score_bars(analyses: Sequence[OutputFit]) -> Figure:
    """R² of cross validation and on test points of every method, grouped by output."""
    figure = Figure(figsize=(12.0, 2.8), layout="constrained")
    panel = figure.add_subplot()
    series = [(method, kind) for method in analyses[0].candidates for kind in ("cross validation", "test")]
    width = 0.8 / len(series)
    place = np.arange(len(analyses))
    for rank, (method, kind) in enumerate(series):
        candidates = [analysis.candidates[method] for analysis in analyses]
        scores = [item.r2_cv if kind == "cross validation" else item.r2_test for item in candidates]
        shown = [np.nan if score is None else max(score, 0.0) for score in scores]
        colour = to_rgba(PALETTE[rank // 2], 0.55 if kind == "test" else 1.0)
        centre = place + (rank - 0.5 * (len(series) - 1)) * width
        panel.bar(centre, shown, width, label=f"{method}, {kind}", color=colour)
    panel.set_xticks(place, [analysis.name for analysis in analyses])
    panel.set_ylim(0.0, 1.0)
    panel.set_ylabel("R²")
    panel.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    _tidy(panel)
    return figure


def make_panels(count: int, *, height: float, columns: int = COLUMNS) -> tuple[Figure, list[Axes]]:
    """Make a figure with `count` panels in rows, each `height` inches high."""
    rows = -(-count // columns)
    figure = Figure(figsize=(12.0, height * rows), layout="constrained")
    panels = [figure.add_subplot(rows, columns, 1 + k) for k in range(count)]
    for panel in panels:
        _tidy(panel)
    return figure, panels


def _tidy(panel: Axes) -> None:
    """Quiet axes: no box, faint horizontal lines."""
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(axis="y", color="#e3e7ec", linewidth=0.8)
    panel.set_axisbelow(True)
