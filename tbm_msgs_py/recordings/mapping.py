"""Which topic of a recording is which test point, in which axes and unit: stated in a YAML file, never guessed."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator
from pydantic_core import ErrorDetails

from tbm_msgs_py.base.bounds import LONGEST_NAME, quoted, read_text, shortened
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.units import STANDARD_GRAVITY
from tbm_msgs_py.topics import OPERATING_POINT, absolute

FILE_NAME = "mapping.yaml"
_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
Name = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME)]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]


class SensorMapping(BaseModel):
    """One recorded topic.

    Attributes
    ----------
    point : str
        Test point.
    units : str
        ``m/s2`` or ``g``.
    gravity : str
        The signal has gravity ``included`` or ``removed``.
    frame : str
        ``rotating`` with the cutterhead, or ``fixed``.
    axes : tuple of str
        Sensor axis that points along the machine's x, y and z, such as ``-z``.
    rotation : tuple of float
        Roll, pitch and yaw of the sensor in the machine, degrees, applied after `axes`.
    range : float or None
        Measuring range in `units`; samples at it count as clipped.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    point: Name
    units: Literal["m/s2", "g"]
    gravity: Literal["included", "removed"]
    frame: Literal["fixed", "rotating"]
    axes: tuple[Axis, Axis, Axis] = ("x", "y", "z")
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    range: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None

    @field_validator("axes")
    @classmethod
    def _each_axis_once(cls, axes: tuple[Axis, Axis, Axis]) -> tuple[Axis, Axis, Axis]:
        if sorted(axis[-1] for axis in axes) != ["x", "y", "z"]:
            raise ValueError("each of x, y, z once, with or without a minus sign")
        return axes

    @field_validator("rotation")
    @classmethod
    def _finite(cls, rotation: tuple[float, float, float]) -> tuple[float, float, float]:
        if not all(map(math.isfinite, rotation)):
            raise ValueError("three finite angles in degrees")
        return rotation

    @property
    def scale(self) -> float:
        """Factor from the recorded unit to m/s²."""
        return STANDARD_GRAVITY if self.units == "g" else 1.0

    def matrix(self) -> NDArray[np.float64]:
        """Sensor values to machine axes in m/s²: ``machine = matrix @ sensor``, (3, 3)."""
        permutation = np.zeros((3, 3))
        for row, axis in enumerate(self.axes):
            permutation[row, "xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
        return self.scale * _rotation(self.rotation) @ permutation


class Mapping(BaseModel):
    """Topics of a recording, and the topic of its operating point."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    topics: dict[Name, SensorMapping]
    operating_point: Name = absolute(OPERATING_POINT)

    @model_validator(mode="after")
    def _one_topic_a_point(self) -> Mapping:
        for point, count in Counter(sensor.point for sensor in self.topics.values()).items():
            if count > 1:
                raise ValueError(f"point {point}: {count} topics, allowed: one")
        return self


def contract_sensor(point: str) -> SensorMapping:
    """Sensor of a contract topic: m/s² in machine axes, gravity removed."""
    return SensorMapping(point=point, units="m/s2", gravity="removed", frame="fixed")


def contract_mapping(names: Iterable[str]) -> Mapping:
    """Map the topics that follow the contract; a block goes before single samples of the same point."""
    sensors: dict[str, SensorMapping] = {}
    given: set[str] = set()
    for name in sorted(names, key=lambda name: not name.endswith("/block")):
        head, _, kind = name.rpartition("/")
        prefix, _, point = head.rpartition("/")
        if prefix != absolute("field") or kind not in ("block", "accel") or not point:
            continue
        if point not in given:
            given.add(point)
            sensors[name] = contract_sensor(point)
    return Mapping(topics=sensors)


def read_yaml(path: str | Path, what: str, keys: Iterable[str]) -> dict[str, object]:
    """Read a YAML file that holds `what`: a mapping with some of the keys.

    Raises
    ------
    RecordingError
        What is wrong, and where, without a word of the file: over ROS anybody may name one.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise RecordingError(f"{path}: no regular file, allowed: {what}")
    try:
        content = yaml.load(read_text(path), Loader=_Loader)  # noqa: S506  a safe one
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}, allowed: a readable file with {what}") from None
    except UnicodeDecodeError:
        raise RecordingError(f"{path}: not YAML (no UTF-8 text), allowed: {what}") from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise RecordingError(f"{path}: not YAML ({place}{error.problem}), allowed: {what}") from None
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else " ".join(str(error).split())
        raise RecordingError(f"{path}: not YAML ({why}), allowed: {what}") from None
    if not isinstance(content, dict) or content.keys().isdisjoint(keys):
        raise RecordingError(f"{path}: not {what}, allowed: a mapping with keys of {', '.join(keys)}")
    return content


def load_mapping(path: str | Path) -> Mapping:
    """Read a mapping file; a `RecordingError` names the key that is wrong and what is allowed."""
    content = read_yaml(path, "a mapping of topics", Mapping.model_fields)
    try:
        return Mapping.model_validate(content)
    except ValidationError as error:
        # A misspelt key is also a missing one: the misspelling comes first.
        first = min(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
        where = shortened(".".join(map(str, first["loc"])), LONGEST_NAME) or "mapping"
        keys = SensorMapping.model_fields if len(first["loc"]) > 1 else Mapping.model_fields
        raise RecordingError(f"{path}: {where}: {entry_problem(first, keys)}") from error


def entry_problem(found: ErrorDetails, keys: Iterable[str]) -> str:
    """Say what is wrong with an entry of a file and what is allowed; `keys` are those beside an unknown one."""
    if found["type"] == "missing":
        return "missing, allowed: a value that is stated, nothing is guessed"
    if found["type"] == "extra_forbidden":
        return f"unknown key, allowed: {', '.join(keys)}"
    allowed = re.sub(r"^(Value error, |\w+ should (be|have) )", "", found["msg"])
    if isinstance(found["input"], dict) and found["type"] == "value_error":
        return allowed  # of a whole entry: which of its values is wrong is in the text
    return f"{quoted(found['input'])}, allowed: {allowed}"


def default_mapping_file(recording: Path) -> Path | None:
    """``mapping.yaml`` in the folder of a recording, else beside it."""
    candidates = (recording / FILE_NAME, recording.parent / FILE_NAME)
    return next((file for file in candidates if file.is_file()), None)


def _rotation(degrees: tuple[float, float, float]) -> NDArray[np.float64]:
    """Rotation matrix of roll, pitch and yaw about the fixed axes, as REP-103 has them."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
