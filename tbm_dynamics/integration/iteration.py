"""Whether the iteration over the couplings' excess settles within a step."""

from __future__ import annotations

import numpy as np

from tbm_dynamics.integration.errors import SimulationError

# A round must shrink the error of g at least this much.
_SLOWEST = 0.5


def refuse_coarse(gain: np.ndarray, step: float) -> None:
    """Refuse a step over which the stiffest meshes swing too far.

    Parameters
    ----------
    gain : (k, k) ndarray
        What the excess of open meshes at the end of a step adds to itself there: its size is about (ω τ)²/6, ω the
        natural frequency of a pinion on its teeth.
    step : float
        τ (s).

    Raises
    ------
    SimulationError
        Rounds that would not settle.
    """
    size = float(np.abs(np.linalg.eigvals(gain)).max())
    if not size < _SLOWEST:
        # For a much too long step the estimate saturates.
        allowed = step * min(np.sqrt(_SLOWEST / size), 0.5)
        raise SimulationError(
            f"time_step {step:g} s: too coarse for the stiffest mesh vibration; "
            f"allowed is about {allowed:.1g} s or less"
        )
