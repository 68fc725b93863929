"""The cutterhead loads of a run, as the paper's Figure 4 has them: each component over time and frequency."""

from __future__ import annotations

from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tbm_gsa.app.report.picture import thinned
from tbm_gsa.paper.load_summary import HIGHEST_HZ, RATE_HZ, RESOLUTION_HZ, LoadRun, line_amplitudes
from tbm_gsa.paper.published import LoadRow
from tbm_msgs_py.base.arrays import Array

SHOWN_S: Final = 10.0
CURVE, REGION, LINE = "#0072B2", "#F0E442", "#D55E00"


def load_figure(run: LoadRun) -> Figure:
    """Draw the first seconds and the spectrum of each component, stated regions shaded and lines marked."""
    figure = Figure(figsize=(14.0, 13.0), layout="constrained")
    summary = run.summary
    figure.suptitle(f"{summary.machine}: cutterhead loads, {summary.loads} level, seed {summary.seed}")
    rows = figure.subplots(len(run.stated), 2, gridspec_kw={"width_ratios": (1.0, 1.2)})
    for column, (stated, (left, right)) in enumerate(zip(run.stated.values(), rows, strict=True)):
        unit = stated.unit
        _over_time(left, run.time, run.values[:, column] / 1e3)
        left.set_title(f"{stated.name}, {unit}", loc="left", fontsize=10)
        _over_frequency(right, run.values[:, column] / 1e3, stated)
        right.set_title(f"amplitude, {unit} in {RESOLUTION_HZ:g} Hz", loc="left", fontsize=10)
    rows[-1, 0].set_xlabel("s")
    rows[-1, 1].set_xlabel("Hz")
    return figure


def _over_time(panel: Axes, time: Array, values: Array) -> None:
    shown = time < SHOWN_S
    panel.plot(*thinned(time[shown], values[shown]), color=CURVE, linewidth=0.6)
    panel.axhline(values.mean(), color=LINE, linewidth=0.8, linestyle="--")
    panel.margins(x=0.0)


def _over_frequency(panel: Axes, values: Array, stated: LoadRow) -> None:
    frequency, amplitude = line_amplitudes(values, RATE_HZ)
    for low, high in stated.regions:
        panel.axvspan(low, high, color=REGION, alpha=0.35, linewidth=0.0)
    for line in stated.lines:
        panel.axvline(line, color=LINE, linewidth=0.7, linestyle=":")
    # Plain numbers: a picture that shows names of others draws no mathematics.
    panel.semilogy(*thinned(frequency, amplitude), color=CURVE, linewidth=0.7)
    panel.yaxis.set_major_formatter("{x:g}")
    panel.set_xlim(0.0, HIGHEST_HZ)
    top = float(amplitude.max())
    if top > 0.0:
        panel.set_ylim(1e-4 * top, 2.0 * top)
