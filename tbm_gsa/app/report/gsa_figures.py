"""Figures of the sensitivity page: result and analyses → matplotlib figures."""

from collections.abc import Mapping, Sequence
from typing import Final, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from tbm_dynamics.indicators import UNITS
from tbm_gsa.app.report.picture import PALETTE, tidy
from tbm_gsa.sensitivity.results import NOT_DETERMINED, IndexInterval, IndexTable, OutputResult
from tbm_gsa.sensitivity.study.analysis import OutputFit
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_msgs_py.base.arrays import Array

FIRST: Final = "#1f5f99"
TOTAL: Final = "#b9d3ea"
COLUMNS: Final = 2
SHOWN_PAIRS: Final = 6

Results = Mapping[str, OutputResult]
Fits = Sequence[OutputFit]
Drawn = TypeVar("Drawn")
Judged = TypeVar("Judged", OutputResult, OutputFit)


def output_unit(name: str) -> str:
    """Return the unit of an output; empty of a number, and of a function's value."""
    return UNITS.get(name, "m/s²" if name.startswith(("rms_", "peak_")) else "")


def index_bars(fits: Fits, inputs: InputSet) -> Figure:
    """First-order and total indices of all inputs with intervals, one panel per output."""
    figure, panels = _determined_panels(_by_name(fits), height=2.6)
    codes, place = inputs.codes, np.arange(len(inputs), dtype=float)
    for panel, fit in panels:
        found = IndexTable.model_validate(fit.indices, context=codes)
        _bars(panel, place - 0.2, 0.4, codes, found.first, found.first_interval, FIRST, "S1")
        _bars(panel, place + 0.2, 0.4, codes, found.total, found.total_interval, TOTAL, "ST")
        panel.set_xticks(place, codes, rotation=90)
        panel.set_xlim(-0.7, len(codes) - 0.3)
        tops = [high for _, high in found.total_interval.values()] or found.total.values()
        panel.set_ylim(0.0, max(0.1, 1.05 * max(tops)))
        panel.set_ylabel("index")
    _legend_of_first(panels)
    return figure


def response_curves(fits: Fits, inputs: InputSet) -> Figure:
    """Mean response along the strongest inputs, one panel per output."""
    figure, panels = _determined_panels(_by_name(fits), height=2.6, values=True)
    for panel, fit in panels:
        for curve, colour in zip(fit.curves, PALETTE, strict=False):
            item = inputs[curve.code]
            share = (curve.values - item.lower) / (item.upper - item.lower)
            panel.plot(share, curve.response, color=colour, label=f"{item.code} {item.symbol}")
        panel.set_xlabel("place in the input's range, lower (0) to upper (1) bound")
        panel.margins(x=0.0)
        _legend_beside(panel)
    return figure


def design_points(fits: Fits, inputs: InputSet) -> Figure:
    """Training and test points over the strongest input of every output."""
    figure, panels = _panels(_by_name(fits), columns=4, height=2.8, values=True)
    for panel, fit in panels:
        best, item = fit.best, inputs[fit.curves[0].code]
        k, samples = inputs.codes.index(item.code), best.model.samples
        values, tested = (item.distribution.from_unit(points[:, k]) for points in (samples.X, best.test_unit))
        _samples(panel, (values, samples.y), (tested, best.test_actual), "training")
        panel.set_xlabel(f"{item.code} {item.symbol}" + (f" ({item.unit})" if item.unit else ""))
    panels[0][0].legend(frameon=False, fontsize=8)
    return figure


def prediction_scatter(fits: Fits) -> Figure:
    """Scatter simulated against predicted values, one panel per output."""
    figure, panels = _panels(_by_name(fits), columns=4, height=2.8, values=True)
    for panel, fit in panels:
        best, held_out = fit.best, fit.best.validation
        _samples(panel, (held_out.actual, held_out.predicted), (best.test_actual, best.test_predicted), "held out")
        panel.axline((held_out.actual.mean(),) * 2, slope=1.0, color="#333333", linewidth=0.8)
        panel.set_xlabel("simulated")
        panel.set_ylabel("predicted")
    panels[0][0].legend(frameon=False, fontsize=8)
    return figure


def score_bars(fits: Fits) -> Figure:
    """R² of cross validation and on test points of every method, grouped by output."""
    figure, (panel,) = make_panels(1, height=2.8, columns=1)
    series = [(method, kind) for method in fits[0].candidates for kind in ("cross validation", "test")]
    width = 0.8 / len(series)
    for rank, (method, kind) in enumerate(series):
        found = [fit.candidates[method] for fit in fits]
        scores = [item.r2_cv if kind == "cross validation" else item.r2_test for item in found]
        shown = [np.nan if score is None else max(score, 0.0) for score in scores]
        colour = to_rgba(PALETTE[rank // 2], 0.55 if kind == "test" else 1.0)
        centre = np.arange(len(fits)) + (rank - 0.5 * (len(series) - 1)) * width
        panel.bar(centre, shown, width, label=f"{method}, {kind}", color=colour)
    panel.set_xticks(range(len(fits)), _by_name(fits))
    panel.set_ylim(0.0, 1.0)
    panel.set_ylabel("R²")
    _legend_beside(panel)
    return figure


def interaction_bars(outputs: Results) -> Figure:
    """Largest second-order indices of every output with intervals."""
    figure, panels = _determined_panels(outputs, columns=4, height=2.6)
    for panel, output in panels:
        pairs = {"·".join(pair.inputs): pair for pair in output.second[:SHOWN_PAIRS]}
        place = np.arange(len(pairs), dtype=float)
        values, ends = ({name: getattr(pair, key) for name, pair in pairs.items()} for key in ("index", "interval"))
        _bars(panel, place, 0.7, list(pairs), values, ends, FIRST)
        panel.set_xticks(place, pairs, rotation=90)
        panel.set_ylim(top=max(0.05, panel.get_ylim()[1]))
    return figure


def convergence(outputs: Results) -> Figure:
    """First-order indices by sampling over the base size, with bootstrap intervals, and the reference as a line."""
    figure, panels = _determined_panels(outputs, columns=4, height=2.8)
    for panel, output in panels:
        sizes = np.array([step.samples for step in output.convergence], dtype=float)
        for rank, (code, colour) in enumerate(zip(output.convergence[0].first, PALETTE, strict=False)):
            values = np.array([step.first[code] for step in output.convergence])
            _whiskers(panel, sizes * 1.03**rank, values, [step.first_interval[code] for step in output.convergence])
            panel.plot(sizes * 1.03**rank, values, "o-", color=colour, markersize=4, label=code)
            panel.axhline(output.first[code], color=colour, linewidth=0.8, linestyle=":")
        panel.set_xscale("log", base=2)
        panel.set_xticks(sizes, [f"{int(size)}" for size in sizes])
        panel.minorticks_off()
        panel.set_xlabel("base size N")
        panel.legend(frameon=False, fontsize=7, ncols=2)
    return figure


def uncertainty_split(outputs: Results) -> Figure:
    """Draw standard deviations of the strongest first-order indices: from the surrogate, and from sampling."""
    figure, panels = _determined_panels(outputs, columns=4, height=2.6)
    for panel, output in panels:
        if output.paths is None or not output.scores["krg"].determined:
            continue
        codes, spread = output.strongest(), output.paths.first
        place = np.arange(len(codes), dtype=float)
        _bars(panel, place - 0.2, 0.4, codes, spread.metamodel, {}, FIRST, "metamodel")
        _bars(panel, place + 0.2, 0.4, codes, spread.monte_carlo, {}, TOTAL, "Monte Carlo")
        panel.set_xticks(place, codes)
        panel.set_ylabel("deviation of S1")
    _legend_of_first(panels)
    return figure


def method_comparison(outputs: Results) -> Figure:
    """First-order indices of the strongest inputs by every surrogate, over Kriging paths, and by FAST."""
    figure, panels = _determined_panels(outputs, columns=2, height=2.8)
    for panel, output in panels:
        codes = output.strongest()
        series = {
            name: (found.first, found.first_interval)
            for name, found in output.by_surrogate.items()
            if output.scores[name].determined
        }
        if output.paths is not None and "krg" in series:
            series["krg paths"] = (output.paths.first.mean, output.paths.first.interval)
        if output.fast is not None:
            series["FAST"] = (output.fast.first, output.fast.first_interval)
        width = 0.8 / len(series)
        for rank, ((name, (values, intervals)), colour) in enumerate(zip(series.items(), PALETTE, strict=False)):
            place = np.arange(len(codes), dtype=float) + (rank - 0.5 * (len(series) - 1)) * width
            quality = f", R² {output.scores[name].r2_cv:.2f}" if name in output.scores else ""
            label = f"{name}{quality}{' (chosen)' if name == output.surrogate else ''}"
            _bars(panel, place, width, codes, values, intervals, colour, label)
        panel.set_xticks(range(len(codes)), codes)
        panel.set_ylabel("S1")
        _legend_beside(panel)
    return figure


def morris_scatter(outputs: Results) -> Figure:
    """Mean absolute elementary effect against its deviation; the strongest inputs are named."""
    figure, panels = _determined_panels(outputs, columns=4, height=2.8, values=True)
    for panel, output in panels:
        if output.morris is None:
            continue
        mean, deviation = output.morris.mean_absolute, output.morris.deviation
        panel.scatter(list(mean.values()), list(deviation.values()), s=14, color=PALETTE[0])
        for code in sorted(mean, key=mean.__getitem__, reverse=True)[:5]:
            place = mean[code], deviation[code]
            panel.annotate(code, place, xytext=(3, 3), textcoords="offset points", fontsize=8)
        panel.set_xlabel("μ*")
        panel.set_ylabel("σ")
        _few_ticks(panel)
    return figure


def make_panels(count: int, *, height: float, columns: int = COLUMNS) -> tuple[Figure, list[Axes]]:
    """Make a figure with `count` panels in rows, each `height` inches high: no box, faint horizontal lines."""
    rows = -(-count // columns)
    figure = Figure(figsize=(12.0, height * rows), layout="constrained")
    panels = [figure.add_subplot(rows, columns, 1 + k) for k in range(count)]
    for panel in panels:
        tidy(panel)
    return figure, panels


def _with_unit(name: str) -> str:
    return f"{name}, {unit}" if (unit := output_unit(name)) else name


def _by_name(fits: Fits) -> dict[str, OutputFit]:
    return {fit.name: fit for fit in fits}


def _panels(
    outputs: Mapping[str, Drawn], *, height: float, columns: int = COLUMNS, values: bool = False
) -> tuple[Figure, list[tuple[Axes, Drawn]]]:
    """Make a figure with a panel for every output, under its name; with its unit where its values are drawn."""
    figure, panels = make_panels(len(outputs), height=height, columns=columns)
    for panel, name in zip(panels, outputs, strict=True):
        panel.set_title(_with_unit(name) if values else name, loc="left")
    return figure, list(zip(panels, outputs.values(), strict=True))


def _determined_panels(
    outputs: Mapping[str, Judged], *, height: float, columns: int = COLUMNS, values: bool = False
) -> tuple[Figure, list[tuple[Axes, Judged]]]:
    """Make a figure as `_panels` does; returned are the panels of outputs with indices, the others say so."""
    figure, panels = _panels(outputs, height=height, columns=columns, values=values)
    for panel, output in panels:
        if not output.determined:
            panel.set_axis_off()
            panel.text(0.5, 0.5, NOT_DETERMINED, ha="center", va="center", transform=panel.transAxes)
    return figure, [(panel, output) for panel, output in panels if output.determined]


def _legend_of_first(panels: Sequence[tuple[Axes, object]]) -> None:
    """Legend of the first panel that draws anything."""
    for panel, _ in panels:
        if panel.get_legend_handles_labels()[0]:
            panel.legend(loc="upper right", frameon=False, fontsize=8)
            return


def _bars(
    panel: Axes,
    place: Array,
    width: float,
    codes: Sequence[str],
    values: Mapping[str, float],
    intervals: Mapping[str, IndexInterval],
    colour: str,
    label: str | None = None,
) -> None:
    """Draw the values of some codes as bars, with whiskers where intervals are known."""
    heights = np.array([values[code] for code in codes])
    panel.bar(place, heights, width, color=colour, label=label)
    if intervals:
        _whiskers(panel, place, heights, [intervals[code] for code in codes])


def _whiskers(panel: Axes, place: Array, values: Array, intervals: Sequence[IndexInterval]) -> None:
    """Draw intervals around values (d,)."""
    reach = np.maximum(np.abs(np.array(intervals).T - values), 0.0)
    panel.errorbar(place, values, yerr=reach, fmt="none", ecolor="#333333", elinewidth=0.8, capsize=1.5)


def _samples(panel: Axes, trained: tuple[Array, Array], tested: tuple[Array, Array], label: str) -> None:
    """Draw training and test samples, abscissa and ordinate of each."""
    panel.scatter(*trained, s=9, color=PALETTE[0], alpha=0.5, label=label)
    panel.scatter(*tested, s=16, color=PALETTE[1], marker="D", label="test")
    _few_ticks(panel)


def _few_ticks(panel: Axes) -> None:
    """Few and short numbers on both axes of a narrow panel."""
    panel.locator_params(nbins=4)
    panel.ticklabel_format(scilimits=(-3, 4))


def _legend_beside(panel: Axes) -> None:
    panel.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
