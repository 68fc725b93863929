"""The contract of an integration method.

1. A method is built from a system, the unknowns whose motion is wanted and a step τ. It holds constants only and never
   changes: any number of runs may use one, each with a state of its own. The p drives stand in L lanes (`lanes`).
2. `start` returns the state at the start of a run, and the row of the record there.
3. `advance` brings a state n steps further in place, fills a row of the record and of the forces for each, and returns
   how many it did: fewer than n when the motion is no longer finite, and then the state is of no use.
4. What is known beforehand is computed for a block of steps of always the same size (`Steps`), so that the bits do not
   depend on the pieces; the same steps give the same bits in whatever pieces `advance` is called.
5. A row of the record begins with the method's own columns and ends with u (7); `output` turns it into the outputs
   asked for.

A method implements

    class Euler(Method[State]):
        states = stages = linear = forced = output = tail = ...    # as documented at `Method`

        def start(self, start):
            return State(start.displacement, start.velocity, start.residual[1]), row

        def advance(self, laws, steps, state):
            for k in range(len(steps.record)):
                ...                                       # predict, contact, correct, record
            return len(steps.record)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from tbm_dynamics.integration import DEFAULT_STEP
from tbm_dynamics.integration.laws import CouplingLaws
from tbm_dynamics.integration.start import Start
from tbm_msgs_py.base.errors import SimulationError

# Least factor by which a round of the iteration must shrink the error of the residual.
_SLOWEST = 0.5
_ROOM = 0.25
"""That factor of a machine's own step: peaks are within 1 % of those of a far shorter one (see `docs/model.md`)."""
_LONGEST_S = 1e-3  # longest step that is named as short enough; the longer one is, the longer it takes to be tried
_STEPS = (DEFAULT_STEP, 5e-5, 2e-5, 1e-5, 5e-6, 2e-6, 1e-6, 5e-7, 2e-7, 1e-7)
"""Steps that a machine may have: whole nanoseconds, and rates that blocks of 5 kHz divide."""

StateT = TypeVar("StateT")


class Steps(NamedTuple):
    """What is known beforehand of n steps, and where a method writes what it finds.

    Attributes
    ----------
    mesh_inputs : (n · stages, 3, 2L) ndarray
        From `laws.MeshInputs`.
    inputs : (n, 14) ndarray
        u at the end and at the start of each step.
    forced : (n, w) ndarray
        Inputs times `Method.forced`.
    record : (n, r) ndarray
        Written, but for the last 7 columns, which hold u at the end.
    force : (n, 2L) ndarray
        Written: forces of the couplings (N, N·m).
    """

    mesh_inputs: np.ndarray
    inputs: np.ndarray
    forced: np.ndarray
    record: np.ndarray
    force: np.ndarray

    def rows(self, begin: int, stop: int) -> Steps:
        """Return steps `begin` to `stop` of these."""
        stages = len(self.mesh_inputs) // len(self.inputs)
        steps = slice(begin, stop)
        mesh_inputs = self.mesh_inputs[stages * begin : stages * stop]
        return Steps(mesh_inputs, self.inputs[steps], self.forced[steps], self.record[steps], self.force[steps])


class Method(ABC, Generic[StateT]):
    """An integration method, see the module.

    Attributes
    ----------
    stages : tuple of float
        Instants within a step, as shares of it, at which the mesh inputs are wanted.
    states : int
        Number of states integrated.
    linear : (2, 2p) ndarray
        Stiffness and damping of the couplings in the linear part; what a coupling has beyond them is residual.
    forced : (14, w) ndarray
        What u at the end of a step and at its start add.
    output : (r, o) ndarray
        Outputs from a row of the record: the rows wanted of q − q_s, then of q̈.
    tail : int
        Last columns of a row of the record that any output may need (see `output.Output`).
    """

    stages: tuple[float, ...]
    states: int
    linear: np.ndarray
    forced: np.ndarray
    output: np.ndarray
    tail: int

    @abstractmethod
    def start(self, start: Start) -> tuple[StateT, np.ndarray]:
        """State and row of the record, (r − 7,), at the start of a run."""

    @abstractmethod
    def advance(self, laws: CouplingLaws, steps: Steps, state: StateT) -> int:
        """Advance a state by n steps in place; returns the number of steps whose motion is finite."""


def fine_step(gain_at: Callable[[float], np.ndarray]) -> float:
    """Longest of `_STEPS` that leaves room; `gain_at` as of `refuse_coarse`.

    Raises
    ------
    SimulationError
        None of them.
    """
    step = next((step for step in _STEPS if _settles(gain_at(step), _ROOM)), None)
    if step is None:
        raise SimulationError(
            f"the stiffest mesh vibration needs a time step below {_STEPS[-1]:g} s: the teeth are too stiff for the "
            "inertia of pinion and ring"
        )
    return step


def refuse_coarse(gain_at: Callable[[float], np.ndarray], step: float) -> None:
    """Refuse a step over which the stiffest meshes swing too far for the iteration to settle.

    Parameters
    ----------
    gain_at : callable
        From a step (s) what the residual of open meshes at its end adds to itself there, (k, k): its size is about
        (ω τ)²/6, ω the natural frequency of a pinion on its teeth.
    step : float
        τ (s).

    Raises
    ------
    SimulationError
        Rounds that would not settle.
    """
    if _settles(gain_at(step)):
        return
    allowed = min(0.5 * step, _LONGEST_S)
    while not _settles(gain_at(allowed)):
        allowed *= 0.5
    raise SimulationError(
        f"time_step {step:g} s: too coarse for the stiffest mesh vibration; {allowed:.2g} s is short enough"
    )


def _settles(gain: np.ndarray, slowest: float = _SLOWEST) -> bool:
    return float(np.abs(np.linalg.eigvals(gain)).max()) < slowest
