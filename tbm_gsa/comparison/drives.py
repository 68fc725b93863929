"""The drives of a recording held against the model: how they share the torque, how it fluctuates, which one is off."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Final

import numpy as np

from tbm_dynamics import Machine
from tbm_gsa.comparison.drive_moments import DriveMoments
from tbm_gsa.comparison.drive_results import DriveResult, DriveSide, DrivesResult, SharingSide
from tbm_gsa.comparison.drive_sides import DriveReducer, FieldDrives, field_drives
from tbm_gsa.comparison.levels import OperatingHistory
from tbm_gsa.comparison.results import finite
from tbm_gsa.signals.settings import Settings
from tbm_gsa.signals.statistics import ratio, relative_error
from tbm_msgs_py.base.arrays import Flags
from tbm_msgs_py.base.drive_state import drive_name
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.recordings.drives import DriveRecord
from tbm_msgs_py.recordings.mapping import DriveMapping

RUNNING: Final = 0.1
"""Share of the strongest drive's torque from which on a drive runs."""
UNEQUAL: Final = 0.054
"""Difference of a share from the model's that is named: three times the 1.8 % that motors of a real machine scatter."""
UNITS: Final = {1e-3: "kN·m", 1e-6: "MN·m"}
NEAR: Final = 1.5
"""Largest factor between a unit or a ratio and what was found."""


class DriveComparison:
    """The drives of a recording, from what was read to the result; what is wrong with them ends no comparison.

    Parameters
    ----------
    record : DriveRecord or None
    mapping : DriveMapping
        How it was recorded.
    machine : Machine
    history : OperatingHistory
    settings : Settings

    Attributes
    ----------
    result : DrivesResult or None
        Once the model was run; None where nothing can be compared.
    problems : tuple of str
        Why nothing can be, where there is a record.
    """

    def __init__(
        self,
        record: DriveRecord | None,
        mapping: DriveMapping,
        machine: Machine,
        history: OperatingHistory,
        settings: Settings,
    ) -> None:
        self._machine, self._mapping, self._record = machine, mapping, record
        self._reducers: dict[int, DriveReducer] = {}
        self._field: FieldDrives | None = None
        self.result: DrivesResult | None = None
        self.problems: tuple[str, ...] = ()
        if record is not None:
            with self._noted():
                self._field = field_drives(record, machine, history, mapping.low_pass_hz, settings)

    @property
    def levels(self) -> set[int]:
        """Levels of operation that the model is to be run at."""
        return set() if self._field is None else set(self._field.levels)

    def reducer(self, level: int, machine: Machine, duration: float, rate_hz: float) -> DriveReducer | None:
        """Return what is to be fed with the run at a level, if it is wanted."""
        if self._field is not None and level in self._field.levels:
            with self._noted():
                self._reducers[level] = DriveReducer(machine, self._field, duration, rate_hz)
        return self._reducers.get(level)

    def finish(self) -> None:
        """Compare with the runs."""
        if self._record is not None and self._field is not None and not self.problems:
            with self._noted():
                model = {level: reducer.finish() for level, reducer in self._reducers.items()}
                self.result = compare_drives(self._record, self._field, model, self._machine, self._mapping)

    @contextmanager
    def _noted(self) -> Iterator[None]:
        try:
            yield
        except InputError as error:
            self.problems = (f"drives {self._mapping.topic}: not compared: {error}",)


def compare_drives(
    record: DriveRecord,
    field: FieldDrives,
    model: Mapping[int, DriveMoments],
    machine: Machine,
    mapping: DriveMapping,
) -> DrivesResult:
    """Hold the recorded drives against the model's at the levels that it was run at.

    Raises
    ------
    InputError
        No sample at one of these levels.
    """
    seen = {level: moments.samples for level, moments in field.levels.items() if level in model}
    if not seen:
        raise InputError("no sample at a steady level of operation")
    shares = {level: samples / sum(seen.values()) for level, samples in seen.items()}
    recorded, computed = (DriveMoments.joined(levels, shares) for levels in (field.levels, model))
    known = np.isfinite(recorded.torque)
    names = [drive_name(number) for number in field.numbers]
    sides = [dict(zip(names, _each_drive(one), strict=True)) for one in (recorded, computed)]
    return DrivesResult(
        topic=mapping.topic,
        rate_hz=field.band.rate_hz,
        high_hz=field.band.high_hz,
        low_pass_hz=field.band.low_pass_hz,
        window_s=field.band.window_s,
        samples=recorded.samples,
        windows=recorded.windows,
        model_windows=computed.windows,
        duplicates=record.duplicates,
        invalid=field.invalid,
        field=_sharing(recorded, known),
        model=_sharing(computed, known),
        drives={name: _drive(sides[0][name], sides[1][name]) for name in names},
        skipped=field.skipped,
        findings=(
            *_not_compared(recorded, computed, field.band.window_s),
            *_wrong_side(recorded, computed, machine),
            *_odd_drives(*sides),
        ),
    )


def running(moments: DriveMoments) -> Flags:
    """Which drives (p,) run."""
    torque = np.abs(moments.torque)
    return np.asarray(torque > RUNNING * np.max(torque, where=np.isfinite(torque), initial=0.0), np.bool_)


def _each_drive(moments: DriveMoments) -> Iterator[DriveSide]:
    runs = running(moments)
    mean = float(moments.torque[runs].mean()) if runs.any() else math.nan
    deviation = np.sqrt(np.diag(moments.covariance))
    for k in range(len(runs)):
        speed = float(moments.speed[k])
        yield DriveSide(
            torque=finite(float(moments.torque[k])),
            share=finite(float(ratio(moments.torque[k], mean))),
            fluctuation=finite(float(ratio(deviation[k], abs(moments.torque[k])))) if runs[k] else None,
            peak_factor=finite(float(moments.peak_factor[k])) if runs[k] else None,
            speed=finite(speed),
            speed_fluctuation=finite(float(ratio(math.sqrt(moments.speed_variance[k]), abs(speed)))),
            running=bool(runs[k]),
        )


def _sharing(moments: DriveMoments, known: Flags) -> SharingSide:
    """How the drives whose torque is recorded share it."""
    runs = running(moments) & known
    torque, covariance = moments.torque[runs], moments.covariance[np.ix_(runs, runs)]
    count = len(torque)
    total = float(moments.torque[known].sum()) if known.any() else math.nan
    if not count:
        unknown = SharingSide.model_fields.keys() - {"running", "torque"}
        return SharingSide.model_validate({"running": 0, "torque": finite(total), **dict.fromkeys(unknown)})
    mean = float(torque.mean())
    # Variance between the drives at a time, mean over the time, from the second moments of all of them.
    second = covariance + np.outer(torque, torque)
    between = max(0.0, float(np.trace(second) / count - second.mean()))
    deviation = np.sqrt(np.diag(covariance))
    pairs = ratio(covariance, np.outer(deviation, deviation))[~np.eye(count, dtype=np.bool_)]
    return SharingSide(
        running=count,
        torque=finite(total),
        fluctuation=finite(float(ratio(math.sqrt(max(0.0, covariance.sum())), abs(total)))),
        sharing_factor=finite(float((torque / mean).max())),
        least_share=finite(float((torque / mean).min())),
        scatter=finite(math.sqrt(between) / abs(mean)),
        correlation=finite(float(pairs.mean())) if pairs.size else None,
    )


def _drive(field: DriveSide, model: DriveSide) -> DriveResult:
    pair = [math.nan if side.torque is None else side.torque for side in (field, model)]
    error = float(relative_error(*pair))
    return DriveResult(field=field, model=model, relative_error=finite(abs(error)))


def _not_compared(field: DriveMoments, model: DriveMoments, window_s: float) -> Iterator[str]:
    """Say which side is too short for a fluctuation, and that nothing runs."""
    if np.isfinite(field.torque).any() and not running(field).any():
        yield "no drive carries torque in the recording"
    for what, moments in (("recording", field), ("run of the model", model)):
        if not moments.windows:
            yield f"the {what} holds no window of {window_s:.4g} s at one level: its fluctuation is not known"


def _wrong_side(field: DriveMoments, model: DriveMoments, machine: Machine) -> Iterator[str]:
    """Name a sign, a unit or a side of the gearbox that all torques or all speeds may be in."""
    gearbox = machine.description.driveshaft.gearbox.ratio
    known = np.isfinite(field.torque)
    share = float(ratio(field.torque[known].sum(), model.torque[known].sum()))
    if share < 0.0:
        yield f"the torques add up to {share:.2g} of the model's: another sign?"
    factors = {1.0 / gearbox: "values of the motors, without the key ratio?"} if gearbox > NEAR**2 else {}
    factors |= {factor: f"values in {unit} where the message has N·m?" for factor, unit in UNITS.items()}
    for factor, text in factors.items():
        if factor / NEAR < abs(share) < factor * NEAR:
            yield f"the torques add up to {abs(share):.2g} of the model's: {text}"
    turning = float(np.nanmedian(ratio(field.speed, model.speed))) if np.isfinite(field.speed).any() else math.nan
    if gearbox > NEAR**2 and gearbox / NEAR < abs(turning) < gearbox * NEAR:
        yield f"the speeds are {abs(turning):.3g} times the model's: values of the motors, without the key ratio?"


def _odd_drives(field: Mapping[str, DriveSide], model: Mapping[str, DriveSide]) -> Iterator[str]:
    """Name the drives that are off on one side only, and those whose share differs."""
    for name, found in field.items():
        expected = model[name]
        if found.share is None or expected.share is None:
            continue
        if found.running != expected.running:
            here, there = ("runs" if side.running else "is off" for side in (found, expected))
            yield f"{name} {here} in the recording, with {found.share:.2%} of the mean, and {there} in the model"
        elif found.running and abs(found.share - expected.share) > UNEQUAL:
            yield f"{name} carries {found.share:.3f} of the mean torque, in the model {expected.share:.3f}"
