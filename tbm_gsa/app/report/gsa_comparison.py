"""Figures that hold one way of finding indices against others: analyses → matplotlib figures."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from tbm_gsa.app.report.gsa_figures import FIRST, PALETTE, TOTAL, make_panels, whiskers
from tbm_gsa.sensitivity.study.analysis import OutputAnalysis, strongest
from tbm_gsa.sensitivity.study.inputs import InputSet

SHOWN_PAIRS: Final = 6


def interaction_bars(analyses: Sequence[OutputAnalysis], inputs: InputSet) -> Figure:
    """Largest second-order indices of every output with intervals."""
    figure, panels = make_panels(len(analyses), columns=4, height=2.6)
    for panel, analysis in zip(panels, analyses, strict=True):
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
        panel.set_title(analysis.name, loc="left")
        panel.set_ylim(top=max(0.05, panel.get_ylim()[1]))
    return figure


def convergence(analyses: Sequence[OutputAnalysis], inputs: InputSet) -> Figure:
    """First indices by sampling over the base size, with bootstrap intervals, and the reference as a line."""
    figure, panels = make_panels(len(analyses), columns=4, height=2.8)
    for panel, analysis in zip(panels, analyses, strict=True):
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
        panel.set_title(analysis.name, loc="left")
        panel.set_xlabel("base size N")
        panel.legend(frameon=False, fontsize=7, ncols=2)
    return figure


def uncertainty_split(analyses: Sequence[OutputAnalysis], inputs: InputSet) -> Figure:
    """Draw standard deviations of the strongest first indices: from the surrogate, and from sampling."""
    figure, panels = make_panels(len(analyses), columns=4, height=2.6)
    for panel, analysis in zip(panels, analyses, strict=True):
        panel.set_title(analysis.name, loc="left")
        if analysis.paths is None:
            continue
        places = strongest(analysis.indices)
        place = np.arange(len(places), dtype=float)
        spread = analysis.paths.first
        panel.bar(place - 0.2, spread.metamodel[places], 0.4, color=FIRST, label="metamodel")
        panel.bar(place + 0.2, spread.monte_carlo[places], 0.4, color=TOTAL, label="Monte Carlo")
        panel.set_xticks(place, [inputs.codes[k] for k in places])
        panel.set_ylabel("deviation of S")
    if panels[0].patches:
        panels[0].legend(frameon=False, fontsize=8)
    return figure


def method_comparison(analyses: Sequence[OutputAnalysis], inputs: InputSet) -> Figure:
    """First indices of the strongest inputs by every surrogate, over Kriging paths, and by FAST."""
    figure, panels = make_panels(len(analyses), columns=2, height=2.8)
    for panel, analysis in zip(panels, analyses, strict=True):
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
        panel.set_title(analysis.name, loc="left")
        panel.set_ylabel("first index")
        panel.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def morris_scatter(analyses: Sequence[OutputAnalysis], inputs: InputSet) -> Figure:
    """Mean absolute elementary effect against its deviation; the strongest inputs are named."""
    figure, panels = make_panels(len(analyses), columns=4, height=2.8)
    for panel, analysis in zip(panels, analyses, strict=True):
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
        panel.set_title(analysis.name, loc="left")
        panel.set_xlabel("μ*")
        panel.set_ylabel("σ")
        panel.locator_params(nbins=4)
        panel.ticklabel_format(scilimits=(-3, 4))
    return figure
