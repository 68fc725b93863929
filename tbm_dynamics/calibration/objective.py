"""What the calibration wants: the paper's predictions, as one number to make small.

Squares of logarithmic errors, so that a point that is twice too high and one that is twice too low count alike:
Table 2's predicted axial RMS (weight 1 each); the decay cutterhead > girder > gripper in three directions, an axial
natural frequency in 125–135 Hz, mesh-force lines at the torque's 0.9 and 130.3 Hz that show beside that of the mesh
frequency, and a fluctuation of F_x below 20 % and of M_x below 30 % of their means as penalties when they are missed.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tbm_dynamics.calibration.prediction import Prediction
from tbm_dynamics.calibration.targets import AXIAL_BAND_HZ, POWER_FLOW, PREDICTED_G
from tbm_msgs_py.base.units import STANDARD_GRAVITY

LARGEST_FLUCTUATION = 0.20
# The paper names these lines without a height: a fortieth of the static mesh force (assumed).
MESH_LINE_N = 5e3
# Of the torque: the paper has none; cutting torque swings more than thrust (assumed).
LARGEST_TORQUE_FLUCTUATION = 0.30

# Margins inside the limits, so that the time-domain run stays inside too.
_DECAY_MARGIN = 0.1
_BAND_MARGIN_HZ = 1.0
_FLUCTUATION_MARGIN = 0.005

# The levels are numbers of the paper, the height of the lines is ours: they may not cost a level much.
_LINE_WEIGHT = 0.2


def objective(prediction: Prediction, fluctuation: float, torque_fluctuation: float) -> float:
    """Distance to the paper's predictions.

    Parameters
    ----------
    prediction : Prediction
    fluctuation, torque_fluctuation : float
        RMS of F_x and of M_x over their means.
    """
    total = sum(
        np.log(prediction.rms[point][0] / (level * STANDARD_GRAVITY)) ** 2 for point, level in PREDICTED_G.items()
    )
    for before, after in pairwise(POWER_FLOW):
        rise = np.log(prediction.rms[after] / prediction.rms[before]) + _DECAY_MARGIN
        total += 3.0 * np.sum(np.maximum(rise, 0.0) ** 2)
    low, high = AXIAL_BAND_HZ[0] + _BAND_MARGIN_HZ, AXIAL_BAND_HZ[1] - _BAND_MARGIN_HZ
    found = prediction.axial_frequencies
    missed = np.min(np.maximum(low - found, 0.0) + np.maximum(found - high, 0.0), initial=50.0)
    total += 0.1 * min(missed / 3.0, 5.0) ** 2
    faint = sum(max(np.log(MESH_LINE_N / height), 0.0) ** 2 for height in prediction.mesh_lines.values())
    total += _LINE_WEIGHT * faint
    for value, largest in ((fluctuation, LARGEST_FLUCTUATION), (torque_fluctuation, LARGEST_TORQUE_FLUCTUATION)):
        total += 1e3 * max(value - largest + _FLUCTUATION_MARGIN, 0.0) ** 2
    return float(total)
