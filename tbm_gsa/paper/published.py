"""Numbers and statements of the paper that results are held against: the one place that quotes them.

"Surrogate-Based Multisource Sensitivity Analysis of TBM Driving System" (2018), in its order. Table 4 is
`tbm_gsa.sensitivity.study.inputs.PAPER_INPUTS`, since a study needs it as inputs.
"""

from dataclasses import dataclass
from typing import Final

from tbm_dynamics.calibration.targets import PREDICTED_G

# Table 1 and Figure 4: the loads on the cutterhead.


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

    @property
    def unit(self) -> str:
        """Unit that it is shown in."""
        return "kN" if self.name.endswith("force") else "kN·m"


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

# Table 2 and Figures 2 and 5 to 7: vibration predicted and measured.


@dataclass(frozen=True)
class PointRow:
    """A row of Table 2: axial acceleration, RMS in g; the error is that of equation (4)."""

    node: int
    predicted_g: float
    measured_g: float
    relative_error: float


TABLE_2: Final = {
    "cutterhead": PointRow(3, PREDICTED_G["cutterhead"], 0.93, 0.18),
    "shield": PointRow(43, PREDICTED_G["shield"], 0.40, 0.40),
    "gripper": PointRow(50, PREDICTED_G["gripper"], 0.08, 0.50),
}

MARKED_NODES: Final = {"cutterhead": 3, "ring gear": 8, "first pinion": 14, "shield": 43, "gripper": 50}
"""Nodes that text and tables name by the numbers of Figure 2."""

SUBSYSTEMS: Final = ("cutterhead-bearing-gear", "driveshaft", "carrier-girder")
"""Figure 2."""

MEASURED_POINTS: Final = ("cutterhead", "shield", "walkway", "girder", "gripper")
"""Figure 6: where the wireless sensors sit."""

CUTTERHEAD_PEAK_G: Final = 4.0
"""Figure 7a: the acceleration at the cutterhead varies within about ± this."""

ACCELERATION_LINE_HZ: Final = 130.3
"""Figure 5b."""

MESH_LINES_HZ: Final = (0.89, 130.3)
"""Figure 5d: lines of the loads in the mesh force, beside the mesh frequency and its multiples."""

# Table 5: coupling stiffness along x, y, z (N/m) and about x, y, z (N·m/rad).

Six = tuple[float, float, float, float, float, float]

_BOLTED: Final[Six] = (1e10, 5e9, 5e9, 1e10, 5e10, 5e10)
_BEARING: Final[Six] = (1e10, 1e9, 1e9, 0.0, 1e10, 1e10)

TABLE_5: Final[dict[str, Six]] = {
    "k_r_ct": (1e9, 1e9, 1e9, 1e9, 1e9, 1e9),
    "k_r_gd": _BOLTED,
    "k_c_cf": _BOLTED,
    "k_c_fb": _BOLTED,
    "k_c_bc": _BOLTED,
    "k_c_cg": _BOLTED,
    "k_b_io": _BEARING,
    "k_b_pc": _BEARING,
    "k_s_pg": _BOLTED,
    "k_h_gd": _BOLTED,
}

# Table 6 and Figures 8 to 10: design and accuracy of the surrogates.

TRAIN: Final = 200
TEST: Final = 20

TABLE_6: Final[dict[str, dict[str, float]]] = {
    "RDef_A": {"rbf": 0.958, "krg": 0.960, "svr": 0.970},
    "RDef_L": {"rbf": 0.932, "krg": 0.960, "svr": 0.958},
    "RDef_R": {"rbf": 0.937, "krg": 0.956, "svr": 0.967},
    "PAcc_A": {"rbf": 0.747, "krg": 0.713, "svr": 0.752},
    "PAcc_L": {"rbf": 0.886, "krg": 0.893, "svr": 0.877},
    "PAcc_R": {"rbf": 0.828, "krg": 0.852, "svr": 0.854},
    "MF_M": {"rbf": 0.938, "krg": 0.949, "svr": 0.946},
    "MF_Se": {"rbf": 0.776, "krg": 0.768, "svr": 0.777},
}
"""R² of ten-fold cross validation, output by surrogate."""

METHODS: Final = ("rbf", "krg", "svr")
CHOSEN: Final = "svr"
"""Section 4.1: "chosen … due to its highest accuracy"."""

LEAST_TEST_R2: Final = 0.8
"""Figure 10: R² on the test points is greater for every output."""
WORST_ON_TEST: Final = "MF_Se"
BEST_ON_TEST: Final = ("RDef_A", "RDef_L", "RDef_R")

# Figures 11 to 15: main parameters, their shares, and what the response does along them.

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
    **dict.fromkeys(DISPLACEMENTS, 11),
    **dict.fromkeys(("PAcc_A", "PAcc_L", "PAcc_R"), 13),
    **dict.fromkeys(("MF_M", "MF_Se"), 14),
}
CURVES_OF: Final = {"RDef_A": 12, "PAcc_L": 12, "MF_M": 15, "MF_Se": 15}
"""Numbers of the figures with an output's shares, and with its curves."""
