"""The reference method step by step in numpy: what one would write first, and what the compiled kernels are held to."""

from __future__ import annotations

import numpy as np

from tbm_dynamics.integration.laws import OFFSET, SLOPE, STIFFNESS, Laws
from tbm_dynamics.integration.lobatto import Lobatto

_ROUNDS = 3


class NumpyLobatto(Lobatto):
    """`Lobatto` with its loop over the steps in Python."""

    def advance(
        self,
        laws: Laws,
        held: np.ndarray,
        inputs: np.ndarray,
        forced: np.ndarray,
        record: np.ndarray,
        force: np.ndarray,
    ) -> int:
        """Advance by n steps; see `method.Method`."""
        del inputs
        k = force.shape[1]
        s = len(self._state) - k
        known = self._state
        for n in range(len(record)):
            result = forced[n] + known @ self._free
            g_middle = g_end = known[s:]
            for _ in range(_ROUNDS):
                motion = result[s:] + g_middle @ self._couple[0] + g_end @ self._couple[1]
                middle, end = motion.reshape(2, 2, k)
                _, g_middle = _forces(middle, held[2 * n], laws)
                force[n], g_end = _forces(end, held[2 * n + 1], laws)
            result += g_middle @ self._middle + g_end @ self._end
            known = np.concatenate([result[:s], g_end])
            record[n, : s + k] = known
        self._state = known
        return len(record)


def _forces(motion: np.ndarray, held: np.ndarray, laws: Laws) -> tuple[np.ndarray, np.ndarray]:
    """Compute the forces of the couplings and their excess, each (2L,)."""
    stiffness, damping, gap = laws.constants
    deflection = motion[0] + held[OFFSET]
    beyond = np.maximum(deflection - gap, 0.0) + np.minimum(deflection + gap, 0.0)
    closing = np.where(np.abs(deflection) > gap, damping * (motion[1] + held[SLOPE]), 0.0)
    total = held[STIFFNESS] * beyond + closing
    return total, total - laws.statics - stiffness * motion[0] - damping * motion[1]
