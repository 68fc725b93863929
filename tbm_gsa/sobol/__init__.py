"""Sobol indices: in closed form for a surrogate, by sampling for any function."""

from tbm_gsa.sobol.closed_form import sobol_closed_form
from tbm_gsa.sobol.indices import SobolIndices
from tbm_gsa.sobol.monte_carlo import sobol_monte_carlo

__all__ = ["SobolIndices", "sobol_closed_form", "sobol_monte_carlo"]
