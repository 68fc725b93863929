"""Figures of the comparison page over frequency: spectra and spectrograms, with the lines that are expected."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final, TypeVar

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tbm_gsa.app.report.compare_figures import FIELD, MODEL, WIDTH, plain_text
from tbm_gsa.app.report.picture import tidy
from tbm_gsa.comparison.results import AxisResult, ComparisonResult, ExpectedLine, LineKind, SpectrumResult
from tbm_gsa.signals.spectrogram import Spectrogram
from tbm_msgs_py.base.arrays import Array

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
NAMED_KINDS: Final[tuple[LineKind, ...]] = ("load", "mesh", "axial", "shaft")
"""In this order where two are too close to be written side by side."""
SPECTRUM_COLUMNS: Final = 1000
BAND_COLUMNS: Final = 300
DECADES: Final = 7
PEAKS: Final = 4  # of each side, that are named
APART: Final = 0.013  # of the width, between two that are named
SHOWN_DB: Final = 70.0
One = TypeVar("One")
_COLOURS: Final = colormaps["viridis"].resampled(64)  # as many as its picture keeps


def spectra(result: ComparisonResult) -> Figure:
    """Axial power spectral densities with their 95 % bands, one panel per point; peaks and expected lines with theirs.

    Above the first panel the frequencies of expected lines; sidebands and those too close to another have none.
    """
    figure = Figure(figsize=(WIDTH, 0.9 + 2.1 * len(result.points)), layout="constrained")
    panels: list[Axes] = list(figure.subplots(len(result.points), 1, squeeze=False, sharex=True)[:, 0])
    highest = _highest(result)
    for panel, (name, axes) in zip(panels, result.spectra.items(), strict=True):
        top = 0.0
        for label, side, colour in (("measured", axes["x"].field, FIELD), ("model", axes["x"].model, MODEL)):
            low, high = side.interval_factors
            frequency, density = _envelope(side, BAND_COLUMNS)
            panel.fill_between(frequency, low * density, high * density, color=colour, alpha=0.2, linewidth=0.0)
            frequency, density = _envelope(side, SPECTRUM_COLUMNS)
            panel.plot(frequency, density, color=colour, linewidth=0.8, label=label)
            top = max(top, float(density.max()))
        if top > 0.0:
            panel.set_yscale("log")
            panel.set_ylim(top * 10.0**-DECADES, 10.0 * top)  # room for the names of peaks
        _mark_lines(panel, result.expected_lines, highest)
        _name_peaks(panel, result.points[name]["x"], axes["x"].field, axes["x"].model, highest)
        panel.set_title(plain_text(name), loc="left")
        panel.set_ylabel("(m/s²)²/Hz")
        tidy(panel)
    panels[-1].set_xlim(0.0, highest)
    panels[-1].set_xlabel("Hz")
    _name_lines(panels[0], result.expected_lines, highest)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=7, frameon=False)
    return figure


def spectrograms(result: ComparisonResult, found: Mapping[str, tuple[Spectrogram, Spectrogram]]) -> Figure:
    """Axial power over time and frequency, field beside model, a row a point; all on one scale of colours."""
    figure = Figure(figsize=(WIDTH, 0.6 + 1.7 * len(found)), layout="constrained")
    rows = figure.subplots(len(found), 2, squeeze=False, sharex="col", sharey=True)
    highest = _highest(result)
    strongest = max(float(np.nanmax(side.density, initial=0.0)) for sides in found.values() for side in sides)
    top = 10.0 * math.log10(strongest or 1.0)
    for panels, (name, sides) in zip(rows, found.items(), strict=True):
        for panel, side, title in zip(panels, sides, ("measured", "model"), strict=True):
            level, half = _decibels(side.density), side.resolution_hz / 2.0
            extent = (0.0, level.shape[1] * side.column_s, -half, level.shape[0] * side.resolution_hz - half)
            picture = panel.imshow(
                level,
                cmap=_COLOURS,
                vmin=top - SHOWN_DB,
                vmax=top,
                extent=extent,
                origin="lower",
                aspect="auto",
                interpolation="none",
            )
            panel.set_title(plain_text(f"{name}, {title}"), loc="left")
            panel.set_xlim(left=_begin(side))
            _tick_lines(panel, result.expected_lines, highest)
        panels[0].set_ylim(0.0, highest)
        panels[0].set_ylabel("Hz")
    for panel in rows[-1]:
        panel.set_xlabel("s")
    figure.colorbar(picture, ax=rows, label="dB over 1 (m/s²)²/Hz", pad=0.02, aspect=40)
    return figure


def lines_by_kind(lines: Iterable[ExpectedLine]) -> dict[str, list[ExpectedLine]]:
    """Sort expected lines from the lowest up, by the name of their kind."""
    ordered = sorted(lines, key=lambda line: line.frequency_hz)
    found = {LINE_NAMES[kind]: [line for line in ordered if line.kind == kind] for kind in LINE_NAMES}
    return {name: members for name, members in found.items() if members}


def _highest(result: ComparisonResult) -> float:
    return max(band.high_hz for band in result.bands.values())


def _begin(found: Spectrogram) -> float:
    """Begin of the first column with power, s: a run settles before."""
    return float(np.isfinite(found.density).any(axis=0).argmax()) * found.column_s


def _decibels(density: Array) -> Array:
    """10 lg of densities, -inf of no power, NaN where nothing was recorded."""
    with np.errstate(divide="ignore"):
        return np.asarray(10.0 * np.log10(density))


def _tick_lines(panel: Axes, lines: Sequence[ExpectedLine], highest_hz: float) -> None:
    """Mark expected lines at the right edge of a panel."""
    for kind, colour in LINE_COLOURS.items():
        inside = [line.frequency_hz for line in lines if line.kind == kind and line.frequency_hz <= highest_hz]
        ends = np.full((2, len(inside)), [[1.0], [1.02]])
        across = panel.get_yaxis_transform()
        panel.plot(ends, [inside, inside], color=colour, linewidth=1.2, transform=across, clip_on=False)


def _mark_lines(panel: Axes, lines: Sequence[ExpectedLine], highest_hz: float) -> None:
    for kind, colour in LINE_COLOURS.items():
        inside = [line.frequency_hz for line in lines if line.kind == kind and line.frequency_hz <= highest_hz]
        for number, frequency in enumerate(inside):
            label = None if number else LINE_NAMES[kind]
            panel.axvline(
                frequency, color=colour, linewidth=0.9, linestyle=(0, (4, 3)), alpha=0.7, zorder=0, label=label
            )


def _name_lines(panel: Axes, lines: Sequence[ExpectedLine], highest_hz: float) -> None:
    """Write the frequencies of expected lines above a panel, where there is room."""
    ordered = sorted(
        (line for line in lines if line.kind in NAMED_KINDS and line.frequency_hz <= highest_hz),
        key=lambda line: NAMED_KINDS.index(line.kind),
    )
    for line in _apart(ordered, [line.frequency_hz for line in ordered], highest_hz):
        panel.annotate(
            f"{line.frequency_hz:.1f}",
            (line.frequency_hz, 1.0),
            (0, 2),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            rotation=90,
            fontsize=7,
            ha="center",
            va="bottom",
            color=LINE_COLOURS[line.kind],
        )
    panel.set_title(panel.get_title(loc="left"), loc="left", pad=34)


def _name_peaks(panel: Axes, axis: AxisResult, field: SpectrumResult, model: SpectrumResult, highest_hz: float) -> None:
    """Write the frequencies of the strongest peaks of both sides at their tips."""
    named: list[tuple[float, float, str]] = []
    for lines, side, colour in ((axis.field_lines, field, FIELD), (axis.model_lines, model, MODEL)):
        density = _array(side.density)
        for line in lines[:PEAKS]:
            height = float(density[min(round(line.frequency_hz / side.resolution_hz), len(density) - 1)])
            if height > 0.0:
                named.append((line.frequency_hz, height, colour))
    named.sort(key=lambda one: -one[1])
    for frequency, height, colour in _apart(named, [one[0] for one in named], highest_hz, share=3.0 * APART):
        place = (frequency, height)
        panel.annotate(
            f"{frequency:.1f}", place, (0, 3), textcoords="offset points", fontsize=7, ha="center", color=colour
        )


def _apart(chosen: Sequence[One], places: Sequence[float], highest_hz: float, share: float = APART) -> list[One]:
    """Leave out what is too close to one before it."""
    kept: list[float] = []
    found = []
    for one, place in zip(chosen, places, strict=True):
        if all(abs(place - other) >= share * highest_hz for other in kept):
            kept.append(place)
            found.append(one)
    return found


def _envelope(spectrum: SpectrumResult, columns: int) -> tuple[Array, Array]:
    """Highest values of neighbouring bins, (m/s²)²/Hz, so that a long spectrum stays small and keeps its lines."""
    density = _array(spectrum.density)
    size = -(-len(density) // columns)
    count = len(density) // size
    blocks = density[: count * size].reshape(count, size)
    strongest = blocks.argmax(axis=1) + size * np.arange(count)
    return strongest * spectrum.resolution_hz, blocks.max(axis=1)


def _array(values: Iterable[float | None]) -> Array:
    """Numbers as an array, NaN where one is not defined."""
    return np.array(list(values), dtype=np.float64)
