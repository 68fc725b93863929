"""Figures of the comparison page: a comparison → matplotlib figures."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tbm_gsa.comparison.expected import ExpectedLine, Kind
from tbm_gsa.comparison.offline import Comparison, PointComparison
from tbm_gsa.signals.estimates import SignalStatistics
from tbm_gsa.signals.statistics import Spectrum
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.units import STANDARD_GRAVITY

# Of Okabe and Ito, told apart by colour-blind readers too.
FIELD: Final = "#D55E00"
MODEL: Final = "#0072B2"
LINE_COLOURS: Final[dict[Kind, str]] = {"load": "#555555", "mesh": "#CC79A7", "axial": "#009E73"}
LINE_NAMES: Final[dict[Kind, str]] = {"load": "lines of the loads", "mesh": "mesh frequency", "axial": "axial modes"}
AXIS_NAMES: Final = {"x": "axial, x", "y": "lateral, y", "z": "vertical, z", "yz": "across, √(y² + z²)"}
WIDTH: Final = 12.0
_OUTSIDE: Final = "#b5bcc5"
SPECTRUM_COLUMNS: Final = 1000
DECADES: Final = 7


def time_series(point: PointComparison) -> Figure:
    """Draw a second of the axial acceleration, field above model, on one scale."""
    figure = Figure(figsize=(WIDTH, 4.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(2, 1, sharex=True, sharey=True))
    sides = (("measured", point.field.excerpt, FIELD), ("model", point.model.excerpt, MODEL))
    for panel, (name, series, colour) in zip(panels, sides, strict=True):
        panel.plot(series.time, series.values / STANDARD_GRAVITY, color=colour, linewidth=0.7)
        panel.set_title(name, loc="left", color=colour)
        panel.set_ylabel("g")
        panel.margins(x=0.0)
        tidy(panel)
    panels[-1].set_xlabel("s")
    return figure


def spectra(comparison: Comparison, lines: Sequence[ExpectedLine]) -> Figure:
    """Axial power spectral densities with their 95 % bands, one panel per point, and the expected lines."""
    points = comparison.points
    figure = Figure(figsize=(WIDTH, 0.5 + 2.1 * len(points)), layout="constrained")
    panels: list[Axes] = list(figure.subplots(len(points), 1, squeeze=False, sharex=True)[:, 0])
    highest = max(point.band.high for point in points.values())
    for panel, (name, point) in zip(panels, points.items(), strict=True):
        axis = point.axes["x"]
        for label, side, colour in (("measured", axis.field, FIELD), ("model", axis.model, MODEL)):
            frequency, density = _envelope(side.spectrum)
            low, high = side.density_factors
            panel.fill_between(frequency, low * density, high * density, color=colour, alpha=0.2, linewidth=0.0)
            panel.plot(frequency, density, color=colour, linewidth=0.8, label=label)
        top = max(float(side.spectrum.density.max()) for side in (axis.field, axis.model)) / STANDARD_GRAVITY**2
        if top > 0.0:
            panel.set_yscale("log")
            panel.set_ylim(top * 10.0**-DECADES, 3.0 * top)
        _mark_lines(panel, lines, highest)
        panel.set_title(plain_text(name), loc="left")
        panel.set_ylabel("g²/Hz")
        tidy(panel)
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
    return np.take_along_axis(frequency, strongest, axis=1)[:, 0], blocks.max(axis=1) / STANDARD_GRAVITY**2


def power_flow(comparison: Comparison) -> Figure:
    """RMS at the points along the power flow, one panel per direction: the paper's Figure 7b."""
    points = comparison.points
    axes = [axis for axis in AXIS_NAMES if any(axis in point.axes for point in points.values())]
    figure = Figure(figsize=(WIDTH, 3.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, len(axes), squeeze=False)[0])
    place = np.arange(len(points), dtype=np.float64)
    for panel, axis in zip(panels, axes, strict=True):
        compared = [point.axes.get(axis) for point in points.values()]
        for offset, side, colour, label in ((-0.2, "field", FIELD, "measured"), (0.2, "model", MODEL, "model")):
            statistics = [None if item is None else getattr(item, side) for item in compared]
            heights, errors = _bars(statistics)
            panel.bar(place + offset, heights, 0.4, color=colour, label=label)
            panel.errorbar(place + offset, heights, errors, fmt="none", ecolor="#222222", elinewidth=1.0, capsize=3)
        panel.set_title(AXIS_NAMES[axis], loc="left")
        panel.set_xticks(place, [plain_text(name) for name in points], rotation=20)
        tidy(panel)
    panels[0].set_ylabel("RMS, g")
    panels[0].legend(frameon=False)
    return figure


def _bars(statistics: Sequence[SignalStatistics | None]) -> tuple[Array, Array]:
    """RMS values in g, (n,), and how far their intervals reach down and up, (2, n)."""
    values = np.array([np.nan if item is None else item.rms for item in statistics])
    limits = np.array([(np.nan, np.nan) if item is None else item.intervals["rms"] for item in statistics])
    reach = np.nan_to_num(np.abs(limits - values[:, None]).T)
    return values / STANDARD_GRAVITY, reach / STANDARD_GRAVITY


def windows(comparison: Comparison) -> Figure:
    """Axial RMS and relative error of every window, one row per point; windows at no level of operation are grey."""
    points = comparison.points
    figure = Figure(figsize=(WIDTH, 0.5 + 1.9 * len(points)), layout="constrained")
    rows = figure.subplots(len(points), 2, squeeze=False, sharex=True)
    for (levels, errors), (name, point) in zip(rows, points.items(), strict=True):
        axis = point.axes["x"]
        seen = axis.windows
        middle = seen.start + comparison.window_s / 2.0
        levels.plot(middle, seen.field_rms / STANDARD_GRAVITY, "-", color=_OUTSIDE, linewidth=0.8)
        inside = np.where(seen.level >= 0, seen.field_rms, np.nan)
        levels.plot(
            middle,
            inside / STANDARD_GRAVITY,
            "o-",
            color=FIELD,
            markersize=_dot(len(middle)),
            linewidth=1.0,
            label="measured",
        )
        model = np.array([axis.levels[one].model.rms if one in axis.levels else np.nan for one in seen.level.tolist()])
        levels.plot(
            middle,
            model / STANDARD_GRAVITY,
            color=MODEL,
            linewidth=1.0,
            linestyle="--",
            label="model, whole run at the level",
        )
        levels.set_title(plain_text(f"{name}: axial RMS, g"), loc="left")
        percent = 100.0 * _finite(seen.relative_error)
        errors.plot(middle, percent, "o-", color="#333333", markersize=_dot(len(middle)), linewidth=1.0)
        errors.set_title(plain_text(f"{name}: relative error, %"), loc="left")
        _from_zero(levels, seen.field_rms / STANDARD_GRAVITY, np.array([axis.model.rms / STANDARD_GRAVITY]))
        _from_zero(errors, percent)
    for panel in rows[-1]:
        panel.set_xlabel("s")
    figure.legend(*rows[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False)
    return figure


def _dot(count: int) -> float:
    """Size of a dot, so that many do not run into one another."""
    return 3.0 if count <= 100 else 1.0


def _from_zero(panel: Axes, *values: Array) -> None:
    """Scale from zero to a little above the highest value, and tidy."""
    known = np.concatenate(values)
    panel.set_ylim(0.0, 1.1 * float(np.max(known, where=np.isfinite(known), initial=0.0)) or 1.0)
    tidy(panel)


def _finite(values: Array) -> Array:
    return np.where(np.isfinite(values), values, np.nan)


def plain_text(text: str) -> str:
    """Text of others that matplotlib must not read as mathematics."""
    return text.replace("$", r"\$")


def tidy(panel: Axes) -> None:
    """Quiet axes: no box, faint horizontal lines."""
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(axis="y", color="#e3e7ec", linewidth=0.8)
    panel.set_axisbelow(True)
