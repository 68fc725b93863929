"""What the calibration wants: the paper's predictions, as one number to make small.

Squares of logarithmic errors, so that a point that is twice too high and one that is twice too low count alike:
Table 2's predicted axial RMS (weight 1 each); the decay cutterhead > girder > gripper in three directions, an axial
natural frequency in 125–135 Hz, a pinion whose axial level follows the damping of steel (the paper's PAcc_A, x4 about
0.8), shafts that carry the allowed loads, and a fluctuation of F_x below 20 % of its mean as penalties when they are
missed.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tbm_dynamics.calibration.prediction import Prediction
from tbm_dynamics.calibration.targets import AXIAL_BAND_HZ, POWER_FLOW, PREDICTED_G
from tbm_msgs_py.base.units import STANDARD_GRAVITY

LARGEST_FLUCTUATION = 0.20
SMALLEST_STEEL_SHARE = 0.8

# Margins inside the limits, so that the time-domain run stays inside too.
_DECAY_MARGIN = 0.1
_BAND_MARGIN_HZ = 1.0
_FLUCTUATION_MARGIN = 0.005


def objective(prediction: Prediction, fluctuation: float) -> float:
    """Distance to the paper's predictions.

    Parameters
    ----------
    prediction : Prediction
    fluctuation : float
        RMS of F_x over its mean.
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
    total += 2.0 * max(np.log(SMALLEST_STEEL_SHARE / prediction.steel_share), 0.0) ** 2
    total += 10.0 * max(np.log(prediction.stress_used), 0.0) ** 2
    total += 1e3 * max(fluctuation - LARGEST_FLUCTUATION + _FLUCTUATION_MARGIN, 0.0) ** 2
    return float(total)
