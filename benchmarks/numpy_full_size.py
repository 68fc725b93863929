"""The reference method step by step in numpy: what one would write first, and what the compiled kernels are held to."""

from __future__ import annotations

import numpy as np

from tbm_dynamics.integration.laws import OFFSET, SLOPE, STIFFNESS, CouplingLaws
from tbm_dynamics.integration.lobatto import Lobatto
from tbm_dynamics.integration.method import Steps

_ROUNDS = 3


class NumpyLobatto(Lobatto):
    """`Lobatto` with its loop over the steps in Python."""

    def advance(self, laws: CouplingLaws, steps: Steps, state: np.ndarray) -> int:
        """Advance by n steps; see `method.Method`."""
        k = steps.force.shape[1]
        s = len(state) - k
        for n in range(len(steps.record)):
            result = steps.forced[n] + state @ self._predict
            r_middle = r_end = state[s:]
            for _ in range(_ROUNDS):
                motion = result[s:] + r_middle @ self._couple[0] + r_end @ self._couple[1]
                middle, end = motion.reshape(2, 2, k)
                _, r_middle = _forces(middle, steps.mesh_inputs[2 * n], laws)
                steps.force[n], r_end = _forces(end, steps.mesh_inputs[2 * n + 1], laws)
            result += r_middle @ self._middle + r_end @ self._end
            state[:] = np.concatenate([result[:s], r_end])
            steps.record[n, : s + k] = state
        return len(steps.record)


def _forces(motion: np.ndarray, mesh_inputs: np.ndarray, laws: CouplingLaws) -> tuple[np.ndarray, np.ndarray]:
    """Compute the forces of the couplings and their residual, each (2L,)."""
    stiffness, damping, gap = laws.constants
    deflection = motion[0] + mesh_inputs[OFFSET]
    beyond = np.maximum(deflection - gap, 0.0) + np.minimum(deflection + gap, 0.0)
    closing = np.where(np.abs(deflection) > gap, damping * (motion[1] + mesh_inputs[SLOPE]), 0.0)
    total = mesh_inputs[STIFFNESS] * beyond + closing
    return total, total - laws.statics - stiffness * motion[0] - damping * motion[1]
