"""Whether the iteration over the couplings' excess settles within a step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tbm_msgs_py.base.errors import SimulationError

# A round must shrink the error of g at least this much.
_SLOWEST = 0.5
_LONGEST_S = 1e-3  # longest step that is named as short enough; the longer one is, the longer it takes to be tried


def refuse_coarse(gain_at: Callable[[float], np.ndarray], step: float, gain: np.ndarray) -> None:
    """Refuse a step over which the stiffest meshes swing too far.

    Parameters
    ----------
    gain_at : callable
        From a step (s) what the excess of open meshes at its end adds to itself there, (k, k): its size is about
        (ω τ)²/6, ω the natural frequency of a pinion on its teeth.
    step : float
        τ (s).
    gain : (k, k) ndarray
        That at the step wanted.

    Raises
    ------
    SimulationError
        Rounds that would not settle.
    """
    if _settles(gain):
        return
    allowed = min(0.5 * step, _LONGEST_S)
    while not _settles(gain_at(allowed)):
        allowed *= 0.5
    raise SimulationError(
        f"time_step {step:g} s: too coarse for the stiffest mesh vibration; {allowed:.2g} s is short enough"
    )


def _settles(gain: np.ndarray) -> bool:
    return float(np.abs(np.linalg.eigvals(gain)).max()) < _SLOWEST
