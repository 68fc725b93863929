"""Figures: their axes, and how they become files, and which may be written."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.files import check_result, write_whole

FORMATS: Final = (".png", ".svg")
PALETTE: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Of Okabe and Ito, told apart by colour-blind readers too."""
PNG_DPI: Final = 150
LINE_COLUMNS: Final = 400
"""Parts of a line across half a page, each about a point wide."""


def check_path(path: Path) -> None:
    """Raise unless a picture can be written to a path.

    Raises
    ------
    InputError
        Another format, no such folder, or something else is there.
    """
    if path.suffix not in FORMATS:
        raise InputError(f"{path}: unknown kind of picture, allowed: a name that ends in {' or '.join(FORMATS)}")
    check_result(path, f"{path.suffix[1:].upper()} picture")


def write_picture(draw: Callable[[], Figure], path: Path) -> None:
    """Draw a figure into a .png or .svg file; equal figures give equal files."""
    check_path(path)
    # Names of others are no mathematics; a text reads this setting when it is made.
    with rc_context({"text.parse_math": False}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")  # it draws a box
        content = drawn(draw(), path.suffix)
    write_whole(path, content)


def drawn(figure: Figure, kind: str) -> bytes:
    """Draw a figure as one of `FORMATS`; equal figures give equal bytes.

    Not by way of `savefig`, which draws a figure with a layout twice, the first time for the layout alone.
    """
    buffer = BytesIO()
    if kind == ".png":
        figure.set_dpi(PNG_DPI)
        FigureCanvasAgg(figure).print_png(buffer)  # type: ignore[no-untyped-call]
    else:
        with rc_context({"svg.hashsalt": "tbm_monitor"}):  # fixed salt and no date
            FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def thinned(place: Array, values: Array) -> tuple[Array, Array]:
    """Lowest and highest point of each of `LINE_COLUMNS` parts of a long line (n,), which is drawn alike with them."""
    size = -(-len(values) // LINE_COLUMNS)
    if size <= 2:
        return place, values
    count = len(values) // size
    parts = values[: count * size].reshape(count, size)
    ends = np.sort(np.column_stack([parts.argmin(axis=1), parts.argmax(axis=1)]), axis=1)
    kept = (ends + size * np.arange(count)[:, None]).ravel()
    return place[kept], values[kept]


def tidy(panel: Axes) -> None:
    """Quiet axes: no box, faint horizontal lines."""
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(axis="y", color="#e3e7ec", linewidth=0.8)
    panel.set_axisbelow(True)
