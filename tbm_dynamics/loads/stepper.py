"""The load models `spectral` and `cutter` behind one interface: one realisation while the operating point changes."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Final, Literal, Protocol, get_args

import numpy as np

from tbm_dynamics.loads.cutters.cutter_loads import CutterLoads
from tbm_dynamics.loads.cutters.description import CutterError
from tbm_msgs_py.base.errors import MachineError
from tbm_msgs_py.base.operating_point import OperatingPoint

if TYPE_CHECKING:
    from tbm_dynamics.loads.spectral import SpectralLoads
    from tbm_dynamics.machine.machine import Machine

LoadModel = Literal["spectral", "cutter"]
LOAD_MODELS: Final[tuple[LoadModel, ...]] = get_args(LoadModel)
_KEPT = 2  # operating points: a step goes from one to the next


class LoadStepper(Protocol):
    """One realisation of the loads on the cutterhead, step by step from one operating point to the next."""

    def reached(self, point: OperatingPoint) -> OperatingPoint:
        """Operating point that holds when this one is asked for.

        Raises
        ------
        MachineError
            A point that the machine or its rock does not allow.
        """

    def mean(self, point: OperatingPoint) -> np.ndarray:
        """Mean of the six components, (6,), N and N·m."""

    def evaluate(
        self, before: OperatingPoint, after: OperatingPoint, time: np.ndarray, angle: np.ndarray
    ) -> np.ndarray:
        """Return the loads (n, 6) in N and N·m at stream times (n,) in s, where the head stands at angles (n,) in rad.

        What presses the head goes linearly over the n samples from one operating point to the other, which the last
        sample has reached.
        """


def load_stepper(machine: Machine, model: LoadModel = "spectral", seed: int = 0) -> LoadStepper:
    """Return the loads of a machine by one of the load models.

    Raises
    ------
    MachineError
        No such model, or a machine file without cutters for the model `cutter`.
    """
    if model not in LOAD_MODELS:
        raise MachineError(f"loads {model!r}: allowed are {', '.join(LOAD_MODELS)}")
    return _CutterStepper(machine, seed) if model == "cutter" else _SpectralStepper(machine, seed)


class _SpectralStepper:
    """Spectra of the file: mean and fluctuation follow the ratios of thrust and torque; lines keep their frequency.

    On a head that does not turn nothing fluctuates.
    """

    def __init__(self, machine: Machine, seed: int) -> None:
        self._machine, self._seed = machine, seed

    @cached_property
    def _realisation(self) -> SpectralLoads:
        # Not for those who only ask for means.
        from tbm_dynamics.loads.spectral import SpectralLoads  # noqa: PLC0415 - compiled code, for those who run it

        return SpectralLoads(self._machine.description.loads, seed=self._seed)

    def reached(self, point: OperatingPoint) -> OperatingPoint:
        self._machine.check_operating_point(point)
        return point

    def mean(self, point: OperatingPoint) -> np.ndarray:
        return np.asarray(self._machine.description.loads.mean * self._machine.load_scale(point))

    def evaluate(
        self,
        before: OperatingPoint,
        after: OperatingPoint,
        time: np.ndarray,
        angle: np.ndarray,  # noqa: ARG002 - the spectra do not turn with the head
    ) -> np.ndarray:
        scales = _ramp(self._machine.load_scale(before), self._machine.load_scale(after), len(time))
        loads = self._realisation.evaluate(time)
        if before.standstill or after.standstill:
            turning = np.array([[not before.standstill], [not after.standstill]], dtype=float)
            mean = self._machine.description.loads.mean
            loads = mean + _ramp(turning[0], turning[1], len(time)) * (loads - mean)
        return scales * loads


class _CutterStepper:
    """The forces on the discs: the thrust presses them in, and the torque is what they take."""

    def __init__(self, machine: Machine, seed: int) -> None:
        self._machine = machine
        self._loads = machine.cutter_loads(seed)
        self._driven = lru_cache(maxsize=_KEPT)(self._loads.at)

    def _at(self, point: OperatingPoint) -> CutterLoads:
        try:
            return self._driven(point.thrust, point.speed)
        except CutterError as error:
            raise MachineError(f"operating point: {error}") from None

    def reached(self, point: OperatingPoint) -> OperatingPoint:
        self._machine.check_operating_point(point)
        taken = replace(point, torque=-float(self._at(point).mean[3]))
        self._machine.check_operating_point(taken)
        return taken

    def mean(self, point: OperatingPoint) -> np.ndarray:
        return self._at(point).mean

    def evaluate(
        self, before: OperatingPoint, after: OperatingPoint, time: np.ndarray, angle: np.ndarray
    ) -> np.ndarray:
        forces = _ramp(self._at(before).forces, self._at(after).forces, len(time))
        return self._loads.evaluate(time, angle, forces)


def _ramp(before: np.ndarray, after: np.ndarray, samples: int) -> np.ndarray:
    """Values (n, k) that go from (k,) to others, which the last sample has reached."""
    share = np.arange(1, samples + 1)[:, None] / samples
    return np.asarray(before + share * (after - before))
