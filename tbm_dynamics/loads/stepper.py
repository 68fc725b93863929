"""The two levels of the loads behind one interface: one realisation at any operating point."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Literal, Protocol

import numpy as np

from tbm_dynamics.loads.cutters import CutterError, CutterLoads
from tbm_dynamics.loads.spectral import SpectralLoads
from tbm_dynamics.machine.machine import Machine
from tbm_msgs_py.base.errors import MachineError
from tbm_msgs_py.base.operating_point import OperatingPoint

LoadLevel = Literal["spectral", "cutter"]
_KEPT = 2  # operating points: a change runs from one to the next
LOAD_LEVELS: tuple[LoadLevel, ...] = ("spectral", "cutter")


class OperatedLoads(Protocol):
    """A realisation of the loads on the cutterhead, at the operating point asked for."""

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
        """Evaluate at stream times (n,) in s, where the head stands at angles (n,) in rad: (n, 6), N and N·m.

        What presses the head goes linearly over the n samples from one operating point to the other, which the last
        sample has reached.
        """


def operated_loads(machine: Machine, level: LoadLevel = "spectral", seed: int = 0) -> OperatedLoads:
    """Open the loads of a machine on a level.

    Raises
    ------
    MachineError
        No such level, or a machine file without cutters on the cutter level.
    """
    if level not in LOAD_LEVELS:
        raise MachineError(f"loads {level!r}: allowed are {', '.join(LOAD_LEVELS)}")
    return _Cutter(machine, seed) if level == "cutter" else _Spectral(machine, seed)


class _Spectral:
    """Table 1's spectra: mean and fluctuation follow the ratios of thrust and torque; lines keep their frequency."""

    def __init__(self, machine: Machine, seed: int) -> None:
        self._machine, self._seed = machine, seed

    @cached_property
    def _described(self) -> SpectralLoads:
        """Make the realisation: not for those who only ask for means."""
        return self._machine.loads(self._seed).with_scale(np.ones(6))

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
        return scales * self._described.evaluate(time)


class _Cutter:
    """The forces on the discs: the thrust presses them in, and the torque is what they take."""

    def __init__(self, machine: Machine, seed: int) -> None:
        self._machine = machine
        self._loads = machine.cutter_loads(seed)
        self._kept: dict[tuple[float, float], CutterLoads] = {}

    def _at(self, point: OperatingPoint) -> CutterLoads:
        drive = point.thrust, point.speed
        if drive not in self._kept:
            try:
                self._kept[drive] = self._loads.at(*drive)
            except CutterError as error:
                raise MachineError(f"operating point: {error}") from None
            if len(self._kept) > _KEPT:
                del self._kept[next(iter(self._kept))]
        return self._kept[drive]

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
    """Go from values (k,) to others, which the last sample has reached: (n, k)."""
    share = np.arange(1, samples + 1)[:, None] / samples
    return np.asarray(before + share * (after - before))
