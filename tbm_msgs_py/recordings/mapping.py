"""Which topic of a recording is which test point, in which axes and unit: stated in a YAML file, never guessed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.fields import Name, NonNegative, Positive, Vector3
from tbm_msgs_py.base.files import real_path
from tbm_msgs_py.base.strict_yaml import read_yaml
from tbm_msgs_py.base.texts import LONGEST_NAME
from tbm_msgs_py.base.units import STANDARD_GRAVITY
from tbm_msgs_py.base.validation import validated
from tbm_msgs_py.topics import FIELD_DRIVES, OPERATING_POINT, absolute

FILE_NAME = "mapping.yaml"
_NO_SHARE = 1e-9  # of an axis that is lacking in one of the machine's
IN_UNITS = ("range", "noise_density", "resolution")
"""Keys of a sensor whose values are in its `units`."""
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
    axes : tuple of str or None
        Sensor axis that points along the machine's x, y and z, such as ``-z``; None where the sensor has no such axis.
    rotation : tuple of float
        Roll, pitch and yaw of the sensor in the machine, degrees, applied after `axes`.
    range : float or None
        Measuring range in `units`; samples at it count as clipped.
    noise_density : float or None
        White noise of each axis in `units`/√Hz, one-sided, without that of the converter.
    resolution : float or None
        Step of the converter in `units`.
    band_hz : tuple of float or None
        Lowest and highest frequency at which the sensor measures, Hz.
    offset : tuple of float or None
        Place in the machine's axes from the node of the test point, m, a rigid arm; by default that of the test point.
    frame_id : str or None
        Of the messages that are meant, where several sensors share the topic.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    point: Name
    units: Literal["m/s2", "g"]
    gravity: Literal["included", "removed"]
    frame: Literal["fixed", "rotating"]
    axes: tuple[Axis | None, Axis | None, Axis | None] = ("x", "y", "z")
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    range: Positive | None = None
    noise_density: NonNegative | None = None
    resolution: Positive | None = None
    band_hz: tuple[NonNegative, Positive] | None = None
    offset: Vector3 | None = None
    frame_id: Annotated[str, Field(max_length=LONGEST_NAME)] | None = None

    @field_validator("axes")
    @classmethod
    def _each_axis_once(cls, axes: tuple[Axis | None, ...]) -> tuple[Axis | None, ...]:
        named = [axis[-1] for axis in axes if axis is not None]
        if not named or len(set(named)) < len(named):
            raise ValueError(
                "none or one twice, allowed: each of x, y, z once, with or without a minus sign, null for an axis that "
                "the sensor does not have"
            )
        return axes

    @field_validator("rotation")
    @classmethod
    def _finite(cls, rotation: tuple[float, float, float]) -> tuple[float, float, float]:
        if not all(map(math.isfinite, rotation)):
            raise ValueError("an angle that is not finite, allowed: three finite angles in degrees")
        return rotation

    @field_validator("band_hz")
    @classmethod
    def _ascending(cls, band: tuple[float, float] | None) -> tuple[float, float] | None:
        if band and band[0] >= band[1]:
            raise ValueError(f"{band[0]:g} to {band[1]:g} Hz, allowed: the lower limit first")
        return band

    @model_validator(mode="after")
    def _steps_within_range(self) -> Self:
        if self.range and self.resolution and self.resolution > self.range:
            raise ValueError(
                f"resolution: {self.resolution:g}, allowed: up to the range of {self.range:g} {self.units}"
            )
        return self

    @property
    def scale(self) -> float:
        """Factor from the recorded unit to m/s²."""
        return STANDARD_GRAVITY if self.units == "g" else 1.0

    def matrix(self) -> Array:
        """Sensor values to machine axes in m/s²: ``machine = matrix @ sensor``, (3, 3)."""
        permutation = np.zeros((3, 3))
        for row, axis in enumerate(self.axes):
            if axis is not None:
                permutation[row, "xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
        return self.scale * _rotation(self.rotation) @ permutation

    def noise_power_density(self, rate_hz: float) -> float | None:
        """One-sided density of the noise of each axis, m²/s⁴/Hz: the sensor's, and that of its converter.

        Rounding to steps Δ adds white noise of the power Δ²/12, spread from 0 to half the sampling rate (Widrow and
        Kollár, "Quantization Noise", Cambridge University Press, 2008). None without a stated `noise_density`.
        """
        if self.noise_density is None:
            return None
        rounding = (self.resolution or 0.0) ** 2 / 12.0 / (0.5 * rate_hz)
        return self.scale**2 * (self.noise_density**2 + rounding)

    @property
    def measured(self) -> tuple[bool, bool, bool]:
        """Whether the machine's x, y and z are measured; y and z of a rotating sensor only together."""
        lacking = _rotation(self.rotation)[:, [axis is None for axis in self.axes]]
        x, y, z = (bool((np.abs(row) < _NO_SHARE).all()) for row in lacking)
        return (x, y and z, y and z) if self.frame == "rotating" else (x, y, z)


class DriveMapping(BaseModel):
    """The recorded topic of the drives, a `sensor_msgs/JointState`.

    Attributes
    ----------
    topic : str
    ratio : float
        Turns of the motor per turn of the pinion where torque and speed are the motor's; 1: they are the pinion's.
    low_pass_hz : float or None
        Corner of the filter that the values went through before they were recorded, Hz.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    topic: Name = absolute(FIELD_DRIVES)
    ratio: Positive = 1.0
    low_pass_hz: Positive | None = None


class TopicMapping(BaseModel):
    """Topics of a recording: of its sensors, of its operating point, and of its drives (default: the contract's)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    topics: dict[Name, SensorMapping]
    operating_point: Name = absolute(OPERATING_POINT)
    drives: DriveMapping | None = None

    @model_validator(mode="after")
    def _one_topic_a_point(self) -> TopicMapping:
        for point, count in Counter(sensor.point for sensor in self.topics.values()).items():
            if count > 1:
                raise ValueError(f"point {point}: {count} topics, allowed: one")
        return self


def contract_sensor(point: str) -> SensorMapping:
    """Sensor of a contract topic: m/s² in machine axes, gravity removed."""
    return SensorMapping(point=point, units="m/s2", gravity="removed", frame="fixed")


def contract_mapping(names: Iterable[str]) -> TopicMapping:
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
    return TopicMapping(topics=sensors)


def load_mapping(path: str | Path) -> TopicMapping:
    """Read a mapping file; a `RecordingError` names the key that is wrong and what is allowed."""
    content = read_yaml(path, "a mapping of topics", TopicMapping.model_fields, RecordingError)
    return validated(TopicMapping, content, str(path), RecordingError)


def default_mapping_file(recording: Path) -> Path | None:
    """``mapping.yaml`` in the folder of a recording, else beside it; of a link, where it leads to."""
    recording = real_path(recording)
    candidates = (recording / FILE_NAME, recording.parent / FILE_NAME)
    return next((file for file in candidates if file.is_file()), None)


def _rotation(degrees: tuple[float, float, float]) -> Array:
    """Rotation matrix of roll, pitch and yaw about the fixed axes, as REP-103 has them."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
