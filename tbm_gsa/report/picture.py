"""Figures as files: what may be written, and how."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Final

from matplotlib import rc_context
from matplotlib.figure import Figure

from tbm_gsa.errors import InputError
from tbm_gsa.files import check_folder, write_whole

FORMATS: Final = (".png", ".svg")


def check_path(path: Path) -> None:
    """Raise unless a picture can be written to a path.

    Raises
    ------
    InputError
        Another format, or no such folder.
    """
    if path.suffix not in FORMATS:
        raise InputError(f"{path}: unknown kind of picture, allowed: a name that ends in {' or '.join(FORMATS)}")
    check_folder(path)


def write_picture(draw: Callable[[], Figure], path: Path) -> None:
    """Draw a figure into a .png or .svg file; equal figures give equal files."""
    check_path(path)
    # Fixed salt and no date. Names of others are no mathematics, which a text is told when it is made.
    with rc_context({"svg.hashsalt": "tbm_monitor", "text.parse_math": False}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")  # it draws a box
        drawn = BytesIO()
        metadata = {"Date": None} if path.suffix == ".svg" else None
        draw().savefig(drawn, format=path.suffix.removeprefix("."), dpi=150, metadata=metadata)
    write_whole(path, drawn.getvalue())
