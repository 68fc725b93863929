"""How a machine is driven, and its place in a `sensor_msgs/JointState`, without ROS."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Protocol

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.texts import doubled

CUTTERHEAD, THRUST = "cutterhead", "thrust"
LARGEST = 1e15  # of any value in SI units: no machine is near it, and its unit and square can still be computed


class OperatingPointError(InputError):
    """Values, or a joint state, that are no operating point."""


@dataclass(frozen=True)
class OperatingPoint:
    """How the machine is driven, about and along x.

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

    Raises
    ------
    OperatingPointError
        A value that is not finite, or beyond `LARGEST`.
    """

    speed: float
    torque: float
    thrust: float
    head_angle: float = 0.0
    advance: float = 0.0

    def __post_init__(self) -> None:
        if not all(abs(value) <= LARGEST for value in astuple(self)):
            raise OperatingPointError(
                f"operating point: a value that is not finite or absurd, allowed: up to {LARGEST:g} in SI units"
            )

    @property
    def standstill(self) -> bool:
        """Whether the head does not turn; how it is pressed on meanwhile does not matter."""
        return self.speed == 0.0 and self.torque >= 0.0 and self.thrust >= 0.0

    def joints(self) -> tuple[list[str], list[float], list[float], list[float]]:
        """Names, positions, velocities and efforts of the joint state."""
        return (
            [CUTTERHEAD, THRUST],
            [float(self.head_angle), 0.0],
            [float(self.speed), float(self.advance)],
            [float(self.torque), float(self.thrust)],
        )


class JointState(Protocol):
    """A `sensor_msgs/JointState` of rclpy or of a library that reads recordings."""

    name: list[str]
    position: list[float]
    velocity: list[float]
    effort: list[float]


def from_joint_state(message: JointState) -> OperatingPoint:
    """Operating point of a joint state; positions may be left out.

    Raises
    ------
    OperatingPointError
        A joint is missing or doubled, or a value missing or not finite.
    """
    names = list(message.name)
    if twice := doubled(names):
        raise OperatingPointError(f"operating point joints: {twice} twice, allowed: each name once")
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
    if len(message.position) not in (0, len(names)):
        raise OperatingPointError(
            f"operating point: {len(message.position)} positions, allowed: {len(names)}, or none at all"
        )
    return OperatingPoint(
        speed=float(message.velocity[head]),
        torque=float(message.effort[head]),
        thrust=float(message.effort[thrust]),
        head_angle=float(message.position[head]) if len(message.position) else 0.0,
        advance=float(message.velocity[thrust]),
    )
