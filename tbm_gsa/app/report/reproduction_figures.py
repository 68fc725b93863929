"""Figures 3, 5, 12 and 15 of the paper; the others are those of the pages they belong to."""

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tbm_gsa.app.report.compare_figures import MODEL
from tbm_gsa.app.report.gsa_figures import make_panels, output_unit
from tbm_gsa.app.report.picture import PALETTE, thinned, tidy
from tbm_gsa.paper.published import TRENDS
from tbm_gsa.paper.reproduction.model import MeshCurves
from tbm_gsa.paper.reproduction.response import Excerpt
from tbm_gsa.sensitivity.study.curves import Curve
from tbm_gsa.sensitivity.study.inputs import InputSet

PINIONS_SHOWN = 3


def mesh_figure(curves: MeshCurves) -> Figure:
    """Mesh stiffness and error of the first pinions over a few mesh cycles."""
    figure, panels = make_panels(2, height=2.8)
    time = 1e3 * curves.cycles / curves.frequency
    quantities = ((curves.stiffness / 1e9, "stiffness, GN/m"), (1e6 * curves.error, "error, µm"))
    for panel, (values, title) in zip(panels, quantities, strict=True):
        for pinion in range(min(PINIONS_SHOWN, values.shape[1])):
            panel.plot(time, values[:, pinion], color=PALETTE[pinion], linewidth=1.0, label=f"pinion {pinion + 1}")
        panel.set_title(f"mesh {title}", loc="left")
        panel.set_xlabel("ms")
        panel.margins(x=0.0)
    panels[1].legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def line_figure(acceleration: Excerpt, force: Excerpt, lines: Sequence[float], mesh_lines: Sequence[float]) -> Figure:
    """Axial acceleration at the cutterhead and force of the first mesh, over time and frequency."""
    figure = Figure(figsize=(12.0, 5.2), layout="constrained")
    rows = figure.subplots(2, 2, gridspec_kw={"width_ratios": (1.0, 1.2)})
    for (left, right), excerpt, title, marked in (
        (rows[0], acceleration, "axial acceleration at the cutterhead, g", lines),
        (rows[1], force, "force of the first mesh, kN", mesh_lines),
    ):
        left.plot(*thinned(excerpt.time, excerpt.values), color=MODEL, linewidth=0.6)
        left.set_title(title, loc="left")
        _spectrum(right, excerpt, marked)
        for panel in (left, right):
            panel.margins(x=0.0)
            tidy(panel)
    rows[1, 0].set_xlabel("s")
    rows[1, 1].set_xlabel("Hz")
    return figure


def _spectrum(panel: Axes, excerpt: Excerpt, marked: Sequence[float]) -> None:
    for frequency in marked:
        panel.axvline(frequency, color=PALETTE[1], linewidth=0.8, linestyle=":", zorder=0)
    panel.semilogy(*thinned(excerpt.frequency[1:], excerpt.amplitude[1:]), color=MODEL, linewidth=0.7)
    top = float(excerpt.amplitude[1:].max())
    panel.set_ylim(1e-4 * top, 2.0 * top)
    panel.set_title("amplitude; dotted: lines looked for", loc="left")


def trend_figure(curves: Mapping[tuple[str, str], Curve], names: Sequence[str], inputs: InputSet) -> Figure:
    """Response of outputs along the inputs that the paper shows, each scaled to its range."""
    figure, panels = make_panels(len(names), height=3.2)
    for panel, name in zip(panels, names, strict=True):
        shown = [(code, curve) for (of, code), curve in curves.items() if of == name]
        for (code, curve), colour in zip(shown, PALETTE, strict=False):
            item = inputs[code]
            place = (curve.values - item.lower) / (item.upper - item.lower)
            dash = "-" if code in TRENDS[name] else "--"
            panel.plot(place, curve.response, dash, color=colour, label=f"{code} {item.symbol}")
        panel.set_title(f"{name}, {output_unit(name)}", loc="left")
        panel.set_xlabel("place in the input's range, lower (0) to upper (1) bound")
        panel.margins(x=0.0)
        panel.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
