"""Figure of the drives of a comparison: shares and fluctuation of their torques, measured and computed."""

from collections.abc import Iterable
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tbm_gsa.app.report.compare_figures import FIELD, MODEL, WIDTH
from tbm_gsa.app.report.picture import tidy
from tbm_gsa.comparison.drive_results import DrivesResult
from tbm_msgs_py.base.arrays import Array

_PANELS: Final = {"share": "share of the mean torque", "fluctuation": "RMS of the torque by its mean"}


def drive_figure(drives: DrivesResult) -> Figure:
    """Bars of every drive, field beside model, one panel for the shares and one for the fluctuation."""
    figure = Figure(figsize=(WIDTH, 2.8), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, len(_PANELS), squeeze=False)[0])
    place = np.arange(len(drives.drives), dtype=np.float64)
    for panel, (quantity, title) in zip(panels, _PANELS.items(), strict=True):
        for offset, side, colour, label in ((-0.2, "field", FIELD, "measured"), (0.2, "model", MODEL, "model")):
            heights = _array(getattr(getattr(drive, side), quantity) for drive in drives.drives.values())
            panel.bar(place + offset, heights, 0.4, color=colour, label=label)
        panel.set_title(title, loc="left")
        panel.set_xticks(place, [name.removeprefix("drive_") for name in drives.drives])
        panel.set_xlabel("drive")
        tidy(panel)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False)
    return figure


def _array(values: Iterable[float | None]) -> Array:
    return np.array([np.nan if value is None else value for value in values])
