"""Torque and speed of the drives in a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.drive_state import drive_name, from_joint_state
from tbm_msgs_py.base.operating_point import JointState
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.recordings.clocks import ClockTrack
from tbm_msgs_py.recordings.joint_states import ClockName, JointStates
from tbm_msgs_py.recordings.mapping import DriveMapping


@dataclass(frozen=True, eq=False)
class DriveRecord:
    """Torque and speed of the drives over time, on the side of the pinions and on the clock of the sensors.

    Attributes
    ----------
    start_ns : int
        Time of the first entry, ns.
    time : ndarray (n,)
        Time after `start_ns`, s, strictly increasing.
    torque, speed : ndarray (n, p)
        N·m and rad/s of the drives 1 to p; NaN where nothing is known.
    duplicates : int
        Entries dropped for a time that was there already.
    clock : {"header stamps", "log times"}
        Where the times come from.
    doubt : str
        Why the header stamps are not used; empty when they are.
    """

    start_ns: int
    time: Array
    torque: Array
    speed: Array
    duplicates: int = 0
    clock: ClockName = "header stamps"
    doubt: str = ""

    @property
    def end_ns(self) -> int:
        """Time of the last entry, ns."""
        return self.start_ns + round(float(self.time[-1]) * NANOSECONDS)

    @property
    def rate_hz(self) -> float:
        """From the median step; 0 of a single entry."""
        return 1.0 / float(np.median(np.diff(self.time))) if len(self.time) > 1 else 0.0

    def known(self, quantity: Literal["torque", "speed"]) -> dict[str, float]:
        """Share of the entries that hold a number, by drive, of the drives that have one."""
        shares = np.isfinite(getattr(self, quantity)).mean(axis=0).tolist()
        return {drive_name(number): share for number, share in enumerate(shares, start=1) if share}


class DriveEntries(JointStates[Array]):
    """Collects what the drives do while a recording is read, 0.4 kB a message of ten drives."""

    def __init__(self, mapping: DriveMapping) -> None:
        super().__init__(_torque_and_speed, latched=False)
        self._factors = np.array([[mapping.ratio], [1.0 / mapping.ratio]])

    def record(self, clock: ClockTrack | None = None) -> DriveRecord | None:
        """All so far, placed; None without any. Of entries at one time the first is kept."""
        if (found := self.placed(clock)) is None:
            return None
        kept = np.diff(found.time, prepend=-1.0) > 0.0
        torque, speed = (stacked(found.states) * self._factors)[kept].transpose(1, 0, 2)
        again = int(np.count_nonzero(~kept))
        return DriveRecord(found.start_ns, found.time[kept], torque, speed, again, found.clock, found.doubt)


def stacked(states: Sequence[Array]) -> Array:
    """Torque and speed of states (2, k), each of so many drives as it names, as (n, 2, p); NaN for the others."""
    values = np.full((len(states), 2, max(state.shape[1] for state in states)), np.nan)
    for row, state in zip(values, states, strict=True):
        row[:, : state.shape[1]] = state
    return values


def drive_record(rows: Sequence[tuple[int, Array]]) -> DriveRecord:
    """Record of stamps (ns), strictly increasing, and states (2, k)."""
    start = rows[0][0]
    torque, speed = stacked([state for _, state in rows]).transpose(1, 0, 2)
    return DriveRecord(start, np.array([stamp - start for stamp, _ in rows]) / NANOSECONDS, torque, speed)


def _torque_and_speed(message: JointState) -> Array:
    """Values of a message, (2, p): a fraction of the memory of a `DriveState`."""
    state = from_joint_state(message)
    return np.array([state.torque, state.speed])
