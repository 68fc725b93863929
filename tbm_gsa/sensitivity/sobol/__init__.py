"""Sobol indices: in closed form for a surrogate, by sampling for any function, over conditional Kriging paths."""

from tbm_gsa.sensitivity.sobol.closed_form import sobol_closed_form
from tbm_gsa.sensitivity.sobol.indices import Groups, SobolIndices, of_a_constant
from tbm_gsa.sensitivity.sobol.monte_carlo import (
    ConvergenceStep,
    convergence_sizes,
    sobol_convergence,
    sobol_monte_carlo,
)
from tbm_gsa.sensitivity.sobol.of_surrogate import is_constant, sobol_of_surrogate
from tbm_gsa.sensitivity.sobol.paths import PathIndices, sobol_of_paths

__all__ = [
    "ConvergenceStep",
    "Groups",
    "PathIndices",
    "SobolIndices",
    "convergence_sizes",
    "is_constant",
    "of_a_constant",
    "sobol_closed_form",
    "sobol_convergence",
    "sobol_monte_carlo",
    "sobol_of_paths",
    "sobol_of_surrogate",
]
