"""Band powers along every input that may have changed: those of the model at a few values, and between them.

What an input does is computed once for a machine and a reading, at places that are even in the space of the input's
distribution (the logarithm of stiffness and damping); logarithms between them follow Akima's curve as modified in
scipy. Covariances of chance are those of the machine as it stands with the sizes that belong to a value: correlations
between statistics hardly move with an input, the width of a peak does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import cached_property
from multiprocessing import get_context
from typing import Final

import numpy as np
import scipy.interpolate

from tbm_dynamics import Machine
from tbm_gsa.explanation.band_reading import BandReading
from tbm_gsa.explanation.load_scatter import LoadScatter, group_spread, load_scatter
from tbm_gsa.explanation.load_transfer import MachineMotion, machine_motion
from tbm_gsa.explanation.ranges import DECADE, explaining_inputs
from tbm_gsa.sensitivity.study.distributions import Distribution, LogUniform, Uniform
from tbm_gsa.sensitivity.study.inputs import Input, InputSet
from tbm_gsa.sensitivity.study.workers import prepare_worker
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.progress import CountDone

CELLS: Final[Mapping[type[Distribution], int]] = {Uniform: 2, LogUniform: 6}
"""Parts of the range of an input, between whose ends the model is computed, and at the machine's own value."""
CELLS_OVER_DECADES: Final = 8
"""Sharp peaks come and go with damping, which spans more than one."""
WORKERS: Final = 2
_FEWEST: Final = 5  # values of which every other one makes a curve
_ERROR_SHARE: Final = 0.5
_SAME: Final = 1e-3  # of the range, by which a value is still the machine's own
_FELT: Final = 1e-12  # of a statistic's power: what is less is rounding

"""Called with how many machines are done, and of how many."""


@dataclass(frozen=True, eq=False)
class CurveTable:
    """Machines along one input; v values, r groups of loads, k statistics.

    Attributes
    ----------
    unit : ndarray, shape (v,)
        Values in the unit interval of the input's distribution, ascending.
    gain, modulated : ndarray, shape (v, r, k)
        As in `LoadTransfer`.
    meshes : ndarray, shape (v, k)
    spread : ndarray, shape (v, r, k)
        Standard deviation of what each group does alone at a factor of 1, times the root of the duration.
    """

    unit: Array
    gain: Array
    modulated: Array
    meshes: Array
    spread: Array

    def only(self, places: Integers) -> CurveTable:
        """Of some statistics (u,) alone."""
        arrays = {name: getattr(self, name)[..., places] for name in ("gain", "modulated", "meshes", "spread")}
        return replace(self, **arrays)


@dataclass(frozen=True, eq=False)
class CauseCurves:
    """Band powers of a machine along every input that may have changed.

    Attributes
    ----------
    inputs : InputSet
    nominal : LoadScatter
        Of the machine as it stands.
    tables : mapping of str to CurveTable
        By code of the input.
    """

    inputs: InputSet
    nominal: LoadScatter
    tables: Mapping[str, CurveTable]

    def at(self, code: str, value: float) -> LoadScatter:
        """Band powers and their scatter with one input at a value.

        Raises
        ------
        InputError
            An input that is not explained with, or a value beyond its range.
        """
        if code not in self.tables:
            raise InputError(f"input {code!r}, allowed: {', '.join(self.tables)}")
        item = self.inputs[code]
        if not item.lower <= value <= item.upper:
            raise InputError(f"input {code} is {value:g}, allowed: {item.lower:g} to {item.upper:g}")
        return self.along(code, float(item.distribution.to_unit(value)))

    def along(self, code: str, unit: float) -> LoadScatter:
        """Band powers and their scatter with one input at a place 0 to 1 of its distribution."""
        gain, share, meshes, spread = self._curves[code](unit)
        found = self.nominal.scaled(np.exp(gain), np.exp(meshes[0]), np.ones_like(meshes[0]), np.exp(spread))
        modulated = found.transfer.gain * share.clip(0.0, 1.0)
        return replace(found, transfer=replace(found.transfer, modulated=modulated))

    def only(self, places: Integers) -> CauseCurves:
        """Of some statistics (u,) alone."""
        return CauseCurves(
            self.inputs,
            self.nominal.only(places),
            {code: table.only(places) for code, table in self.tables.items()},
        )

    def powers_along(self, code: str, units: Array) -> tuple[Array, Array]:
        """Gain (v, r, k) and meshes (v, k), as `LoadTransfer` has them, at places (v,) of an input's distribution."""
        found, before = np.asarray(self._curves[code](units)), self.nominal.transfer
        return before.gain * np.exp(found[:, 0]), before.meshes * np.exp(found[:, 2, 0])

    def error(self, code: str) -> Array:
        """Return the standard deviation of a band power's logarithm between the values of an input, (k,).

        Of every other value, from those that are left: the error of twice the distance, which is more than what is
        wanted by four to eight times where the curve is smooth, and as large where it is rough.
        """
        table, factors = self.tables[code], np.ones(len(self.nominal.transfer.gain))
        powers = np.log(np.square(factors) @ table.gain + table.meshes)
        if len(table.unit) < _FEWEST:
            return np.zeros(powers.shape[1])
        coarse = scipy.interpolate.Akima1DInterpolator(table.unit[::2], powers[::2], axis=0, method="makima")
        left = powers[1::2] - coarse(table.unit[1::2])
        left = left[np.isfinite(left).all(axis=1)]  # the last value lies beyond the others if their number is even
        return np.asarray(_ERROR_SHARE * np.sqrt(np.mean(np.square(left), axis=0)))

    @property
    def nominal_place(self) -> tuple[str, float]:
        """Code of an input and the place at which the machine is as it stands."""
        item = self.inputs.inputs[0]
        return item.code, float(item.distribution.to_unit(item.initial))

    @cached_property
    def _curves(self) -> dict[str, Callable[[float | Array], Array]]:
        """By code: what a machine has over the one as it stands at a place, (4, r, k), or at several.

        Logarithms of gain, meshes (the same in every row) and spread; share that is modulated.
        """
        before = self.nominal.transfer
        groups = np.arange(len(before.gain))
        spread = np.sqrt(np.diagonal(self.nominal.falling[groups, groups], axis1=1, axis2=2).clip(0.0))
        found = {}
        for code, table in self.tables.items():
            meshes = _log_ratio(table.meshes, before.meshes)[:, None] + np.zeros_like(table.gain)
            share = table.modulated / np.maximum(table.gain, np.finfo(float).tiny)
            parts = [_log_ratio(table.gain, before.gain), share, meshes, _log_ratio(table.spread, spread)]
            found[code] = scipy.interpolate.Akima1DInterpolator(
                table.unit, np.stack(parts, axis=1), axis=0, method="makima"
            )
        return found


def cause_curves(
    machine: Machine, reading: BandReading, workers: int = WORKERS, progress: CountDone = lambda *_: None
) -> CauseCurves:
    """Compute the curves of a machine at its operating point.

    Parameters
    ----------
    machine : Machine
    reading : BandReading
    workers : int
        Processes; with one, it is done here.
    progress : callable, optional
    """
    inputs = explaining_inputs(machine)
    motion = machine_motion(machine, reading)
    nominal = load_scatter(motion)
    own = _MachineRow.of(motion)
    units, jobs = {}, []
    for item, place in zip(inputs.inputs, inputs.to_unit([[one.initial for one in inputs.inputs]])[0], strict=True):
        even = np.linspace(0.0, 1.0, _cells(item) + 1)
        units[item.code] = np.sort(np.append(even[np.abs(even - place) > _SAME], place))
        values = item.distribution.from_unit(units[item.code])
        jobs += [
            (item.code, number, float(value))
            for number, (value, unit) in enumerate(zip(values, units[item.code], strict=True))
            if unit != place
        ]
    rows = {code: [own] * len(unit) for code, unit in units.items()}
    for (code, number), row in _computed(machine, reading, jobs, workers, progress):
        rows[code][number] = row
    return CauseCurves(inputs, nominal, {code: _MachineRow.table(units[code], found) for code, found in rows.items()})


def _cells(item: Input) -> int:
    return CELLS_OVER_DECADES if item.upper > DECADE * item.lower else CELLS[type(item.distribution)]


@dataclass(frozen=True, eq=False)
class _MachineRow:
    """One machine of a table."""

    gain: Array
    modulated: Array
    meshes: Array
    spread: Array

    @classmethod
    def of(cls, motion: MachineMotion) -> _MachineRow:
        transfer = motion.transfer()
        return cls(transfer.gain, transfer.modulated, transfer.meshes, group_spread(motion))

    @staticmethod
    def table(unit: Array, rows: list[_MachineRow]) -> CurveTable:
        names = ("gain", "modulated", "meshes", "spread")
        return CurveTable(unit, **{name: np.array([getattr(row, name) for row in rows]) for name in names})


Job = tuple[str, int, float]
Done = tuple[tuple[str, int], _MachineRow]


def _computed(machine: Machine, reading: BandReading, jobs: list[Job], workers: int, progress: CountDone) -> list[Done]:
    """Rows of machines, by code and number."""
    if workers == 1:
        return [((code, number), _row(machine, reading, code, value)) for code, number, value in jobs]
    found, context = [], get_context("spawn")
    life, _end_of_life = context.Pipe(duplex=False)  # they end with this process, however it goes
    with ProcessPoolExecutor(workers, context, initializer=prepare_worker, initargs=(life,)) as pool:
        ends = {pool.submit(_row, machine, reading, code, value): (code, number) for code, number, value in jobs}
        for end in as_completed(ends):
            found.append((ends[end], end.result()))
            progress(len(found), len(jobs))
    return found


def _row(machine: Machine, reading: BandReading, code: str, value: float) -> _MachineRow:
    return _MachineRow.of(machine_motion(machine.with_inputs(**{code: value}), reading))


def _log_ratio(values: Array, before: Array) -> Array:
    """Logarithm of values (v, …, k) over those before (…, k); 0 where what is there is rounding of a larger one."""
    least = _FELT * before.reshape(-1, before.shape[-1]).max(axis=0)
    felt = (before > least) & (values > 0.0).all(axis=0)
    ratio = np.where(felt, values, 1.0) / np.where(felt, before, 1.0)
    return np.asarray(np.log(ratio))
