"""Whether a field, live and afterwards alike, or a recorded operating point is off by a factor of units."""

import math
from collections.abc import Iterator, Mapping
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
ON_AVERAGE: Final = 0.6
"""Greatest distance of the mean logarithm of the axes from that of a factor: the model itself errs by up to 1.8."""
EACH: Final = math.log(STANDARD_GRAVITY) / 2.0
"""Greatest distance of a single axis: nearer to the factor than to 1."""

LOADS: Final = {1e-3: "kN", 1e-6: "MN"}
"""Units that stand where the message has N, and N·m, by their factor."""
BESIDE: Final = 3.0
"""Largest factor between what such a unit makes of the machine's own operating point and what was recorded."""


def operating_doubts(recorded: Mapping[str, float], own: Mapping[str, float]) -> Iterator[str]:
    """Yield a doubt for each load of an operating point (kN, kN·m) that is the machine's own times a factor of units.

    Parameters
    ----------
    recorded, own : mapping of str to float
        Alike: by what they are called.
    """
    for name, value in recorded.items():
        share = value / own[name]
        for factor, unit in LOADS.items():
            if factor / BESIDE < share < factor * BESIDE:
                yield (
                    f"operating point: {name} {value:.3g} is about {share:.2g} of the machine's own {own[name]:.6g}: "
                    f"values in {unit} where the message has N?"
                )


def unit_doubt(field_rms: ArrayLike, model_rms: ArrayLike) -> str:
    """Return a doubt if the RMS values of a field, one an axis, are the model's times a factor of units, else nothing.

    Axes that measure nothing say nothing: sensors of one axis are often recorded with zeros along the others.
    """
    field, model = np.asarray(field_rms, dtype=np.float64), np.asarray(model_rms, dtype=np.float64)
    known = (field > 0.0) & (model > 0.0)
    ratio = np.log(field[known] / model[known])
    for factor, text in FACTORS.items():
        away = ratio - math.log(factor)
        if ratio.size and abs(away.mean()) < ON_AVERAGE and (np.abs(away) < EACH).all():
            return f"field is about {factor:.3g} times the model on all axes: {text}?"
    return ""
