"""Response curves: how an output goes with one input."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_gsa.sensitivity.surrogates import Surrogate
from tbm_msgs_py.base.arrays import Array

CURVE_POINTS: Final = 21


@dataclass(frozen=True, eq=False)
class Curve:
    """Mean response along one input, all others averaged over the training design.

    Parameters
    ----------
    code : str
    values : ndarray, shape (k,)
        Of the input, in its unit.
    response : ndarray, shape (k,)
        Of the output, in its unit.
    """

    code: str
    values: Array
    response: Array


def response_curve(model: Surrogate, inputs: InputSet, k: int) -> Curve:
    """Mean prediction over the training design with input k held at values across its range.

    This is the conditional mean whose variance is the first-order index, estimated on the design (a partial
    dependence curve), so a curve is as steep as its input is important.

    Parameters
    ----------
    model : Surrogate
        Over the unit cube of the inputs.
    inputs : InputSet
    k : int
    """
    design = model.samples.X
    item = inputs.inputs[k]
    values = np.linspace(item.lower, item.upper, CURVE_POINTS)
    points = np.tile(design, (CURVE_POINTS, 1))
    points[:, k] = np.repeat(item.distribution.to_unit(values), len(design))
    response = model.predict(points).reshape(CURVE_POINTS, len(design)).mean(axis=1)
    return Curve(item.code, values, response)
