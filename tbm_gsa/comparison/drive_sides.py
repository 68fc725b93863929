"""Torque and speed of the drives, recorded and computed, reduced to moments at every level of operation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import scipy  # its parts load on first use

from tbm_dynamics import Machine
from tbm_dynamics.response import mean_pinion_speed, pinion_torque, rotor_nodes
from tbm_gsa.comparison.drive_moments import DriveBand, DriveMoments, drive_moments
from tbm_gsa.comparison.levels import OperatingHistory
from tbm_gsa.signals.clock import UniformClock, sampling_rate
from tbm_gsa.signals.settings import MODEL_RATE_HZ, Settings
from tbm_msgs_py.base.arrays import Array, Flags
from tbm_msgs_py.base.causal_filter import CausalFilter
from tbm_msgs_py.base.drive_state import drive_name
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.recordings.drives import DriveRecord

if TYPE_CHECKING:  # the live comparison needs no simulator
    from tbm_dynamics.integration.simulator import Chunk

USABLE: Final = 0.9
"""Share of the samples that hold a number from which on a drive is compared."""
SETTLED_S, SETTLED_PERIODS = 1.0, 2.0
"""Begin of a run that the filters need: that long, or so many periods of the highest frequency, half of it at most."""
ANTI_ALIAS_ORDER, ANTI_ALIAS_SHARE = 8, 0.45


@dataclass(frozen=True, eq=False)
class FieldDrives:
    """The recorded side.

    Attributes
    ----------
    numbers : tuple of int
        Of the drives that are compared; the columns of all moments.
    band : DriveBand
    levels : dict of int to DriveMoments
        By level of operation.
    speeds : bool
        Whether any speed is recorded.
    skipped : dict of str to str
        Why a drive is not compared, or one of its quantities.
    invalid : int
        Samples left out for a value that is no number.
    """

    numbers: tuple[int, ...]
    band: DriveBand
    levels: dict[int, DriveMoments]
    speeds: bool
    skipped: dict[str, str]
    invalid: int


def field_drives(
    record: DriveRecord, machine: Machine, history: OperatingHistory, low_pass_hz: float | None, settings: Settings
) -> FieldDrives:
    """Reduce the recorded drives.

    Raises
    ------
    InputError
        No drive of the machine, no sampling rate, or no sample at a level of operation.
    """
    count = machine.description.driveshaft.count
    usable, skipped = _usable(record, machine)
    numbers = tuple(int(number) for number in np.flatnonzero(usable[0] | usable[1]) + 1 if number <= count)
    if not numbers:
        raise InputError("; ".join(f"{name}: {why}" for name, why in skipped.items()))
    columns = np.array(numbers) - 1
    kept, values = usable[:, columns].ravel(), np.hstack([record.torque[:, columns], record.speed[:, columns]])
    known = np.asarray(np.isfinite(values[:, kept]).all(axis=1), np.bool_)
    if not known.any():
        raise InputError("no time at which every drive has a number, allowed: at least two")
    rate = sampling_rate(record.time[known])
    band = DriveBand.of(rate, low_pass_hz, settings)
    time, uniform = _uniform(record.time[known], values[np.ix_(known, kept)], band)
    filled = np.full((len(time), len(kept)), np.nan)
    filled[:, kept] = uniform
    at = history.level_of(record.start_ns)(time, time)
    window = np.floor(time / band.window_s).astype(np.int64)
    levels = {
        int(level): drive_moments(window[at == level], filled[at == level], band) for level in np.unique(at[at >= 0])
    }
    if not levels:
        raise InputError("no sample at a steady level of operation")
    speeds = bool(kept[len(numbers) :].any())
    return FieldDrives(numbers, band, levels, speeds, skipped, int(np.count_nonzero(~known)))


def _usable(record: DriveRecord, machine: Machine) -> tuple[Flags, dict[str, str]]:
    """Whether torque and speed of a drive can be compared, (2, p), and why drives of record or machine cannot."""
    count, skipped = machine.description.driveshaft.count, dict[str, str]()
    usable = np.zeros((2, max(count, record.torque.shape[1])), np.bool_)
    recorded = [bool(np.isfinite(one).any()) for one in (record.torque, record.speed)]
    for number in range(1, usable.shape[1] + 1):
        shares = [
            float(np.isfinite(one[:, number - 1]).mean()) if number <= one.shape[1] else 0.0
            for one in (record.torque, record.speed)
        ]
        if number > count:
            if any(shares):
                skipped[drive_name(number)] = f"machine {machine.name} has {count} drives"
            continue
        usable[:, number - 1] = np.array(shares) >= USABLE
        lacking = [
            f"{share:.0%} of its {what}s are numbers, allowed: {USABLE:.0%} or more"
            for what, share, there in zip(("torque", "speed"), shares, recorded, strict=True)
            if there and share < USABLE
        ]
        if lacking or not any(shares):
            skipped[drive_name(number)] = "; ".join(lacking) if any(shares) else "not in the recording"
    return usable, skipped


def _uniform(time: Array, values: Array, band: DriveBand) -> tuple[Array, Array]:
    """Low-passed values on a uniform clock, gaps left out: times (m,) and (m, c)."""
    clock, runs, parts = UniformClock(band.rate_hz, values.shape[1]), list[tuple[list[Array], list[Array]]](), []
    for run in (*clock.feed(time, values), *clock.finish()):
        if not run.joined:
            runs.append(([], []))
        runs[-1][0].append(run.time)
        runs[-1][1].append(run.values)
    for times, rows in runs:
        parts.append((np.concatenate(times), band.low_passed(np.concatenate(rows))))
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def recorder_filter(band: DriveBand, rate_hz: float) -> Array:
    """Filter of a model of a rate before it is sampled: the recorder's, or one that leaves nothing to fold back."""
    order, corner = ANTI_ALIAS_ORDER, ANTI_ALIAS_SHARE * band.rate_hz
    if band.low_pass_hz is not None and band.low_pass_hz < rate_hz / 2.0:
        order, corner = 1, band.low_pass_hz
    return np.asarray(scipy.signal.butter(order, corner, fs=rate_hz, output="sos"))


class DriveReducer:
    """The computed side: reduces the drives of a run that comes in chunks, at the sampling rate of the recording.

    Parameters
    ----------
    machine : Machine
        At the level of operation.
    field : FieldDrives
        What of it is wanted.
    duration : float
        Of the run, s.
    rate_hz : float
        Of its steps.

    Attributes
    ----------
    nodes : tuple of int
        Nodes whose motion is wanted: the rotors, where speeds are.

    Raises
    ------
    InputError
        A recording of more samples than the run has.
    """

    def __init__(self, machine: Machine, field: FieldDrives, duration: float, rate_hz: float = MODEL_RATE_HZ) -> None:
        self._machine, self._band, self._columns = machine, field.band, np.array(field.numbers) - 1
        self.nodes = rotor_nodes(machine) if field.speeds else ()
        self._mean_speed = mean_pinion_speed(machine, machine.operating_point.speed)
        if field.band.rate_hz > rate_hz:
            raise InputError(f"a rate of {field.band.rate_hz:.6g} Hz, allowed: up to that of the model, {rate_hz:g} Hz")
        self._rate, self._stride = rate_hz, rate_hz / field.band.rate_hz
        self._filter = CausalFilter(recorder_filter(field.band, rate_hz))
        self._begin = min(max(SETTLED_S, SETTLED_PERIODS / field.band.high_hz), 0.5 * duration)
        self._angle: Array | None = None
        self._steps = self._sampled = 0  # done, and samples taken of them
        self._rows: list[Array] = []

    def feed(self, chunk: Chunk) -> None:
        """Add the next chunk, whose last nodes are `nodes`."""
        torque = pinion_torque(self._machine, chunk.mesh_force)
        values = np.hstack([torque[:, self._columns], self._speed(chunk)[:, self._columns]])
        values = self._filter.process(values)
        count = int(np.ceil((self._steps + len(values)) / self._stride - 1e-9)) - self._sampled
        steps = np.floor((self._sampled + np.arange(count)) * self._stride + 1e-9).astype(np.int64)
        self._rows.append(values[steps - self._steps])
        self._steps, self._sampled = self._steps + len(values), self._sampled + count

    def _speed(self, chunk: Chunk) -> Array:
        """Speed of each drive (n, p): the mean, and the rate of its rotor's angle where it is wanted."""
        speed = np.tile(self._mean_speed, (len(chunk.mesh_force), 1))
        if not self.nodes:
            return speed
        angle = chunk.displacement[:, -len(self.nodes) :, 3]
        before = angle[:1] if self._angle is None else self._angle
        self._angle = angle[-1:].copy()
        return np.asarray(speed + np.diff(angle, axis=0, prepend=before) * self._rate)

    def finish(self) -> DriveMoments:
        """Moments behind the begin of the run; an `InputError` where it has no sample there."""
        values = self._band.low_passed(np.concatenate(self._rows))
        time = np.arange(len(values)) / self._band.rate_hz - self._begin
        settled = time >= 0.0
        if not settled.any():
            rate = self._band.rate_hz
            raise InputError(f"the run of the model holds no sample at {rate:g} Hz, allowed: a longer one")
        window = np.floor(time[settled] / self._band.window_s).astype(np.int64)
        return drive_moments(window, values[settled], self._band)
