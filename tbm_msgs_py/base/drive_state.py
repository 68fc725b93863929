"""Torque and speed of the drives, and their place in a `sensor_msgs/JointState`, without ROS."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.operating_point import LARGEST, JointState
from tbm_msgs_py.base.texts import doubled, listed

MOST_DRIVES = 40
_NAME = re.compile(r"drive_([1-9]\d?)", re.ASCII)


class DriveStateError(InputError):
    """A joint state that says nothing of any drive."""


def drive_name(number: int) -> str:
    """Joint of a drive, by its number from 1."""
    return f"drive_{number}"


@dataclass(frozen=True)
class DriveState:
    """What the drives do at one time, on the side of their pinions; NaN where nothing is known.

    Attributes
    ----------
    torque : tuple of float
        N·m, of the drives 1, 2 …
    speed : tuple of float
        rad/s, likewise.
    """

    torque: tuple[float, ...]
    speed: tuple[float, ...]

    def joints(self) -> tuple[list[str], list[float], list[float]]:
        """Names, velocities and efforts of the joint state; an array is empty where it would hold no number."""
        names = [drive_name(number) for number in range(1, len(self.torque) + 1)]
        velocity, effort = (
            [] if all(map(math.isnan, one)) else [*map(float, one)] for one in (self.speed, self.torque)
        )
        return names, velocity, effort


def from_joint_state(message: JointState) -> DriveState:
    """State of the drives in a joint state, whatever their order; other joints do not matter.

    A value that is not finite, or beyond `LARGEST`, is NaN.

    Raises
    ------
    DriveStateError
        No joint is a drive, a name stands twice, or arrays do not fit the names.
    """
    names = list(message.name)
    if twice := doubled(names):
        raise DriveStateError(f"drive joints: {twice} twice, allowed: each name once")
    places = {int(found[1]): place for place, name in enumerate(names) if (found := _NAME.fullmatch(name))}
    numbers = [number for number in places if number <= MOST_DRIVES]
    if not numbers:
        raise DriveStateError(f"drive joints: {listed(names)}, allowed: drive_1 to drive_{MOST_DRIVES}")
    if not len(message.effort) and not len(message.velocity):
        raise DriveStateError("drives: neither efforts nor velocities, allowed: one for each name")
    for what, values in (("efforts", message.effort), ("velocities", message.velocity)):
        if len(values) not in (0, len(names)):
            raise DriveStateError(f"drives: {len(values)} {what}, allowed: {len(names)}, or none at all")
    columns = [places.get(number) for number in range(1, max(numbers) + 1)]
    return DriveState(_picked(message.effort, columns), _picked(message.velocity, columns))


def _picked(values: Sequence[float], places: Sequence[int | None]) -> tuple[float, ...]:
    """Values at places, NaN where there is none."""
    found = (float(values[place]) if place is not None and len(values) else math.nan for place in places)
    return tuple(value if abs(value) <= LARGEST else math.nan for value in found)
