"""The contract of an integration method.

1. A method is built from a system, the unknowns whose motion is wanted and a step τ; it holds constant arrays and the
   state, and never prints. The p drives stand in L lanes (`laws`).
2. `begin` sets displacement and velocity about the static equilibrium, the couplings' excess g and what is held of them
   at the start, and gives the row of the record there.
3. What is known beforehand is handed over for a block of steps of always the same size, so that the bits do not depend
   on the pieces: what the inputs u add (`forced`), and what is held of the couplings at the `stages` of a step.
4. `advance` takes n steps, fills one row of `record` and of `force` for each, and returns how many it did: fewer than n
   when the motion is no longer finite.
5. A row of `record` begins with the method's own columns and ends with u (7); `output` turns it into the outputs asked
   for.
6. The same steps give the same bits in whatever pieces `advance` is called.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from tbm_dynamics.integration.laws import Laws


class Method(Protocol):
    """An integration method; see the module."""

    @property
    def states(self) -> int:
        """Number of states integrated."""

    @property
    def stages(self) -> tuple[float, ...]:
        """Instants within a step, as shares of it, at which the couplings' laws are wanted."""

    @property
    def forced(self) -> np.ndarray:
        """What u at the end of a step and at its start add, shape (14, w)."""

    @property
    def output(self) -> np.ndarray:
        """Outputs from a row of the record, shape (r, o): the rows wanted of q − q_s, then of q̈."""

    @property
    def tail(self) -> int:
        """Last columns of a row of the record that any output may need (see `output.Output`)."""

    def begin(self, displacement: np.ndarray, velocity: np.ndarray, excess: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Stand at q − q_s and q̇, each (n,), with the couplings' g a step before and now (2, 2L) and what is held.

        Returns
        -------
        (r − 7,) ndarray
            Row of the record there, without its u.
        """

    def advance(
        self,
        laws: Laws,
        held: np.ndarray,
        inputs: np.ndarray,
        forced: np.ndarray,
        record: np.ndarray,
        force: np.ndarray,
    ) -> int:
        """Advance by n steps.

        Parameters
        ----------
        laws : Laws
        held : (n · stages, 3, 2L) ndarray
            From `laws.Held`.
        inputs : (n, 14) ndarray
            u at the end and at the start of each step.
        forced : (n, w) ndarray
            Inputs times `forced`.
        record : (n, r) ndarray
            Written, but for the last 7 columns.
        force : (n, 2L) ndarray
            Written: forces of the couplings (N, N·m).
        """
