"""The operating points of a recording."""

from __future__ import annotations

from dataclasses import dataclass

from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.operating_point import OperatingPoint, from_joint_state
from tbm_msgs_py.recordings.clocks import ClockTrack
from tbm_msgs_py.recordings.joint_states import ClockName, JointStates


@dataclass(frozen=True)
class OperatingRecord:
    """Operating point over time, on the clock of the sensors.

    Attributes
    ----------
    start_ns : int
        Time of the first entry, ns.
    time : ndarray (n,)
        Time after `start_ns`, s.
    points : tuple of OperatingPoint
        One each time.
    clock : {"header stamps", "log times"}
        Where the times come from.
    doubt : str
        Why the header stamps are not used; empty when they are.
    """

    start_ns: int
    time: Array
    points: tuple[OperatingPoint, ...]
    clock: ClockName = "header stamps"
    doubt: str = ""


class OperatingPoints(JointStates[OperatingPoint]):
    """Collects operating points while a recording is read."""

    def __init__(self) -> None:
        super().__init__(from_joint_state, latched=True)

    def record(self, clock: ClockTrack | None = None) -> OperatingRecord | None:
        """All so far, placed; None without any. The first holds from the begin on, however old it is."""
        if (found := self.placed(clock)) is None:
            return None
        return OperatingRecord(found.start_ns, found.time, tuple(found.states), found.clock, found.doubt)
