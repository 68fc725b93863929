"""Kriging: a Gaussian process with a squared-exponential kernel, one rate per input, constant trend and nugget."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF

from tbm_gsa.sensitivity.surrogates.base import Surrogate
from tbm_gsa.sensitivity.surrogates.expansion import Expansion, KernelExpansion
from tbm_gsa.sensitivity.surrogates.likelihood import maximum_likelihood
from tbm_msgs_py.base.arrays import Array


@dataclass(frozen=True, eq=False)
class Kriging(Surrogate):
    """Ordinary Kriging: hyper-parameters by maximum likelihood, conditioning by scikit-learn.

    The nugget takes what does not vary smoothly, so the mean does not interpolate the samples exactly.
    """

    expansion: KernelExpansion
    method: ClassVar[str] = "krg"

    @classmethod
    def _expand(cls, unit: Array, standardised: Array, seed: int) -> tuple[Expansion, dict[str, float]]:  # noqa: ARG003
        process = maximum_likelihood(unit, standardised)
        kernel = RBF(length_scale=1.0 / np.sqrt(2.0 * process.theta))
        regressor = GaussianProcessRegressor(kernel, alpha=process.nugget, optimizer=None)
        regressor.fit(unit, standardised - process.offset)
        expansion = KernelExpansion(unit, process.theta, np.asarray(regressor.alpha_), process.offset)
        return expansion, {"nugget": process.nugget, "variance": process.variance}
