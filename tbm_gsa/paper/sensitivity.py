"""Figures 11 to 15: main parameters, their shares, and what the response does along them."""

from typing import Final

MAIN: Final[dict[str, tuple[str, ...]]] = {
    "RDef_A": ("x3", "x16", "x18", "x19", "x22"),
    "PAcc_A": ("x4",),
    "PAcc_L": ("x1", "x2", "x11", "x23", "x24"),
    "PAcc_R": ("x2",),
    "MF_M": ("x2",),
    "MF_Se": ("x11",),
}
"""Main parameters by output, in the order of their codes."""

SHARES: Final[dict[tuple[str, str], float]] = {
    ("PAcc_A", "x4"): 0.8,
    ("PAcc_R", "x2"): 0.6,
    ("MF_M", "x2"): 1.0,
    ("MF_Se", "x11"): 0.8,
}
""""About" 80, 60 and 80 %; MF_M is "only sensitive to" x2."""

LOADS: Final = ("x1", "x2", "x3")
STIFFNESSES: Final = tuple(f"x{number}" for number in range(16, 26))
DISPLACEMENTS: Final = ("RDef_A", "RDef_L", "RDef_R")
"""Figure 11: loads and connecting stiffnesses are the main parameters of these."""

TRENDS: Final[dict[str, dict[str, int]]] = {
    "RDef_A": {"x3": 1, "x16": -1, "x18": -1, "x19": -1, "x22": -1},
    "PAcc_L": {"x1": 1, "x2": 1, "x11": -1, "x23": -1, "x24": -1},
    "MF_M": {"x2": 1},
    "MF_Se": {"x2": 1, "x11": 1, "x20": 1},
}
"""Figures 12 (RDef_A, PAcc_L) and 15 (MF): 1 where the output rises with the input, -1 where it falls."""

SHOWN_WITHOUT_STATEMENT: Final = ("MF_M", "x8"), ("MF_Se", "x8")
"""Figure 15 shows these; the text says nothing of them."""

FIGURE_OF: Final = {
    "RDef_A": "Figure 11",
    "RDef_L": "Figure 11",
    "RDef_R": "Figure 11",
    "PAcc_A": "Figure 13",
    "PAcc_L": "Figure 13",
    "PAcc_R": "Figure 13",
    "MF_M": "Figure 14",
    "MF_Se": "Figure 14",
}
CURVES_OF: Final = {"RDef_A": "Figure 12", "PAcc_L": "Figure 12", "MF_M": "Figure 15", "MF_Se": "Figure 15"}
