"""The contract of an integration method.

1. A method is built from a `LinearSystem` and a step τ; it holds constant arrays and the state, and never prints.
2. `begin` sets the state v and the excess g at the start.
3. `advance` takes the inputs u where the state stands and at the n steps after it, fills one row of `record` and of
   `force` for each step, and returns how many steps it did: fewer than n when the motion is no longer finite.
4. A row of `record` holds the method's own s states, u (7) and g (p); `output` turns it into the outputs asked for.
5. The same steps give the same bits in whatever pieces `advance` is called.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from tbm_dynamics.integration.kernel import MeshLaws


class Method(Protocol):
    """An integration method; see the module."""

    @property
    def states(self) -> int:
        """Number of states s."""

    @property
    def output(self) -> np.ndarray:
        """Outputs from a row of the record, shape (s + 7 + p, o)."""

    def begin(self, state: np.ndarray, excess: np.ndarray) -> None:
        """Stand at v (s,) with the meshes' excess g (p,)."""

    def start_row(self, inputs: np.ndarray) -> np.ndarray:
        """Row of the record where the state stands, inputs u (7,), shape (s + 7 + p,)."""

    def advance(
        self,
        laws: MeshLaws,
        inputs: np.ndarray,
        phase: np.ndarray,
        first: int,
        record: np.ndarray,
        force: np.ndarray,
    ) -> int:
        """Advance by n steps.

        Parameters
        ----------
        laws : MeshLaws
        inputs : (n + 1, 7) ndarray
            u where the state stands and at the n steps after it.
        phase : (3,) ndarray
            Mesh phase at a reference step (cycles), cycles per step, mesh frequency (Hz).
        first : int
            Steps from the reference step to where the state stands.
        record : (n, s + 7 + p) ndarray
            Written.
        force : (n, p) ndarray
            Written: mesh forces (N).
        """
