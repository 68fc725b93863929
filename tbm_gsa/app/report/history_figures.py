"""Figures of the history: level, error and shocks of one test point over time."""

import math
from collections.abc import Iterator, Sequence
from datetime import UTC
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tbm_gsa.app.report.compare_figures import AXIS_NAMES, FIELD, MODEL, WIDTH, plain_text
from tbm_gsa.app.report.picture import tidy
from tbm_gsa.comparison.alarm import SCATTERS
from tbm_gsa.history.baseline import ErrorStatistics
from tbm_gsa.history.entries import StoredEntry
from tbm_gsa.history.summary import BaselineSummary
from tbm_msgs_py.base.arrays import Array

POINTS_SHOWN: Final = 2000  # of a trend; more become means of neighbours
HIGHEST_PERCENT: Final = 300.0  # a dead sensor would hide everything else
MOST_TICKS: Final = 6  # of the time below a panel; more run into each other
_ERROR: Final = "#333333"
_SHOCKS: Final = {"field_crest_factor": ("crest factor", "#009E73"), "field_kurtosis": ("kurtosis", "#CC79A7")}


def by_trend(windows: Sequence[StoredEntry]) -> dict[str, list[StoredEntry]]:
    """Windows that make a line: of one test point, one machine and one kind; these two are named where they differ."""
    found: dict[tuple[str, str, str], list[StoredEntry]] = {}
    for window in windows:
        source = window.source
        found.setdefault((window.entry.point, source.kind, source.machine), []).append(window)
    mixed = len({(kind, machine) for _, kind, machine in found}) > 1
    return {", ".join(key) if mixed else key[0]: members for key, members in found.items()}


def trends(name: str, windows: Sequence[StoredEntry], baseline: BaselineSummary | None) -> Figure:
    """RMS, relative error and shocks of the windows of one test point over time, a row an axis.

    Dashed: the baseline's mean and limits. The shocks are left out where no window knows them.
    """
    point = windows[0].entry.point
    axes = [axis for axis in AXIS_NAMES if any(window.entry.axis == axis for window in windows)]
    shocks = any(math.isfinite(getattr(window.entry, name)) for window in windows for name in _SHOCKS)
    figure = Figure(figsize=(WIDTH, 0.7 + 2.1 * len(axes)), layout="constrained")
    rows = figure.subplots(len(axes), 3 if shocks else 2, squeeze=False, sharex=True)
    for panels, axis in zip(rows, axes, strict=True):
        chosen = [window for window in windows if window.entry.axis == axis]
        _draw_levels(panels[0], chosen, f"{name}, {AXIS_NAMES[axis]}: RMS, m/s²")
        _draw_errors(panels[1], chosen, baseline.points.get(point, {}).get(axis) if baseline else None)
        if shocks:
            _draw_shocks(panels[2], chosen)
        for panel in panels:
            panel.set_ylim(bottom=0.0)
            tidy(panel)
    locator = AutoDateLocator(tz=UTC, maxticks=MOST_TICKS)  # type: ignore[no-untyped-call]
    for panel in rows[-1]:
        panel.xaxis.set_major_locator(locator)
        panel.xaxis.set_major_formatter(ConciseDateFormatter(locator, tz=UTC))  # type: ignore[no-untyped-call]
        panel.set_xlabel("UTC")
    named = [panel.get_legend_handles_labels() for panel in rows[0]]
    handles, labels = ([one for pair in named for one in pair[i]] for i in (0, 1))
    figure.legend(handles, labels, loc="outside upper right", ncols=len(labels), frameon=False)
    return figure


def _draw_levels(panel: Axes, windows: Sequence[StoredEntry], title: str) -> None:
    for name, attribute, colour in (("measured", "field_rms", FIELD), ("model", "model_rms", MODEL)):
        time, values = _series(windows, attribute)
        panel.plot(time, values, ".-", color=colour, markersize=3, linewidth=0.6, label=name)
    panel.set_title(plain_text(title), loc="left")


def _draw_errors(panel: Axes, windows: Sequence[StoredEntry], usual: ErrorStatistics | None) -> None:
    time, values = _series(windows, "relative_error")
    panel.plot(time, 100.0 * values, ".-", color=_ERROR, markersize=3, linewidth=0.6)
    panel.set_title("relative error, %", loc="left")
    if usual is not None:
        reach = SCATTERS * usual.scatter
        panel.axhline(100.0 * usual.mean, color=MODEL, linewidth=0.9, linestyle="--")
        panel.axhspan(100.0 * (usual.mean - reach), 100.0 * (usual.mean + reach), color=MODEL, alpha=0.1, linewidth=0.0)
    panel.set_ylim(top=min(panel.get_ylim()[1], HIGHEST_PERCENT))


def _draw_shocks(panel: Axes, windows: Sequence[StoredEntry]) -> None:
    for attribute, (name, colour) in _SHOCKS.items():
        time, values = _series(windows, attribute)
        panel.plot(time, values, ".-", color=colour, markersize=3, linewidth=0.6, label=name)
    panel.set_title("measured: crest factor, kurtosis", loc="left")


def _series(windows: Sequence[StoredEntry], attribute: str) -> tuple[NDArray[np.datetime64], Array]:
    """Collect times and values, means of neighbours where there are many; ten windows without one break the line."""
    stamps = np.array([window.entry.start_ns + window.entry.length_ns // 2 for window in windows])
    values = np.array([getattr(window.entry, attribute) for window in windows])
    values = np.where(np.isfinite(values), values, np.nan)
    length = max(window.entry.length_ns for window in windows)
    size = -(-len(stamps) // POINTS_SHOWN)
    times, means = np.array(list(_means(stamps.astype(np.float64), size))), list(_means(values, size))
    breaks = np.flatnonzero(np.diff(times) > 10 * size * length) + 1
    moments = np.insert(times, breaks, times[breaks]).astype(np.int64).astype("datetime64[ns]")
    return moments, np.insert(means, breaks, np.nan)


def _means(values: Array, size: int) -> Iterator[float]:
    for first in range(0, len(values), size):
        part = values[first : first + size]
        known = part[~np.isnan(part)]
        yield float(known.mean()) if known.size else float("nan")
