"""Where the disc cutters sit on the head: a CSV file of discs.

Columns ``cutter, type, radius_m, angle_deg, tilt_deg``; lines that begin with # are comments. The discs of a twin
cutter have its number in common. The angle counts from y towards z, the tilt from the axis of the head outwards.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Final

import numpy as np

from tbm_dynamics.loads.cutters.description import CutterError
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.files import read_text
from tbm_msgs_py.base.texts import LONGEST_NAME, listed, number_reader, quoted, shortened

COLUMNS: Final = ("cutter", "type", "radius_m", "angle_deg", "tilt_deg")
TYPES: Final = ("centre", "face", "gauge")
MOST_CUTTERS: Final = 1000

# Contact points nearer to each other than this are one place: a ring's tip is 10 to 20 mm wide.
_NEAREST = 0.03
_MOST_TILTED = 80.0
_DIGITS = 9  # of the number of a cutter
_PLAIN = number_reader()


@dataclass(frozen=True, eq=False)
class CutterLayout:
    """n discs.

    Attributes
    ----------
    cutter : (n,) ndarray of int
        Number of the cutter that each belongs to.
    kind : tuple of str
        "centre", "face" or "gauge".
    radius, angle, tilt : (n,) ndarray
        Of the contact point about the axis (m, rad), and of the disc's plane from it (rad).
    """

    cutter: Integers
    kind: tuple[str, ...]
    radius: Array
    angle: Array
    tilt: Array

    def count(self, kind: str) -> int:
        """Count the cutters of a kind."""
        return len({int(number) for number, each in zip(self.cutter, self.kind, strict=True) if each == kind})

    @property
    def spacing(self) -> Array:
        """Width of rock that each disc breaks, (n,) m: half the way to the tracks on both sides, along the face.

        The innermost track has itself across the axis for a neighbour, the outermost one as much outside as inside.
        """
        order = np.argsort(self.radius, kind="stable")
        tracks, tilt = self.radius[order], self.tilt[order]
        # The face bends back with the tilt: the way along it is longer than the radii differ.
        steps = np.diff(tracks) / np.cos(0.5 * (tilt[1:] + tilt[:-1]))
        inside = np.concatenate([[2.0 * tracks[0]], steps])
        outside = np.concatenate([steps, inside[-1:]])
        found = np.empty_like(tracks)
        found[order] = 0.5 * (inside + outside)
        return found


def read_layout(path: str | Path, head_radius: float) -> CutterLayout:
    """Read a layout of discs within a head; the name of a shipped machine stands for its layout.

    Raises
    ------
    CutterError
        A file that cannot be read, or what is wrong in which line and column.
    """
    name, text = _text(path)
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()[:1] not in ("", "#")]
    if not lines:
        raise CutterError(f"{name}: holds no cutter")
    header = tuple(cell.strip() for cell in lines[0][1].split(","))
    if header != COLUMNS:
        raise CutterError(f"{name}: line {lines[0][0]}: columns {listed(header)}; must be {', '.join(COLUMNS)}")
    if len(lines) > 1 + MOST_CUTTERS:
        raise CutterError(f"{name}: {len(lines) - 1} cutters; allowed are up to {MOST_CUTTERS}")
    rows = [_row(f"{name}: line {number}", line, head_radius) for number, line in lines[1:]]
    if not rows:
        raise CutterError(f"{name}: holds no cutter")
    _refuse_overlaps(name, [number for number, _ in lines[1:]], rows)
    cutter, kind, *places = zip(*rows, strict=True)
    radius, angle, tilt = (np.array(column, dtype=float) for column in places)
    return CutterLayout(np.array(cutter), kind, radius, np.radians(angle), np.radians(tilt))


def _text(path: str | Path) -> tuple[str, str]:
    shipped = resources.files("tbm_dynamics") / "machines" / f"{path}_cutters.csv"
    if Path(path).name == str(path) and shipped.is_file():
        return shipped.name, shipped.read_text("utf-8")
    try:
        return str(path), read_text(Path(path))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "no UTF-8 text"
        raise CutterError(f"{path}: {reason}") from None


def _row(where: str, line: str, head_radius: float) -> tuple[int, str, float, float, float]:
    try:
        cells = [cell.strip() for cell in next(csv.reader([line]))]
    except csv.Error as error:
        raise CutterError(f"{where}: {error}") from None
    if len(cells) != len(COLUMNS):
        raise CutterError(f"{where}: {len(cells)} cells; must be {len(COLUMNS)}: {', '.join(COLUMNS)}")
    if not cells[0].isascii() or not cells[0].isdecimal() or len(cells[0]) > _DIGITS:
        raise CutterError(f"{where}, column cutter: {quoted(cells[0])} is no number of a cutter")
    if cells[1] not in TYPES:
        raise CutterError(f"{where}, column type: {quoted(cells[1])}; allowed are {', '.join(TYPES)}")
    limits = ((0.0, head_radius), (-360.0, 360.0), (0.0, _MOST_TILTED))
    radius, angle, tilt = (
        _number(f"{where}, column {column}", cell, *allowed)
        for column, cell, allowed in zip(COLUMNS[2:], cells[2:], limits, strict=True)
    )
    return int(cells[0]), cells[1], radius, angle, tilt


def _number(where: str, cell: str, low: float, high: float) -> float:
    value = _PLAIN(cell)
    if value is None or not low <= value <= high:
        raise CutterError(
            f"{where}: {shortened(cell, LONGEST_NAME) or 'empty'}; allowed is a number from {low:g} to {high:g}"
        )
    return value


def _refuse_overlaps(name: str, numbers: list[int], rows: list[tuple[int, str, float, float, float]]) -> None:
    radius, angle = (np.array([row[column] for row in rows]) for column in (2, 3))
    place = radius * np.exp(1j * np.radians(angle))
    apart = np.abs(place[:, None] - place)
    np.fill_diagonal(apart, np.inf)
    if apart.size > 1 and apart.min() < _NEAREST:
        first, second = sorted(np.unravel_index(int(apart.argmin()), apart.shape))
        raise CutterError(
            f"{name}: lines {numbers[first]} and {numbers[second]}: discs of cutters {rows[first][0]} and "
            f"{rows[second][0]} are {apart.min() * 1e3:.0f} mm apart; at least {_NEAREST * 1e3:.0f} mm are needed"
        )
