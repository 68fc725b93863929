"""Which input moves which part of a spectrum: a map of total indices, frequency by input."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tbm_gsa.app.report.spectrum_figures import LINE_COLOURS, LINE_NAMES
from tbm_gsa.comparison.results import ExpectedLine
from tbm_gsa.sensitivity.results import SpectrumResult
from tbm_gsa.sensitivity.study.inputs import InputSet

SHOWN: Final = 12
NOMINAL: Final = (1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0)
"""Midbands of a decade as people name them, IEC 61260-1."""
DRAWN: Final = 0.005
WRITTEN: Final = 0.05
"""Index from which on it is drawn, and from which on it is written into its cell."""
LEFT_OUT: Final = "#eef0f3"


def spectrum_maps(spectra: Mapping[str, SpectrumResult], inputs: InputSet, lines: Sequence[ExpectedLine]) -> Figure:
    """Total index of the strongest inputs by band, one panel a spectrum, and expected lines as ticks at its top.

    Parameters
    ----------
    spectra : mapping of str to SpectrumResult
        At least one.
    inputs : InputSet
    lines : sequence of ExpectedLine
        Of the machine that is studied, where they are known.
    """
    shown = {name: _strongest(spectrum) for name, spectrum in spectra.items()}
    heights = [1.4 + 0.26 * len(codes) for codes in shown.values()]
    figure = Figure(figsize=(12.0, sum(heights)), layout="constrained")
    panels: list[Axes] = list(figure.subplots(len(spectra), 1, squeeze=False, height_ratios=heights)[:, 0])
    for panel, (name, codes) in zip(panels, shown.items(), strict=True):
        panel.set_title(name, loc="left", pad=14.0)
        panel.set_facecolor(LEFT_OUT)
        panel.spines[:].set_visible(False)
        _cells(panel, spectra[name], codes)
        panel.set_yticks(range(len(codes)), [f"{code} {inputs[code].symbol}" for code in codes])
        panel.set_ylim(len(codes) - 0.5, -0.5)
        panel.tick_params(axis="y", length=0.0)
        _frequencies(panel, spectra[name])
        _mark_lines(panel, lines)
    named = {label: tick for panel in panels for tick, label in zip(*panel.get_legend_handles_labels(), strict=True)}
    if named:
        kinds = list(named)
        figure.legend(named.values(), kinds, loc="outside upper right", ncols=len(kinds), frameon=False, fontsize=8)
    return figure


def _strongest(spectrum: SpectrumResult) -> list[str]:
    """Codes of the inputs with the largest total index in any band that is determined, largest first."""
    bands = [band.total for band in spectrum.bands if band.determined] or [spectrum.total]
    largest = {code: max(total[code] for total in bands) for code in spectrum.total}
    return sorted(largest, key=largest.__getitem__, reverse=True)[:SHOWN]


def _cells(panel: Axes, spectrum: SpectrumResult, codes: Sequence[str]) -> None:
    """Draw the indices, from `WRITTEN` on as figures too; what is not determined is hatched."""
    cells, values = [], []
    for band in spectrum.bands:
        low, width, middle = band.low, band.high - band.low, np.sqrt(band.low * band.high)
        whole = Rectangle((low, -0.5), width, len(codes), facecolor="white", edgecolor="#b4bcc6", linewidth=0.0)
        whole.set_hatch("" if band.determined else "///")
        panel.add_patch(whole)
        shown = [(row, band.total[code]) for row, code in enumerate(codes) if band.total[code] >= DRAWN]
        for row, index in shown if band.determined else []:
            cells.append(Rectangle((low, row - 0.5), width, 1.0))
            values.append(index)
            if index >= WRITTEN:
                colour = "white" if index > 0.5 else "#1c2530"
                panel.text(middle, row, f"{index:.2f}", ha="center", va="center", fontsize=7, color=colour)
    drawn = PatchCollection(cells, cmap="Blues", norm=Normalize(0.0, 1.0), edgecolor="white", linewidth=0.5)
    drawn.set_array(values)
    panel.add_collection(drawn)


def _frequencies(panel: Axes, spectrum: SpectrumResult) -> None:
    """Logarithmic axis with the nominal midbands."""
    panel.set_xscale("log")
    panel.set_xlim(spectrum.bands[0].low, spectrum.bands[-1].high)
    middles = [np.sqrt(band.low * band.high) for band in spectrum.bands]
    decades = [divmod(round(10.0 * np.log10(middle)), len(NOMINAL)) for middle in middles]
    panel.set_xticks(middles, [f"{NOMINAL[k] * 10**decade:g}" for decade, k in decades], fontsize=8)
    panel.minorticks_off()
    panel.set_xlabel("third octave around (Hz)")


def _mark_lines(panel: Axes, lines: Sequence[ExpectedLine]) -> None:
    """Draw a tick above the map at every expected line."""
    low, high = panel.get_xlim()
    for kind, colour in LINE_COLOURS.items():
        inside = [line.frequency_hz for line in lines if line.kind == kind and low <= line.frequency_hz <= high]
        if inside:
            panel.vlines(
                inside,
                1.01,
                1.05,
                transform=panel.get_xaxis_transform(),
                color=colour,
                linewidth=1.2,
                clip_on=False,
                label=LINE_NAMES[kind],
            )
