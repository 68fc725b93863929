"""The operating point a recording was made at, as one level."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tbm_dynamics import Machine, MachineError
from tbm_gsa.arrays import Array
from tbm_msgs_py.bags.errors import RecordingError
from tbm_msgs_py.recording import Recording

R_MIN = 2.0 * math.pi / 60.0  # rad/s


@dataclass(frozen=True)
class Operating:
    """Level the model runs at.

    Attributes
    ----------
    speed_r_min, torque_kn_m, thrust_kn : float
        Inputs x1, x2, x3.
    source : {"recording", "machine"}
        Where it comes from.
    note : str
        How it was found.
    """

    speed_r_min: float
    torque_kn_m: float
    thrust_kn: float
    source: Literal["recording", "machine"]
    note: str

    def apply(self, machine: Machine) -> Machine:
        """Set the machine to this level, if it is not the machine's own."""
        if self.source == "machine":
            return machine
        return machine.with_inputs(x1=self.speed_r_min, x2=self.torque_kn_m, x3=self.thrust_kn)


def operating_level(recording: Recording, machine: Machine) -> Operating:
    """Find the level of a recording: its time-weighted mean while the machine is driven, else the machine's own.

    An entry holds until the next one, the last until the recording ends; one without speed, torque or thrust is a
    standstill and left out.

    Raises
    ------
    RecordingError
        Operating points, and all of them standstills or outside what the machine allows.
    """
    if recording.operating_point is None:
        own = machine.description.operating_point
        note = "the recording holds none: the machine's own"
        return Operating(own.speed_r_min, own.torque_kn_m, own.thrust_kn, "machine", note)
    levels = np.array([(p.speed, p.torque, p.thrust) for p in recording.operating_point.points]) / (R_MIN, 1e3, 1e3)
    driven = (levels > 0.0).all(axis=1)
    if not driven.any():
        raise RecordingError(
            f"{recording.path}: operating point: never driven, allowed: positive speed, torque and thrust at some time"
        )
    hold = _hold_times(recording)[driven]
    speed, torque, thrust = np.average(levels[driven], axis=0, weights=hold if hold.any() else None).tolist()
    note = _note(levels[driven], int(np.count_nonzero(~driven)))
    level = Operating(speed, torque, thrust, "recording", note)
    try:
        level.apply(machine)
    except MachineError as error:
        raise RecordingError(f"{recording.path}: operating point: {error}") from error
    return level


def _hold_times(recording: Recording) -> Array:
    """How long each operating point holds while accelerations are recorded, s."""
    entries = recording.operating_point
    assert entries is not None  # noqa: S101 - asked for only then
    records = recording.points.values()
    begin = min(record.start_ns - entries.start_ns for record in records) * 1e-9
    end = max((record.start_ns - entries.start_ns) * 1e-9 + record.duration for record in records)
    return np.diff(np.clip(entries.time, begin, end), append=end)


def _note(levels: Array, standstills: int) -> str:
    distinct = len(np.unique(levels, axis=0))
    text = "recorded" if distinct == 1 else f"time-weighted mean of {distinct} recorded levels"
    return text + (f"; entries at standstill left out: {standstills}" if standstills else "")
