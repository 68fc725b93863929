"""What the paper says of the vibration and the calibration aims at.

`tbm_gsa.paper` imports them from here, as the dynamics import nothing of the analysis.
"""

from typing import Final

PREDICTED_G: Final = {"cutterhead": 1.10, "shield": 0.56, "gripper": 0.04}
"""Table 2: axial acceleration, RMS in g, as the paper's model predicts it."""

POWER_FLOW: Final = ("cutterhead", "girder", "gripper")
"""Figure 7b: RMS falls along these, in all three directions."""

AXIAL_BAND_HZ: Final = (125.0, 135.0)
"""Figure 5b names an axial natural frequency next to the load's line; this is where "next to" ends (ours)."""
