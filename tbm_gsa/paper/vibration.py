"""Table 2 and Figures 2 and 5 to 7: vibration predicted and measured."""

from dataclasses import dataclass
from typing import Final

from tbm_dynamics.calibration.targets import PREDICTED_G


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
