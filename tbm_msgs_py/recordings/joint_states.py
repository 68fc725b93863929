"""Joint states of one topic while a recording is read: decoded one by one, placed on the clock of the sensors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, Literal, NamedTuple, TypeVar

import numpy as np
from rosbags.typesys.store import Typestore

from tbm_msgs_py.bags.batch import MessageBatch
from tbm_msgs_py.bags.definitions import JOINT_STATE_TYPE, UNDECODABLE, other_encoding
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.operating_point import JointState
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.blocks import StampError, stamp_to_ns
from tbm_msgs_py.recordings.clocks import ClockTrack

ClockName = Literal["header stamps", "log times"]
StateT = TypeVar("StateT")


class PlacedStates(NamedTuple, Generic[StateT]):
    """States in the order of time, on the clock of the sensors.

    Attributes
    ----------
    start_ns : int
        Time of the first, ns.
    time : ndarray (n,)
        Time after `start_ns`, s.
    states : list
    clock : {"header stamps", "log times"}
        Where the times come from.
    doubt : str
        Why the header stamps are not used; empty when they are.
    """

    start_ns: int
    time: Array
    states: list[StateT]
    clock: ClockName
    doubt: str


class JointStates(Generic[StateT]):
    """Collects the joint states of a topic.

    Parameters
    ----------
    read : callable
        From a message to what it says; raises a ValueError for one that says nothing.
    latched : bool
        Whether the first may be older than the recording.

    Attributes
    ----------
    undecodable : int
        Messages that say nothing.
    problem : str
        What was wrong with the first of those.
    """

    def __init__(self, read: Callable[[JointState], StateT], *, latched: bool) -> None:
        self.undecodable, self.problem = 0, ""
        self._read, self._latched = read, latched
        self._entries: list[tuple[int | None, int, StateT]] = []  # stamp, log time
        self._no_time = ""

    def add(self, messages: MessageBatch, store: Typestore) -> None:
        """Add the joint states of a batch, decoded by the definitions of a store."""
        for message in messages.raw():
            try:
                if other := other_encoding(message.data):
                    raise ValueError(other)
                joints = store.deserialize_cdr(message.data, JOINT_STATE_TYPE)
                state = self._read(joints)  # type: ignore[arg-type]
                stamp = self._stamp(joints)
            except (*UNDECODABLE, AttributeError, TypeError) as error:
                self.undecodable += 1
                self.problem = self.problem or str(error) or type(error).__name__
                continue
            self._entries.append((stamp, message.log_ns, state))

    def _stamp(self, joints: object) -> int | None:
        try:
            return stamp_to_ns(joints.header.stamp)  # type: ignore[attr-defined]
        except StampError as error:
            self._no_time = self._no_time or str(error)
            return None

    def placed(self, clock: ClockTrack | None = None) -> PlacedStates[StateT] | None:
        """All so far in the order of time, on the clock of the sensors; None without any.

        Header stamps are used if they fit that clock. If one does not, log times are used for all. The first entry of a
        latched topic is often older than the recording: that is no fault.
        """
        if not self._entries:
            return None
        log = np.array([entry[1] for entry in self._entries], np.int64)
        stamps = np.array([-1 if stamp is None else stamp for stamp, *_ in self._entries], np.int64)
        times, doubt = self._times(stamps, log, clock) if clock else (stamps, self._no_time)
        if doubt and len(log) > 1 and clock and not clock.dated:
            self.problem = f"{doubt}, which are all the same"
            return None
        order = np.argsort(times, kind="stable")
        name: ClockName = "log times" if doubt else "header stamps"
        start = int(times[order[0]])
        time: Array = (times[order] - start) / NANOSECONDS
        return PlacedStates(start, time, [self._entries[k][2] for k in order], name, doubt)

    def _times(self, stamps: Integers, log: Integers, clock: ClockTrack) -> tuple[Integers, str]:
        """Find the times of the entries, and why they are not the header stamps."""
        fits = clock.fits(stamps, log)
        first = int(np.argmin(log))
        if self._latched and 0 < stamps[first] < clock.stamps_at(log)[first]:
            fits[first] = True
        if fits.all():
            return stamps, ""
        worst = int(np.flatnonzero(~fits)[0])
        if stamps[worst] < 0:
            reason = self._no_time
        elif stamps[worst] == 0:
            reason = "the stamp is 0"
        else:
            away = (stamps[worst] - clock.stamps_at(log)[worst]) * 1e-9
            reason = f"{abs(away):.3f} s {'ahead of' if away > 0 else 'behind'} the sensors'"
        count = f"{np.count_nonzero(~fits)} of {len(fits)} header stamps do not fit the clock of the sensors ({reason})"
        return clock.stamps_at(log), f"{count}: placed by the log times"
