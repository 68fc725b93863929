"""The operating point of the machine and its place in a `sensor_msgs/JointState`, without ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

CUTTERHEAD, THRUST = "cutterhead", "thrust"


class OperatingPointError(ValueError):
    """A joint state that is no operating point, in one line."""


@dataclass(frozen=True)
class OperatingPoint:
    """How the machine is driven.

    Attributes
    ----------
    speed : float
        Speed of the cutterhead, rad/s.
    torque : float
        Torque on the cutterhead, N·m.
    thrust : float
        Thrust force, N.
    head_angle : float
        Angle of the cutterhead, rad.
    advance : float
        Advance speed, m/s.
    """

    speed: float
    torque: float
    thrust: float
    head_angle: float = 0.0
    advance: float = 0.0

    def joints(self) -> tuple[list[str], list[float], list[float], list[float]]:
        """Names, positions, velocities and efforts of the joint state."""
        return (
            [CUTTERHEAD, THRUST],
            [float(self.head_angle), 0.0],
            [float(self.speed), float(self.advance)],
            [float(self.torque), float(self.thrust)],
        )


def from_joint_state(message: Any) -> OperatingPoint:
    """Read a `sensor_msgs/JointState` (of rclpy or of a bag library); positions may be left out."""
    names = list(message.name)
    for name in (CUTTERHEAD, THRUST):
        if name not in names:
            raise OperatingPointError(
                f"operating point joints: {', '.join(names) or 'none'}, allowed: both {CUTTERHEAD}, {THRUST}"
            )
    head, thrust = names.index(CUTTERHEAD), names.index(THRUST)
    if len(message.velocity) != len(names) or len(message.effort) != len(names):
        raise OperatingPointError(
            f"operating point: {len(message.velocity)} velocities and {len(message.effort)} efforts, "
            f"allowed: {len(names)} each"
        )
    point = OperatingPoint(
        speed=float(message.velocity[head]),
        torque=float(message.effort[head]),
        thrust=float(message.effort[thrust]),
        head_angle=float(message.position[head]) if len(message.position) == len(names) else 0.0,
        advance=float(message.velocity[thrust]),
    )
    if not all(map(math.isfinite, (point.speed, point.torque, point.thrust, point.head_angle, point.advance))):
        raise OperatingPointError("operating point: a value that is not finite, allowed: finite numbers")
    return point
