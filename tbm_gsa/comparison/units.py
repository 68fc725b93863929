"""Whether a field is off by a factor of units, live and afterwards alike."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tbm_msgs_py.base.units import STANDARD_GRAVITY

FACTORS: Final = {
    1.0 / STANDARD_GRAVITY: "values in g",
    STANDARD_GRAVITY: "m/s² taken for g",
    1e3: "values in mm/s²",
    1e-3: "values in 1000 m/s²",
}
DOUBT: Final = 0.4
"""Of the logarithm: the model itself errs by up to 50 %."""


def unit_doubt(field_rms: ArrayLike, model_rms: ArrayLike) -> str:
    """Say that RMS values of a field, one an axis, are the model's times a factor of units; empty when they are not.

    Axes that measure nothing say nothing: sensors of one axis are often recorded with zeros along the others.
    """
    field, model = np.asarray(field_rms, dtype=np.float64), np.asarray(model_rms, dtype=np.float64)
    known = (field > 0.0) & (model > 0.0)
    ratio = np.log(field[known] / model[known])
    for factor, text in FACTORS.items():
        if ratio.size and np.all(np.abs(ratio - np.log(factor)) < DOUBT):
            return f"field is about {factor:.3g} times the model on all axes: {text}?"
    return ""
