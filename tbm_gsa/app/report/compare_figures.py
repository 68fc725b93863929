"""Figures of the comparison page over time and along the machine: the result of a comparison → matplotlib figures."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tbm_gsa.app.report.picture import tidy
from tbm_gsa.app.report.quantiles import quantiles
from tbm_gsa.comparison.results import AxisResult, ComparisonResult
from tbm_gsa.signals.reduction import Series
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.units import STANDARD_GRAVITY

# Of Okabe and Ito, told apart by colour-blind readers too.
FIELD: Final = "#D55E00"
MODEL: Final = "#0072B2"
AXIS_NAMES: Final = {"x": "axial, x", "y": "lateral, y", "z": "vertical, z", "yz": "across, √(y² + z²)"}
WIDTH: Final = 12.0
MOST_WINDOWS: Final = 600  # that are drawn one by one
PARTS: Final = 300
_OUTSIDE: Final = "#b5bcc5"


@dataclass(frozen=True)
class AccelerationUnit:
    """Unit of the accelerations of a page: its name, and how many m/s² it is."""

    name: str
    size: float


SI: Final = AccelerationUnit("m/s²", 1.0)
GRAVITY: Final = AccelerationUnit("g", STANDARD_GRAVITY)


def time_series(field: Series, model: Series, unit: AccelerationUnit = SI) -> Figure:
    """Figure of a second of the axial acceleration, field above model, on one scale."""
    figure = Figure(figsize=(WIDTH, 4.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(2, 1, sharex=True, sharey=True))
    for panel, (name, series, colour) in zip(
        panels, (("measured", field, FIELD), ("model", model, MODEL)), strict=True
    ):
        panel.plot(series.time, series.values / unit.size, color=colour, linewidth=0.7)
        panel.set_title(name, loc="left", color=colour)
        panel.set_ylabel(unit.name)
        panel.margins(x=0.0)
        tidy(panel)
    panels[-1].set_xlabel("s")
    return figure


def power_flow(result: ComparisonResult, unit: AccelerationUnit = SI) -> Figure:
    """RMS at the points along the power flow, one panel per direction."""
    axes = [axis for axis in AXIS_NAMES if any(axis in point for point in result.points.values())]
    figure = Figure(figsize=(WIDTH, 3.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, len(axes), squeeze=False)[0])
    place = np.arange(len(result.points), dtype=np.float64)
    for panel, axis in zip(panels, axes, strict=True):
        compared = [point.get(axis) for point in result.points.values()]
        for offset, side, colour, label in ((-0.2, "field", FIELD, "measured"), (0.2, "model", MODEL, "model")):
            heights, errors = (values / unit.size for values in _bars(compared, side))
            panel.bar(place + offset, heights, 0.4, color=colour, label=label)
            panel.errorbar(place + offset, heights, errors, fmt="none", ecolor="#222222", elinewidth=1.0, capsize=3)
        panel.set_title(AXIS_NAMES[axis], loc="left")
        panel.set_xticks(place, [plain_text(name) for name in result.points], rotation=20)
        tidy(panel)
    panels[0].set_ylabel(f"RMS, {unit.name}")
    panels[0].legend(frameon=False)
    return figure


def _bars(compared: Sequence[AxisResult | None], side: str) -> tuple[Array, Array]:
    """RMS values, m/s², (n,), and how far their intervals reach down and up, (2, n)."""
    values = _array(getattr(axis, f"{side}_rms", None) for axis in compared)
    ends = [getattr(axis.intervals, f"{side}_rms") if axis else None for axis in compared]
    limits = np.array([(np.nan, np.nan) if both is None else both for both in ends])
    reach = np.nan_to_num(np.abs(limits - values[:, None]).T)
    return values, reach


def windows(result: ComparisonResult) -> Figure:
    """Axial RMS and relative error of every window, one row per point; windows at no level of operation are grey.

    Of more than `MOST_WINDOWS` the medians of parts of the time, and 5 to 95 % of their windows.
    """
    figure = Figure(figsize=(WIDTH, 0.5 + 1.9 * len(result.points)), layout="constrained")
    rows = figure.subplots(len(result.points), 2, squeeze=False, sharex=True)
    for (levels, errors), (name, axes) in zip(rows, result.points.items(), strict=True):
        seen = axes["x"].windows
        row = _WindowRow(_array(seen.start) + result.window_s / 2.0, result.window_s)
        field, percent = _array(seen.field_rms), 100.0 * _array(seen.relative_error)
        model = _array(result.model_rms(level, name, "x") for level in seen.level)
        inside = np.where([level is None for level in seen.level], np.nan, field)
        row.draw(levels, field, _OUTSIDE, style="-")
        row.draw(levels, inside, FIELD, label="measured")
        row.draw(levels, model, MODEL, style="--", label="model, whole run at the level")
        levels.set_title(plain_text(f"{name}: axial RMS, m/s²"), loc="left")
        row.draw(errors, percent, "#333333")
        errors.set_title(plain_text(f"{name}: relative error, %"), loc="left")
        _from_zero(levels, field, _array([axes["x"].model_rms]))
        _from_zero(errors, percent)
    for panel in rows[-1]:
        panel.set_xlabel("s")
    figure.legend(*rows[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False)
    return figure


@dataclass(frozen=True, eq=False)
class _WindowRow:
    """Middles of windows (n,), s, and their length, s."""

    middle: Array
    length: float

    def draw(self, panel: Axes, values: Array, colour: str, *, style: str = "o-", label: str | None = None) -> None:
        """Draw values (n,) of the windows; a hole between windows breaks the line."""
        time, length = self.middle, self.length
        if len(time) > MOST_WINDOWS:
            edges = np.linspace(time[0], time[-1], PARTS + 1)
            found = quantiles(time, values, edges)
            time, (low, values, high) = found.time, found.values
            length = max(length, 2.0 * (edges[1] - edges[0]))
            if style == "o-":
                panel.fill_between(time, low, high, color=colour, alpha=0.25, linewidth=0.0)
        breaks = np.flatnonzero(np.diff(time) > 1.5 * length) + 1
        broken = np.insert(time, breaks, np.nan), np.insert(values, breaks, np.nan)
        size = 3.0 if len(time) <= 100 else 1.0  # many do not run together
        panel.plot(*broken, style, color=colour, markersize=size, linewidth=1.0, label=label)


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
