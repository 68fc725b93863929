"""Figures of the history: error and level of one test point over time."""

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from tbm_gsa.arrays import Array
from tbm_gsa.comparison.alarm import SCATTERS
from tbm_gsa.comparison.offline import G
from tbm_gsa.history.baseline import Baseline
from tbm_gsa.history.entries import Window
from tbm_gsa.report.compare_figures import AXIS_NAMES, FIELD, MODEL, WIDTH, plain_text, tidy

POINTS_SHOWN: Final = 2000  # of a trend; more become means of neighbours
HIGHEST_PERCENT: Final = 300.0  # a dead sensor would hide everything else
_ERROR: Final = "#333333"


def by_point(windows: Sequence[Window]) -> dict[str, list[Window]]:
    """Windows by test point."""
    found: dict[str, list[Window]] = {}
    for window in windows:
        found.setdefault(window.entry.point, []).append(window)
    return found


def trends(point: str, windows: Sequence[Window], baseline: Baseline | None) -> Figure:
    """RMS and relative error of one test point over time, a row an axis; dashed: the baseline's mean and limits."""
    axes = [axis for axis in AXIS_NAMES if any(window.entry.axis == axis for window in windows)]
    figure = Figure(figsize=(WIDTH, 0.7 + 2.1 * len(axes)), layout="constrained")
    rows = figure.subplots(len(axes), 2, squeeze=False, sharex=True)
    for (levels, errors), axis in zip(rows, axes, strict=True):
        chosen = [window for window in windows if window.entry.axis == axis]
        for name, attribute, colour in (("measured", "field_rms", FIELD), ("model", "model_rms", MODEL)):
            time, values = _series(chosen, attribute)
            levels.plot(time, values / G, ".-", color=colour, markersize=3, linewidth=0.6, label=name)
        levels.set_title(plain_text(f"{point}, {AXIS_NAMES[axis]}: RMS, g"), loc="left")
        time, values = _series(chosen, "relative_error")
        errors.plot(time, 100.0 * values, ".-", color=_ERROR, markersize=3, linewidth=0.6)
        errors.set_title("relative error, %", loc="left")
        if baseline is not None:
            _mark_baseline(errors, baseline, (point, axis))
        errors.set_ylim(top=min(errors.get_ylim()[1], HIGHEST_PERCENT))
        for panel in (levels, errors):
            panel.set_ylim(bottom=0.0)
            tidy(panel)
    locator = AutoDateLocator(tz=UTC)  # type: ignore[no-untyped-call]
    for panel in rows[-1]:
        panel.xaxis.set_major_locator(locator)
        panel.xaxis.set_major_formatter(ConciseDateFormatter(locator, tz=UTC))  # type: ignore[no-untyped-call]
        panel.set_xlabel("UTC")
    figure.legend(*rows[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False)
    return figure


def _mark_baseline(panel: Axes, baseline: Baseline, key: tuple[str, str]) -> None:
    usual = baseline.usual.get(key)
    if usual is None:
        return
    panel.axhline(100.0 * usual.mean, color=MODEL, linewidth=0.9, linestyle="--")
    reach = SCATTERS * usual.scatter
    panel.axhspan(100.0 * (usual.mean - reach), 100.0 * (usual.mean + reach), color=MODEL, alpha=0.1, linewidth=0.0)


def _series(windows: Sequence[Window], attribute: str) -> tuple[list[datetime], Array]:
    """Give times and values, means of neighbours where there are many; ten windows without one break the line."""
    stamps = np.array([window.entry.start_ns + window.entry.length_ns // 2 for window in windows])
    values = np.array([getattr(window.entry, attribute) for window in windows])
    values = np.where(np.isfinite(values), values, np.nan)
    length = max(window.entry.length_ns for window in windows)
    size = -(-len(stamps) // POINTS_SHOWN)
    times, means = list(_means(stamps.astype(np.float64), size)), list(_means(values, size))
    breaks = np.flatnonzero(np.diff(times) > 10 * size * length) + 1
    moments = [datetime.fromtimestamp(stamp * 1e-9, UTC) for stamp in np.insert(times, breaks, np.array(times)[breaks])]
    return moments, np.insert(means, breaks, np.nan)


def _means(values: Array, size: int) -> Iterator[float]:
    for first in range(0, len(values), size):
        part = values[first : first + size]
        known = part[~np.isnan(part)]
        yield float(known.mean()) if known.size else float("nan")
