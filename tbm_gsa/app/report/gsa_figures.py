"""Figures of the sensitivity page: analyses → matplotlib figures. S1, ST, S2: first-order, total, second-order."""

from collections.abc import Sequence
from typing import Final, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from tbm_gsa.sensitivity.study.analysis import OutputAnalysis, OutputFit, strongest
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_msgs_py.base.arrays import Array

# Colours of Okabe and Ito, told apart by colour-blind readers too.
PALETTE: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
FIRST: Final = "#1f5f99"
TOTAL: Final = "#b9d3ea"
COLUMNS: Final = 2
SHOWN_PAIRS: Final = 6

Fit = TypeVar("Fit", bound=OutputFit)


def index_bars(analyses: Sequence[OutputFit], inputs: InputSet) -> Figure:
    """First and total indices of all inputs with intervals, one panel per output."""
    figure, panels = _panels(analyses, height=2.6)
    place = np.arange(len(inputs), dtype=float)
    for panel, analysis in panels:
        indices = analysis.indices
        for side, values, interval, colour, label in (
            (-0.2, indices.first, indices.first_interval, FIRST, "S1"),
            (0.2, indices.total, indices.total_interval, TOTAL, "ST"),
        ):
            panel.bar(place + side, values, 0.4, color=colour, label=label)
            if interval is not None:
                whiskers(panel, place + side, values, interval)
        panel.set_xticks(place, inputs.codes, rotation=90)
        panel.set_xlim(-0.7, len(inputs) - 0.3)
        tops = indices.total if indices.total_interval is None else indices.total_interval[:, 1]
        panel.set_ylim(0.0, max(0.1, 1.05 * float(tops.max())))
        panel.set_ylabel("index")
    panels[0][0].legend(loc="upper right", frameon=False)
    return figure


def whiskers(panel: Axes, place: Array, values: Array, interval: Array) -> None:
    """Intervals (d, 2) around values (d,)."""
    reach = np.maximum(np.abs(interval.T - values), 0.0)
    panel.errorbar(place, values, yerr=reach, fmt="none", ecolor="#333333", elinewidth=0.8, capsize=1.5)


def response_curves(analyses: Sequence[OutputFit], inputs: InputSet) -> Figure:
    """Mean response along the strongest inputs, one panel per output."""
    figure, panels = _panels(analyses, height=2.6)
    for panel, analysis in panels:
        for curve, colour in zip(analysis.curves, PALETTE, strict=False):
            item = inputs[curve.code]
            share = (curve.values - item.lower) / (item.upper - item.lower)
            panel.plot(share, curve.response, color=colour, label=f"{item.code} {item.symbol}")
        panel.set_xlabel("place in the input's range, lower (0) to upper (1) bound")
        panel.margins(x=0.0)
        _legend_beside(panel)
    return figure


def design_points(analyses: Sequence[OutputFit], inputs: InputSet) -> Figure:
    """Training and test points over the strongest input of every output."""
    figure, panels = _panels(analyses, columns=4, height=2.8)
    for panel, analysis in panels:
        curve, best = analysis.curves[0], analysis.best
        k = inputs.codes.index(curve.code)
        item = inputs.inputs[k]
        values = item.distribution.from_unit(best.model.samples.X[:, k])
        panel.scatter(values, best.model.samples.y, s=9, color=PALETTE[0], alpha=0.5, label="training")
        tested = item.distribution.from_unit(best.test_unit[:, k])
        panel.scatter(tested, best.test_actual, s=16, color=PALETTE[1], marker="D", label="test")
        panel.set_xlabel(f"{item.code} {item.symbol}" + (f" ({item.unit})" if item.unit else ""))
        _few_ticks(panel)
    panels[0][0].legend(frameon=False, fontsize=8)
    return figure


def prediction_scatter(analyses: Sequence[OutputFit]) -> Figure:
    """Scatter simulated against predicted values, one panel per output."""
    figure, panels = _panels(analyses, columns=4, height=2.8)
    for panel, analysis in panels:
        validation = analysis.best.validation
        panel.scatter(validation.actual, validation.predicted, s=9, color=PALETTE[0], alpha=0.5, label="held out")
        panel.scatter(
            analysis.best.test_actual, analysis.best.test_predicted, s=16, color=PALETTE[1], marker="D", label="test"
        )
        panel.axline((validation.actual.mean(),) * 2, slope=1.0, color="#333333", linewidth=0.8)
        panel.set_xlabel("simulated")
        panel.set_ylabel("predicted")
        _few_ticks(panel)
    panels[0][0].legend(frameon=False, fontsize=8)
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
    _legend_beside(panel)
    _tidy(panel)
    return figure


def interaction_bars(analyses: Sequence[OutputAnalysis], inputs: InputSet) -> Figure:
    """Largest second-order indices of every output with intervals."""
    figure, panels = _panels(analyses, columns=4, height=2.6)
    for panel, analysis in panels:
        second, interval = analysis.indices.second, analysis.indices.second_interval
        assert second is not None  # noqa: S101 - an analysis asks for them
        rows, columns = np.triu_indices(len(second), 1)
        order = np.argsort(-second[rows, columns], kind="stable")[:SHOWN_PAIRS]
        rows, columns = rows[order], columns[order]
        place = np.arange(len(order), dtype=float)
        panel.bar(place, second[rows, columns], 0.7, color=FIRST)
        if interval is not None:
            whiskers(panel, place, second[rows, columns], interval[rows, columns])
        labels = [f"{inputs.codes[j]}·{inputs.codes[k]}" for j, k in zip(rows, columns, strict=True)]
        panel.set_xticks(place, labels, rotation=90)
        panel.set_ylim(top=max(0.05, panel.get_ylim()[1]))
    return figure


def convergence(analyses: Sequence[OutputAnalysis], inputs: InputSet) -> Figure:
    """First indices by sampling over the base size, with bootstrap intervals, and the reference as a line."""
    figure, panels = _panels(analyses, columns=4, height=2.8)
    for panel, analysis in panels:
        steps, places = analysis.comparison.convergence, analysis.comparison.places
        sizes = np.array([step.samples for step in steps], dtype=float)
        for rank, (k, colour) in enumerate(zip(places, PALETTE, strict=False)):
            values = np.array([step.indices.first[rank] for step in steps])
            ends = np.array(
                [step.indices.first_interval[rank] for step in steps if step.indices.first_interval is not None]
            )
            whiskers(panel, sizes * 1.03**rank, values, ends)
            panel.plot(sizes * 1.03**rank, values, "o-", color=colour, markersize=4, label=inputs.codes[k])
            panel.axhline(analysis.indices.first[k], color=colour, linewidth=0.8, linestyle=":")
        panel.set_xscale("log", base=2)
        panel.set_xticks(sizes, [f"{int(size)}" for size in sizes])
        panel.minorticks_off()
        panel.set_xlabel("base size N")
        panel.legend(frameon=False, fontsize=7, ncols=2)
    return figure


def uncertainty_split(analyses: Sequence[OutputAnalysis], inputs: InputSet) -> Figure:
    """Draw standard deviations of the strongest first indices: from the surrogate, and from sampling."""
    figure, panels = _panels(analyses, columns=4, height=2.6)
    for panel, analysis in panels:
        if analysis.paths is None:
            continue
        places = strongest(analysis.indices)
        place = np.arange(len(places), dtype=float)
        spread = analysis.paths.first
        panel.bar(place - 0.2, spread.metamodel[places], 0.4, color=FIRST, label="metamodel")
        panel.bar(place + 0.2, spread.monte_carlo[places], 0.4, color=TOTAL, label="Monte Carlo")
        panel.set_xticks(place, [inputs.codes[k] for k in places])
        panel.set_ylabel("deviation of S1")
    if panels[0][0].patches:
        panels[0][0].legend(frameon=False, fontsize=8)
    return figure


def method_comparison(analyses: Sequence[OutputAnalysis], inputs: InputSet) -> Figure:
    """First indices of the strongest inputs by every surrogate, over Kriging paths, and by FAST."""
    figure, panels = _panels(analyses, columns=2, height=2.8)
    for panel, analysis in panels:
        places = strongest(analysis.indices)
        series = {name: (found.first, found.first_interval) for name, found in analysis.comparison.surrogates.items()}
        if analysis.paths is not None:
            series["krg paths"] = (analysis.paths.first.mean, analysis.paths.first.interval)
        series["FAST"] = (analysis.comparison.fast.first, analysis.comparison.fast.first_interval)
        width = 0.8 / len(series)
        for rank, ((name, (values, interval)), colour) in enumerate(zip(series.items(), PALETTE, strict=False)):
            place = np.arange(len(places), dtype=np.float64) + (rank - 0.5 * (len(series) - 1)) * width
            label = f"{name} (chosen)" if name == analysis.chosen else name
            panel.bar(place, values[places], width, color=colour, label=label)
            if interval is not None:
                whiskers(panel, place, values[places], interval[places])
        panel.set_xticks(range(len(places)), [inputs.codes[k] for k in places])
        panel.set_ylabel("S1")
        _legend_beside(panel)
    return figure


def morris_scatter(analyses: Sequence[OutputAnalysis], inputs: InputSet) -> Figure:
    """Mean absolute elementary effect against its deviation; the strongest inputs are named."""
    figure, panels = _panels(analyses, columns=4, height=2.8)
    for panel, analysis in panels:
        found = analysis.comparison.morris
        panel.scatter(found.mean_absolute, found.deviation, s=14, color=PALETTE[0])
        for k in np.argsort(-found.mean_absolute)[:5]:
            panel.annotate(
                inputs.codes[k],
                (found.mean_absolute[k], found.deviation[k]),
                xytext=(3, 3),
                textcoords="offset points",
                fontsize=8,
            )
        panel.set_xlabel("μ*")
        panel.set_ylabel("σ")
        _few_ticks(panel)
    return figure


def make_panels(count: int, *, height: float, columns: int = COLUMNS) -> tuple[Figure, list[Axes]]:
    """Make a figure with `count` panels in rows, each `height` inches high."""
    rows = -(-count // columns)
    figure = Figure(figsize=(12.0, height * rows), layout="constrained")
    panels = [figure.add_subplot(rows, columns, 1 + k) for k in range(count)]
    for panel in panels:
        _tidy(panel)
    return figure, panels


def _panels(analyses: Sequence[Fit], *, height: float, columns: int = COLUMNS) -> tuple[Figure, list[tuple[Axes, Fit]]]:
    """Make a figure with a panel for every output, under its name."""
    figure, panels = make_panels(len(analyses), height=height, columns=columns)
    for panel, analysis in zip(panels, analyses, strict=True):
        panel.set_title(analysis.name, loc="left")
    return figure, list(zip(panels, analyses, strict=True))


def _few_ticks(panel: Axes) -> None:
    """Few and short numbers on both axes of a narrow panel."""
    panel.locator_params(nbins=4)
    panel.ticklabel_format(scilimits=(-3, 4))


def _legend_beside(panel: Axes) -> None:
    panel.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _tidy(panel: Axes) -> None:
    """Quiet axes: no box, faint horizontal lines."""
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(axis="y", color="#e3e7ec", linewidth=0.8)
    panel.set_axisbelow(True)
