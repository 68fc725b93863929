"""Table 1 and Figure 4: the loads on the cutterhead."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class LoadRow:
    """A row of Table 1.

    Attributes
    ----------
    name : str
    mean : float
        Magnitude, N or N·m.
    regions : tuple of (float, float)
        Main frequency regions, Hz.
    lines : tuple of float
        Typical frequencies, Hz.
    """

    name: str
    mean: float
    regions: tuple[tuple[float, float], ...]
    lines: tuple[float, ...]


_NARROW = ((0.0, 10.0), (125.0, 135.0))
_WIDE = ((0.0, 20.0), (100.0, 110.0), (200.0, 210.0))

TABLE_1: Final = {
    "fx": LoadRow("axial force", 1.20e7, _NARROW, (0.9, 130.3)),
    "fy": LoadRow("horizontal force", 30.91e3, _WIDE, (0.9, 106.2, 204.5)),
    "fz": LoadRow("vertical force", 34.84e3, _NARROW, (0.9, 130.3)),
    "mx": LoadRow("torque", 3.04e6, _NARROW, (0.9, 130.3)),
    "my": LoadRow("horizontal moment", 9.77e5, _NARROW, (0.9, 130.3)),
    "mz": LoadRow("vertical moment", 8.27e5, _WIDE, (0.9, 104.0, 205.7)),
}

CUTTERS: Final = {"centre": 4, "face": 32, "gauge": 11}
"""Figure 4 (left): disc cutters of each type."""
HEAD_DIAMETER_M: Final = 7.93
