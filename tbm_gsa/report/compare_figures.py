"""Figures of the comparison page: a comparison → matplotlib figures."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tbm_gsa.arrays import Array
from tbm_gsa.comparison.excerpt import Excerpt
from tbm_gsa.comparison.expected import ExpectedLine, Kind
from tbm_gsa.comparison.offline import Comparison, G
from tbm_gsa.comparison.statistics import Spectrum

# Of Okabe and Ito, told apart by colour-blind readers too.
FIELD: Final = "#D55E00"
MODEL: Final = "#0072B2"
LINE_COLOURS: Final[dict[Kind, str]] = {"load": "#555555", "mesh": "#CC79A7", "axial": "#009E73"}
LINE_NAMES: Final[dict[Kind, str]] = {"load": "lines of the loads", "mesh": "mesh frequency", "axial": "axial modes"}
AXIS_NAMES: Final = {"x": "axial, x", "y": "lateral, y", "z": "vertical, z", "yz": "across, √(y² + z²)"}
WIDTH: Final = 12.0
SPECTRUM_COLUMNS: Final = 1000
DECADES: Final = 7


def time_series(excerpt: Excerpt) -> Figure:
    """Field above model, on one scale."""
    figure = Figure(figsize=(WIDTH, 4.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(2, 1, sharex=True, sharey=True))
    sides = (("measured", excerpt.field, FIELD), ("model", excerpt.model, MODEL))
    for panel, (name, series, colour) in zip(panels, sides, strict=True):
        panel.plot(series.time, series.values / G, color=colour, linewidth=0.7)
        panel.set_title(name, loc="left", color=colour)
        panel.set_ylabel("g")
        panel.margins(x=0.0)
        _tidy(panel)
    panels[-1].set_xlabel("s")
    return figure


def spectra(comparison: Comparison, lines: Sequence[ExpectedLine]) -> Figure:
    """Axial power spectral densities, one panel per point, with the expected lines."""
    points = comparison.points
    figure = Figure(figsize=(WIDTH, 0.5 + 2.1 * len(points)), layout="constrained")
    panels: list[Axes] = list(figure.subplots(len(points), 1, squeeze=False, sharex=True)[:, 0])
    highest = max(point.band.high for point in points.values())
    for panel, (name, point) in zip(panels, points.items(), strict=True):
        axis = point.axes["x"]
        for label, side, colour in (("measured", axis.field, FIELD), ("model", axis.model, MODEL)):
            panel.plot(*_envelope(side.spectrum), color=colour, linewidth=0.8, label=label)
        top = max(float(side.spectrum.density.max()) for side in (axis.field, axis.model)) / G**2
        if top > 0.0:
            panel.set_yscale("log")
            panel.set_ylim(top * 10.0**-DECADES, 3.0 * top)
        _mark_lines(panel, lines, highest)
        panel.set_title(_plain(name), loc="left")
        panel.set_ylabel("g²/Hz")
        _tidy(panel)
    panels[-1].set_xlim(0.0, highest)
    panels[-1].set_xlabel("Hz")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=5, frameon=False)
    return figure


def _mark_lines(panel: Axes, lines: Sequence[ExpectedLine], highest_hz: float) -> None:
    for kind, colour in LINE_COLOURS.items():
        inside = [line.frequency for line in lines if line.kind == kind and line.frequency <= highest_hz]
        for number, frequency in enumerate(inside):
            label = None if number else LINE_NAMES[kind]
            panel.axvline(
                frequency, color=colour, linewidth=0.9, linestyle=(0, (4, 3)), alpha=0.7, zorder=0, label=label
            )


def _envelope(spectrum: Spectrum) -> tuple[Array, Array]:
    """Highest values of neighbouring bins in g²/Hz, so that a long spectrum stays small and keeps its lines."""
    size = -(-len(spectrum.density) // SPECTRUM_COLUMNS)
    count = len(spectrum.density) // size
    blocks = spectrum.density[: count * size].reshape(count, size)
    frequency = spectrum.frequency[: count * size].reshape(count, size)
    strongest = blocks.argmax(axis=1)[:, None]
    return np.take_along_axis(frequency, strongest, axis=1)[:, 0], blocks.max(axis=1) / G**2


def power_flow(comparison: Comparison) -> Figure:
    """RMS at the points along the power flow, one panel per direction: the paper's Figure 7b."""
    points = comparison.points
    axes = [axis for axis in AXIS_NAMES if any(axis in point.axes for point in points.values())]
    figure = Figure(figsize=(WIDTH, 3.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, len(axes), squeeze=False)[0])
    place = np.arange(len(points), dtype=np.float64)
    for panel, axis in zip(panels, axes, strict=True):
        compared = [point.axes.get(axis) for point in points.values()]
        measured = [np.nan if item is None else item.field.rms / G for item in compared]
        predicted = [np.nan if item is None else item.model.rms / G for item in compared]
        panel.bar(place - 0.2, measured, 0.4, color=FIELD, label="measured")
        panel.bar(place + 0.2, predicted, 0.4, color=MODEL, label="model")
        panel.set_title(AXIS_NAMES[axis], loc="left")
        panel.set_xticks(place, [_plain(name) for name in points], rotation=20)
        _tidy(panel)
    panels[0].set_ylabel("RMS, g")
    panels[0].legend(frameon=False)
    return figure


def windows(comparison: Comparison) -> Figure:
    """Axial RMS and relative error of every window, one row per point."""
    points = comparison.points
    figure = Figure(figsize=(WIDTH, 0.5 + 1.9 * len(points)), layout="constrained")
    rows = figure.subplots(len(points), 2, squeeze=False, sharex=True)
    for (levels, errors), (name, point) in zip(rows, points.items(), strict=True):
        axis = point.axes["x"]
        seen = axis.windows
        middle = seen.start + comparison.window_s / 2.0
        levels.plot(middle, seen.field_rms / G, "o-", color=FIELD, markersize=3, linewidth=1.0, label="measured")
        levels.axhline(axis.model.rms / G, color=MODEL, linewidth=0.8, linestyle="--", label="model, whole run")
        levels.set_title(_plain(f"{name}: axial RMS, g"), loc="left")
        percent = 100.0 * _finite(seen.relative_error)
        errors.plot(middle, percent, "o-", color="#333333", markersize=3, linewidth=1.0)
        errors.set_title(_plain(f"{name}: relative error, %"), loc="left")
        _from_zero(levels, seen.field_rms / G, np.array([axis.model.rms / G]))
        _from_zero(errors, percent)
    for panel in rows[-1]:
        panel.set_xlabel("s")
    figure.legend(*rows[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False)
    return figure


def _from_zero(panel: Axes, *values: Array) -> None:
    """Scale from zero to a little above the highest value, and tidy."""
    known = np.concatenate(values)
    panel.set_ylim(0.0, 1.1 * float(np.max(known, where=np.isfinite(known), initial=0.0)) or 1.0)
    _tidy(panel)


def _finite(values: Array) -> Array:
    return np.where(np.isfinite(values), values, np.nan)


def _plain(text: str) -> str:
    """Text of others that matplotlib must not read as mathematics."""
    return text.replace("$", r"\$")


def _tidy(panel: Axes) -> None:
    """Quiet axes: no box, faint horizontal lines."""
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(axis="y", color="#e3e7ec", linewidth=0.8)
    panel.set_axisbelow(True)
