"""Table 2 and Figures 2 and 5 to 7: vibration predicted and measured."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class PointRow:
    """A row of Table 2: axial acceleration, RMS in g; the error is that of equation (4)."""

    node: int
    predicted_g: float
    measured_g: float
    relative_error: float


TABLE_2: Final = {
    "cutterhead": PointRow(3, 1.10, 0.93, 0.18),
    "shield": PointRow(43, 0.56, 0.40, 0.40),
    "gripper": PointRow(50, 0.04, 0.08, 0.50),
}

MARKED_NODES: Final = {"cutterhead": 3, "ring gear": 8, "first pinion": 14, "shield": 43, "gripper": 50}
"""Nodes that text and tables name by the numbers of Figure 2."""

SUBSYSTEMS: Final = ("cutterhead-bearing-gear", "driveshaft", "carrier-girder")
"""Figure 2."""

MEASURED_POINTS: Final = ("cutterhead", "shield", "walkway", "girder", "gripper")
"""Figure 6: where the wireless sensors sit."""

POWER_FLOW: Final = ("cutterhead", "girder", "gripper")
"""Figure 7b: RMS falls along these, in all three directions."""

CUTTERHEAD_PEAK_G: Final = 4.0
"""Figure 7a: the acceleration at the cutterhead varies within about ± this."""

AXIAL_BAND_HZ: Final = (125.0, 135.0)
"""Figure 5b names an axial natural frequency next to the load's line; this is where "next to" ends (ours)."""

ACCELERATION_LINE_HZ: Final = 130.3
"""Figure 5b."""

MESH_LINES_HZ: Final = (0.89, 130.3)
"""Figure 5d: lines of the loads in the mesh force, beside the mesh frequency and its multiples."""
