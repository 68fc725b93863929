"""Figures of the history: level, its ratio to the model's and shocks of one test point over time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from tbm_gsa.app.report.compare_figures import AXIS_NAMES, FIELD, MODEL, WIDTH, plain_text
from tbm_gsa.app.report.picture import tidy
from tbm_gsa.app.report.quantiles import quantiles
from tbm_gsa.comparison.alarm import log_reach
from tbm_gsa.history.baseline import ErrorStatistics
from tbm_gsa.history.events import StoredEvent
from tbm_gsa.history.spread import TrendGroup
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.topics import ERROR_THRESHOLD

MOST_MARKED: Final = 100  # points of a line; more of them run together
FARTHEST: Final = 20.0  # factor from the limits; a dead sensor would hide everything else
MOST_TICKS: Final = 6  # of the time below a panel; more run into each other
_RATIO: Final = "#333333"
_TICKS: Final = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
_LIMIT: Final = "#d00000"
_SHOCKS: Final = {"field_crest_factor": ("crest factor", "#009E73"), "field_kurtosis": ("kurtosis", "#CC79A7")}
_SEVERITIES: Final = {"info": "#7f7f7f", "warning": "#E69F00", "error": "#d00000"}

Stamps = NDArray[np.datetime64]


@dataclass(frozen=True)
class Trend:
    """Windows that make a line: of one test point, one machine and one kind of source, by axis."""

    point: str
    machine: str
    kind: str
    axes: Mapping[str, TrendGroup]


def by_trend(groups: Iterable[TrendGroup]) -> list[Trend]:
    """Sort groups into trends; what else they differ in, as their context, makes no line of its own."""
    found: dict[tuple[str, str, str], dict[str, list[TrendGroup]]] = {}
    for group in groups:
        point, axis, machine, kind = group.key[:4]
        found.setdefault((point, machine, kind), {}).setdefault(axis, []).append(group)
    return [
        Trend(*key, {axis: TrendGroup.joined(axes[axis]) for axis in AXIS_NAMES if axis in axes})
        for key, axes in found.items()
    ]


def trends(
    trend: Trend, name: str, edges_ns: Array, usual: Mapping[str, ErrorStatistics], events: Sequence[StoredEvent]
) -> Figure:
    """RMS, its ratio to the model's and shocks of the windows of one test point over time, a row an axis.

    Each a median and, shaded, 5 to 95 % of the windows of a part of the time. Dashed: where a window counts for an
    alarm, about what is usual. Upright lines: begins of events. The shocks are left out where no window knows them.
    """
    shocks = any(np.isfinite(getattr(group, key)).any() for group in trend.axes.values() for key in _SHOCKS)
    figure = Figure(figsize=(WIDTH, 0.9 + 2.0 * len(trend.axes)))
    rows = figure.subplots(len(trend.axes), 3 if shocks else 2, squeeze=False, sharex=True)
    height = figure.get_size_inches()[1]
    figure.subplots_adjust(0.055, 0.5 / height, 0.99, 1.0 - 0.55 / height, wspace=0.2, hspace=0.35)
    for panels, (axis, group) in zip(rows, trend.axes.items(), strict=True):
        _draw_levels(panels[0], group, edges_ns, f"{name}, {AXIS_NAMES[axis]}: RMS, m/s²")
        _draw_ratio(panels[1], group, edges_ns, usual.get(axis))
        if shocks:
            _draw_shocks(panels[2], group, edges_ns)
        for panel in panels:
            _mark_events(panel, events)
            tidy(panel)
    longest = max(int(group.length_ns.max()) for group in trend.axes.values())
    rows[0, 0].set_xlim(_stamps(np.array([edges_ns[0], edges_ns[-1] + longest])))
    locator = AutoDateLocator(tz=UTC, maxticks=MOST_TICKS)  # type: ignore[no-untyped-call]
    for panel in rows[-1]:
        panel.xaxis.set_major_locator(locator)
        panel.xaxis.set_major_formatter(ConciseDateFormatter(locator, tz=UTC))  # type: ignore[no-untyped-call]
        panel.set_xlabel("UTC")
    named = dict(pair for panel in rows[0] for pair in zip(*panel.get_legend_handles_labels()[::-1], strict=True))
    figure.legend(named.values(), named.keys(), loc="upper right", ncols=len(named), frameon=False)
    return figure


def _draw_levels(panel: Axes, group: TrendGroup, edges_ns: Array, title: str) -> None:
    _draw(panel, group, np.where(group.field_rms > 0.0, group.field_rms, np.nan), edges_ns, FIELD, "measured")
    modelled = np.where(group.model_rms > 0.0, group.model_rms, np.nan)
    _draw(panel, group, modelled, edges_ns, MODEL, "model")
    panel.set_ylim(bottom=0.0)
    panel.set_title(plain_text(title), loc="left", y=1.0, fontsize=10)


def _draw_ratio(panel: Axes, group: TrendGroup, edges_ns: Array, usual: ErrorStatistics | None) -> None:
    """Draw measured over computed RMS, and the limits of the alarm on the level."""
    drawn = _draw(panel, group, np.exp(group.log_ratio), edges_ns, _RATIO, None)
    mean, scatter = (usual.log_mean, usual.log_scatter) if usual is not None else (None, None)
    reach = float(log_reach(scatter or 0.0, ERROR_THRESHOLD))
    limits = np.exp([(mean or 0.0) - reach, (mean or 0.0) + reach])
    for number, limit in enumerate(limits):
        label = None if number else "limits of the alarm"
        panel.axhline(limit, color=_LIMIT, linewidth=0.9, linestyle="--", label=label)
    panel.set_yscale("log")
    seen = np.concatenate([drawn[drawn > 0.0], limits])
    low, high = max(seen.min(), limits[0] / FARTHEST), min(seen.max(), limits[1] * FARTHEST)
    panel.set_ylim(low / 1.15, high * 1.15)
    panel.yaxis.set_major_locator(LogLocator(subs=_TICKS))
    panel.yaxis.set_minor_locator(NullLocator())
    panel.yaxis.set_major_formatter("{x:g}")
    panel.set_title("measured over model", loc="left", y=1.0, fontsize=10)


def _draw_shocks(panel: Axes, group: TrendGroup, edges_ns: Array) -> None:
    for attribute, (name, colour) in _SHOCKS.items():
        _draw(panel, group, getattr(group, attribute), edges_ns, colour, name)
    panel.set_ylim(bottom=0.0)
    panel.set_title("measured: crest factor, kurtosis", loc="left", y=1.0, fontsize=10)


def _draw(panel: Axes, group: TrendGroup, values: Array, edges_ns: Array, colour: str, label: str | None) -> Array:
    """Draw the median of values and their 5 to 95 %, which are returned; ten parts without a window break the line."""
    found = quantiles(group.middle_ns, values, edges_ns)
    length = max(float(group.length_ns.max()), edges_ns[1] - edges_ns[0])
    breaks = np.flatnonzero(np.diff(found.time) > 10.0 * length) + 1
    times = _stamps(np.insert(found.time, breaks, found.time[breaks]))
    low, median, high = np.insert(found.values, breaks, np.nan, axis=1)
    style = ".-" if len(times) <= MOST_MARKED else "-"
    panel.plot(times, median, style, color=colour, markersize=3, linewidth=0.8, label=label)
    panel.fill_between(times, low, high, color=colour, alpha=0.25, linewidth=0.0)
    return found.values


def _stamps(time_ns: Array) -> Stamps:
    return time_ns.astype(np.int64).astype("datetime64[ns]")


def _mark_events(panel: Axes, events: Sequence[StoredEvent]) -> None:
    for severity, colour in _SEVERITIES.items():
        begins = [one.event.begin_ns for one in events if one.event.severity == severity]
        if begins:
            moments = _stamps(np.array(begins))
            across = panel.get_xaxis_transform()
            panel.vlines(moments, 0.0, 1.0, color=colour, linewidth=1.0, transform=across, label=f"event, {severity}")
