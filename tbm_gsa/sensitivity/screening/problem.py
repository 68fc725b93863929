"""How SALib wants to be asked."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tbm_gsa.sensitivity.surrogates.samples import checked_bounds


def salib_problem(bounds: ArrayLike) -> dict[str, Any]:
    """Describe inputs inside bounds (d, 2)."""
    box = checked_bounds(bounds)
    return {"num_vars": len(box), "names": [str(k) for k in range(len(box))], "bounds": box.tolist()}


def salib_seed(seed: int, number: int = 0) -> int:
    """Derive the seed of a repetition from any seed: SALib takes 0 for none."""
    return 1 + int(np.random.SeedSequence([seed, number]).generate_state(1)[0] >> 1)
