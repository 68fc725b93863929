"""Cheaper looks at a function's inputs than Sobol indices by sampling, for comparison: Morris and FAST, by SALib."""

from tbm_gsa.sensitivity.screening.fast import fast_indices
from tbm_gsa.sensitivity.screening.morris import ElementaryEffects, morris_effects

__all__ = ["ElementaryEffects", "fast_indices", "morris_effects"]
