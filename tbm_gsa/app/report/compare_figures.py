"""Figures of the comparison page: the result of a comparison → matplotlib figures."""

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tbm_gsa.app.report.picture import tidy
from tbm_gsa.comparison.results import (
    AxisResult,
    ComparisonResult,
    ExpectedLine,
    LineKind,
    SpectrumResult,
    WindowColumns,
)
from tbm_gsa.signals.reduction import Series
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.units import STANDARD_GRAVITY

# Of Okabe and Ito, told apart by colour-blind readers too.
FIELD: Final = "#D55E00"
MODEL: Final = "#0072B2"
LINE_COLOURS: Final[dict[LineKind, str]] = {
    "load": "#555555",
    "mesh": "#CC79A7",
    "sideband": "#E8C4D8",
    "shaft": "#E69F00",
    "axial": "#009E73",
}
LINE_NAMES: Final[dict[LineKind, str]] = {
    "load": "lines of the loads",
    "mesh": "gear meshes",
    "sideband": "their sidebands",
    "shaft": "shafts",
    "axial": "axial modes",
}
AXIS_NAMES: Final = {"x": "axial, x", "y": "lateral, y", "z": "vertical, z", "yz": "across, √(y² + z²)"}
WIDTH: Final = 12.0
_OUTSIDE: Final = "#b5bcc5"
SPECTRUM_COLUMNS: Final = 1000
DECADES: Final = 7


def time_series(field: Series, model: Series) -> Figure:
    """Figure of a second of the axial acceleration, field above model, on one scale."""
    figure = Figure(figsize=(WIDTH, 4.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(2, 1, sharex=True, sharey=True))
    for panel, (name, series, colour) in zip(
        panels, (("measured", field, FIELD), ("model", model, MODEL)), strict=True
    ):
        panel.plot(series.time, series.values / STANDARD_GRAVITY, color=colour, linewidth=0.7)
        panel.set_title(name, loc="left", color=colour)
        panel.set_ylabel("g")
        panel.margins(x=0.0)
        tidy(panel)
    panels[-1].set_xlabel("s")
    return figure


def spectra(result: ComparisonResult) -> Figure:
    """Axial power spectral densities with their 95 % bands, one panel per point, and the expected lines."""
    figure = Figure(figsize=(WIDTH, 0.5 + 2.1 * len(result.points)), layout="constrained")
    panels: list[Axes] = list(figure.subplots(len(result.points), 1, squeeze=False, sharex=True)[:, 0])
    highest = max(band.high_hz for band in result.bands.values())
    for panel, (name, axes) in zip(panels, result.spectra.items(), strict=True):
        top = 0.0
        for label, side, colour in (("measured", axes["x"].field, FIELD), ("model", axes["x"].model, MODEL)):
            frequency, density = _envelope(side)
            low, high = side.interval_factors
            panel.fill_between(frequency, low * density, high * density, color=colour, alpha=0.2, linewidth=0.0)
            panel.plot(frequency, density, color=colour, linewidth=0.8, label=label)
            top = max(top, float(density.max()))
        if top > 0.0:
            panel.set_yscale("log")
            panel.set_ylim(top * 10.0**-DECADES, 3.0 * top)
        _mark_lines(panel, result.expected_lines, highest)
        panel.set_title(plain_text(name), loc="left")
        panel.set_ylabel("g²/Hz")
        tidy(panel)
    panels[-1].set_xlim(0.0, highest)
    panels[-1].set_xlabel("Hz")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=7, frameon=False)
    return figure


def _mark_lines(panel: Axes, lines: Sequence[ExpectedLine], highest_hz: float) -> None:
    for kind, colour in LINE_COLOURS.items():
        inside = [line.frequency_hz for line in lines if line.kind == kind and line.frequency_hz <= highest_hz]
        for number, frequency in enumerate(inside):
            label = None if number else LINE_NAMES[kind]
            panel.axvline(
                frequency, color=colour, linewidth=0.9, linestyle=(0, (4, 3)), alpha=0.7, zorder=0, label=label
            )


def _envelope(spectrum: SpectrumResult) -> tuple[Array, Array]:
    """Highest values of neighbouring bins in g²/Hz, so that a long spectrum stays small and keeps its lines."""
    density = _array(spectrum.density) / STANDARD_GRAVITY**2
    size = -(-len(density) // SPECTRUM_COLUMNS)
    count = len(density) // size
    blocks = density[: count * size].reshape(count, size)
    strongest = blocks.argmax(axis=1) + size * np.arange(count)
    return strongest * spectrum.resolution_hz, blocks.max(axis=1)


def power_flow(result: ComparisonResult) -> Figure:
    """RMS at the points along the power flow, one panel per direction."""
    axes = [axis for axis in AXIS_NAMES if any(axis in point for point in result.points.values())]
    figure = Figure(figsize=(WIDTH, 3.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, len(axes), squeeze=False)[0])
    place = np.arange(len(result.points), dtype=np.float64)
    for panel, axis in zip(panels, axes, strict=True):
        compared = [point.get(axis) for point in result.points.values()]
        for offset, side, colour, label in ((-0.2, "field", FIELD, "measured"), (0.2, "model", MODEL, "model")):
            heights, errors = _bars(compared, side)
            panel.bar(place + offset, heights, 0.4, color=colour, label=label)
            panel.errorbar(place + offset, heights, errors, fmt="none", ecolor="#222222", elinewidth=1.0, capsize=3)
        panel.set_title(AXIS_NAMES[axis], loc="left")
        panel.set_xticks(place, [plain_text(name) for name in result.points], rotation=20)
        tidy(panel)
    panels[0].set_ylabel("RMS, g")
    panels[0].legend(frameon=False)
    return figure


def _bars(compared: Sequence[AxisResult | None], side: str) -> tuple[Array, Array]:
    """RMS values in g, (n,), and how far their intervals reach down and up, (2, n)."""
    values = _array(getattr(axis, f"{side}_rms", None) for axis in compared)
    ends = [getattr(axis.intervals, f"{side}_rms") if axis else None for axis in compared]
    limits = np.array([(np.nan, np.nan) if both is None else both for both in ends])
    reach = np.nan_to_num(np.abs(limits - values[:, None]).T)
    return values / STANDARD_GRAVITY, reach / STANDARD_GRAVITY


def windows(result: ComparisonResult) -> Figure:
    """Axial RMS and relative error of every window, one row per point; windows at no level of operation are grey."""
    figure = Figure(figsize=(WIDTH, 0.5 + 1.9 * len(result.points)), layout="constrained")
    rows = figure.subplots(len(result.points), 2, squeeze=False, sharex=True)
    for (levels, errors), (name, axes) in zip(rows, result.points.items(), strict=True):
        seen = axes["x"].windows
        start, breaks = _array(seen.start), _breaks(seen, result.window_s)
        model_rms = [result.model_rms(level, name, "x") for level in seen.level]
        field, model = (
            np.insert(_array(values) / STANDARD_GRAVITY, breaks, np.nan) for values in (seen.field_rms, model_rms)
        )
        middle = np.insert(start, breaks, np.nan) + result.window_s / 2.0
        inside = np.where(np.insert([level is None for level in seen.level], breaks, True), np.nan, field)
        percent = np.insert(100.0 * _array(seen.relative_error), breaks, np.nan)
        dot = 3.0 if len(middle) <= 100 else 1.0  # many do not run together
        levels.plot(middle, field, "-", color=_OUTSIDE, linewidth=0.8)
        levels.plot(middle, inside, "o-", color=FIELD, markersize=dot, linewidth=1.0, label="measured")
        levels.plot(middle, model, "--", color=MODEL, linewidth=1.0, label="model, whole run at the level")
        levels.set_title(plain_text(f"{name}: axial RMS, g"), loc="left")
        errors.plot(middle, percent, "o-", color="#333333", markersize=dot, linewidth=1.0)
        errors.set_title(plain_text(f"{name}: relative error, %"), loc="left")
        _from_zero(levels, field, _array([axes["x"].model_rms_g]))
        _from_zero(errors, percent)
    for panel in rows[-1]:
        panel.set_xlabel("s")
    figure.legend(*rows[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False)
    return figure


def _breaks(seen: WindowColumns, length_s: float) -> Integers:
    """Places of the windows that begin behind a hole, at which no line goes on."""
    return np.flatnonzero(np.diff(_array(seen.start)) > 1.5 * length_s) + 1


def _array(values: Iterable[float | None]) -> Array:
    """Numbers as an array, NaN where one is not defined."""
    return np.array(list(values), dtype=np.float64)


def _from_zero(panel: Axes, *values: Array) -> None:
    """Scale from zero to a little above the highest value, and tidy."""
    known = np.concatenate(values)
    panel.set_ylim(0.0, 1.1 * float(np.max(known, where=np.isfinite(known), initial=0.0)) or 1.0)
    tidy(panel)


def plain_text(text: str) -> str:
    """Text of others that matplotlib must not read as mathematics."""
    return text.replace("$", r"\$")
