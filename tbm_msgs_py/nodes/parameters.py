"""Declaration of ROS parameters: type, range, description, and when a value may change."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.texts import LONGEST_NAME, shortened

_KINDS = {bool: "true or false", int: "a whole number", float: "a decimal number", str: "text", list: "a list"}
DATA_ROOT = "data_root"
ParameterValue = bool | int | float | str | list[str] | list[float]
Changes = Literal["start", "unconfigured", "running"]
_WHEN = {
    "start": "set at the start only",
    "unconfigured": "set while the node is unconfigured",
    "running": "may change at run time",
}


class ParameterError(InputError):
    """A parameter given a value that is not allowed, in one line."""


@dataclass(frozen=True)
class Parameter:
    """Declaration of one ROS parameter; its type is that of the default.

    Attributes
    ----------
    name : str
        Name, dots for groups.
    default : bool, int, float, str or list
        Default. An empty list of strings is ``[""]``: ROS cannot type an empty one. A list of floats keeps its length.
    description : str
        One line for the user, with the unit.
    minimum, maximum : float
        Allowed range of a number, or of every number of a list, ends included.
    choices : tuple of str
        Allowed values of a string.
    changes : "start", "unconfigured" or "running"
        When another value is accepted: at the start only (read-only), between `cleanup` and `configure`, or always.
    written : bool
        It is a path at which the node makes files: after the start only one below the data root is accepted.
    no_path : tuple of str
        Values of such a parameter that are no path.
    """

    name: str
    default: ParameterValue
    description: str
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()
    changes: Changes = "unconfigured"
    written: bool = False
    no_path: tuple[str, ...] = ("",)

    def descriptor(self) -> ParameterDescriptor:
        """Descriptor with range, description and read-only flag."""
        constraints = [f"one of: {', '.join(self.choices)}"] if self.choices else []
        described = ParameterDescriptor(
            description=self.description,
            read_only=self.changes == "start",
            additional_constraints="; ".join([*constraints, _WHEN[self.changes]]),
        )
        if isinstance(self.default, list) or not self._limits:
            return described
        if isinstance(self.default, int):
            low, high = max(self.minimum, -(2**63)), min(self.maximum, 2**63 - 1)
            described.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=0)]
        else:
            low, high = float(self.minimum), float(self.maximum)
            described.floating_point_range = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
        return described

    def problem(self, value: Any) -> str | None:
        """Name what is wrong with a value of the right type, in one line; None when it is allowed."""
        entries = list(value) if self._vector else [value]
        numbers = [entry for entry in entries if isinstance(entry, int | float) and not isinstance(entry, bool)]
        wrong = (
            (self.choices and value not in self.choices)
            or (self._vector and len(entries) != len(self.default))  # type: ignore[arg-type]  # a vector has a length
            or not all(math.isfinite(number) and self.minimum <= number <= self.maximum for number in numbers)
        )
        return f"parameter {self.name}: {_text(value)}, allowed: {self.allowed()}" if wrong else None

    @property
    def live(self) -> bool:
        """Whether it may change at run time."""
        return self.changes == "running"

    def allowed(self) -> str:
        """Type and range in words."""
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        if isinstance(self.default, list) and self._vector:
            return f"{len(self.default)} decimal numbers{self._limits}"
        return f"{_KINDS[type(self.default)]}{self._limits}"

    @property
    def _limits(self) -> str:
        """Limits in words; empty where there are none."""
        known = math.isfinite(self.minimum) or math.isfinite(self.maximum)
        return f" from {self.minimum:g} to {self.maximum:g}" if known else ""

    @property
    def _vector(self) -> bool:
        return isinstance(self.default, list) and all(isinstance(entry, float) for entry in self.default)


def _text(value: Any) -> str:
    return shortened(str(value) if isinstance(value, bool | int | float | str) else str(list(value)), LONGEST_NAME)


live_parameter = partial(Parameter, changes="running")

AUTOSTART = Parameter(
    "autostart", True, "configure and activate at the start, without a lifecycle manager", changes="start"
)
MACHINE = Parameter("machine", "dz101", "machine: name of a shipped one, or path of a machine file")
SUMMARY = Parameter("summary", "", "file that gets the result as JSON at the end; empty for none", changes="start")
ROOT = Parameter(
    DATA_ROOT,
    "",
    "folder below which paths written to may be set while the node runs; empty: tbm_monitor in the user's data folder",
    changes="start",
)
