"""Support vector regression with an RBF kernel on weighted inputs."""

from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from sklearn.svm import SVR

from tbm_gsa.sensitivity.surrogates.base import Surrogate
from tbm_gsa.sensitivity.surrogates.expansion import Expansion, KernelExpansion
from tbm_gsa.sensitivity.surrogates.likelihood import Correlation, maximum_likelihood
from tbm_msgs_py.base.arrays import Array

# Below this tube (in standard deviations of the output) libsvm's time grows tenfold and R² in the fourth digit only.
SMALLEST_TUBE: Final = 0.02
# Bounds of the box constraint C: a machine that may at least follow a trend, and one libsvm solves in time.
BOX_LIMITS: Final = (1.0, 300.0)
BOX_SHARE: Final = 0.3


@dataclass(frozen=True, eq=False)
class SupportVectorRegression(Surrogate):
    """ε-insensitive support vector regression (scikit-learn, libsvm).

    An RBF kernel with one width for all inputs fits a function of few inputs out of 25 poorly, so the inputs are
    weighted by the rates θ of a Gaussian process of maximum likelihood, which also sets the width (γ_k = θ_k). Its
    noise level sets the tube, ε = 3 σ √(ln n / n) [1]_; C is a share of the largest weight that process gives to any
    sample: large for a smooth output, small for a noisy one. None of the three is searched on a grid, which is what
    leaves time to repeat the whole choice inside every fold.

    References
    ----------
    .. [1] V. Cherkassky, Y. Ma, "Practical selection of SVM parameters and noise estimation for SVM regression",
       Neural Networks 17 (2004) 113–126.
    """

    method: ClassVar[str] = "svr"

    @classmethod
    def _expand(cls, unit: Array, standardised: Array, seed: int) -> tuple[Expansion, dict[str, float]]:  # noqa: ARG003
        process = maximum_likelihood(unit, standardised)
        box, tube = _box_and_tube(process, len(unit))
        machine = SVR(kernel="rbf", gamma=1.0, C=box, epsilon=tube)
        machine.fit(unit * np.sqrt(process.theta), standardised)
        expansion = KernelExpansion(
            centres=unit[machine.support_],
            theta=process.theta,
            weights=np.asarray(machine.dual_coef_)[0],
            offset=float(machine.intercept_[0]),
        )
        return expansion, {"C": box, "epsilon": tube}


def _box_and_tube(process: Correlation, count: int) -> tuple[float, float]:
    """Box constraint C and tube ε for an output with the given correlation and number of samples."""
    box = float(np.clip(BOX_SHARE * np.abs(process.weights).max(), *BOX_LIMITS))
    tube = max(3.0 * process.noise * np.sqrt(np.log(count) / count), SMALLEST_TUBE)
    return box, float(tube)
