"""What the columns of a file are: test points and axes, units, time. Stated by the user, never guessed."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeAlias, TypeVar

from pydantic import Field, field_validator, model_validator

from tbm_msgs_py import topics
from tbm_msgs_py.base.drive_state import MOST_DRIVES
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.fields import FrozenModel, Name
from tbm_msgs_py.base.operating_point import LARGEST
from tbm_msgs_py.base.strict_yaml import read_yaml
from tbm_msgs_py.base.texts import quoted
from tbm_msgs_py.base.units import R_MIN, STANDARD_GRAVITY
from tbm_msgs_py.base.validation import validated
from tbm_msgs_py.importing.layout import ColumnName, FileLayout, Number, Positive
from tbm_msgs_py.recordings.mapping import IN_UNITS, DriveMapping, SensorMapping

UnitT = TypeVar("UnitT", bound=str)
# Factor to SI units, and how files write the unit.
_UNITS: dict[str, tuple[float, tuple[str, ...]]] = {
    "m/s2": (1.0, ("m/s2", "m/s/s", "m.s-2")),
    "g": (STANDARD_GRAVITY, ("g", "gn", "g_n")),
    "N": (1.0, ("N",)),
    "kN": (1e3, ("kN",)),
    "MN": (1e6, ("MN",)),
    "N.m": (1.0, ("N.m",)),
    "kN.m": (1e3, ("kN.m",)),
    "MN.m": (1e6, ("MN.m", "MNM")),
    "rad/s": (1.0, ("rad/s", "rad.s-1")),
    "r/min": (R_MIN, ("r/min", "rpm", "rev/min", "1/min", "min-1", "U/min")),
    "m/s": (1.0, ("m/s", "m.s-1")),
    "mm/min": (1e-3 / 60.0, ("mm/min", "mm.min-1")),
}
_SIGNS = str.maketrans({"²": "2", "¹": "1", **dict.fromkeys(" .·⋅∙*-⁻^", "")})
DRIVES = "drives"
NO_POINTS = (topics.OPERATING_POINT, DRIVES)
"""Streams that are no test points."""
_POINT_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def same_unit(label: str, unit: str) -> bool:
    """Whether what a file states means a unit of a description; the sign of a product and of a power is no matter."""
    return _plain(label) in {_plain(spelling) for spelling in _UNITS[unit][1]}


def _plain(label: str) -> str:
    """Label without signs and in small letters, but for mega: mN is not MN."""
    plain = label.translate(_SIGNS)
    return plain if plain.startswith("MN") else plain.lower()


class PointColumns(SensorMapping):
    """A test point: its sensor as in a mapping file, and the columns of the sensor's axes.

    Attributes
    ----------
    columns : tuple of str or None
        Columns of the sensor's x, y and z; None for an axis that was not measured, which is written as 0.
    full_scale : float or None
        Value in `units` of a reading of 1; a WAV file, whose readings are shares of full scale, needs it.
    """

    columns: tuple[ColumnName | None, ColumnName | None, ColumnName | None]
    full_scale: Positive | None = None

    @field_validator("columns")
    @classmethod
    def _each_column_once(cls, columns: tuple[str | None, ...]) -> tuple[str | None, ...]:
        named = [column for column in columns if column is not None]
        if not named or len(set(named)) < len(named):
            raise ValueError(
                "none or one twice, allowed: three columns, null for an axis that was not measured, none of them twice"
            )
        return columns

    @property
    def constants(self) -> list[float]:
        """What is written where there is no column: an axis that was not measured is 0."""
        return [0.0] * len(self.columns)

    @property
    def stated_units(self) -> list[str]:
        """Unit of each column."""
        return [self.units] * len(self.columns)

    @property
    def factors(self) -> list[float]:
        """From a reading of each column to m/s²."""
        return [self.scale * (self.full_scale or 1.0)] * len(self.columns)

    def written(self) -> SensorMapping:
        """How the sensor is read from the recording: still in its own axes, in m/s²."""
        stated = {name: getattr(self, name) for name in SensorMapping.model_fields}
        in_units = {name: stated[name] and stated[name] * self.scale for name in IN_UNITS}
        axes = tuple(axis if axis and self.columns["xyz".index(axis[-1])] else None for axis in self.axes)
        return SensorMapping(**{**stated, **in_units, "units": "m/s2", "axes": axes, "frame_id": None})


class QuantityColumn(FrozenModel, Generic[UnitT]):
    """Column of a quantity in one of its units, or the value that it kept."""

    column: ColumnName | None = None
    unit: UnitT
    value: Number | None = None

    @model_validator(mode="after")
    def _one_source(self) -> QuantityColumn[UnitT]:
        if (self.column is None) == (self.value is None):
            given = "missing" if self.column is None else "both stated"
            raise ValueError(f"column or value: {given}, allowed: one of them")
        if not 0.0 <= (self.value or 0.0) * _UNITS[self.unit][0] <= LARGEST:
            raise ValueError(f"value: {self.value:g} {self.unit}, allowed: 0 to {LARGEST:g} in SI units")
        return self


class OperatingColumns(FrozenModel):
    """Columns, or constant values, of the operating point."""

    speed: QuantityColumn[Literal["rad/s", "r/min"]]
    torque: QuantityColumn[Literal["N.m", "kN.m", "MN.m"]]
    thrust: QuantityColumn[Literal["N", "kN", "MN"]]
    advance: QuantityColumn[Literal["m/s", "mm/min"]] | None = None

    @property
    def _entries(self) -> list[QuantityColumn[Any]]:
        """Columns in the order of `OperatingPoint`: speed, torque, thrust and, where stated, advance."""
        return [self.speed, self.torque, self.thrust, *([self.advance] if self.advance else [])]

    @property
    def columns(self) -> list[str | None]:
        """Names of the columns, None for a quantity that is constant."""
        return [entry.column for entry in self._entries]

    @property
    def constants(self) -> list[float]:
        """What is written where there is no column."""
        return [entry.value or 0.0 for entry in self._entries]

    @property
    def stated_units(self) -> list[str]:
        """Unit of each column."""
        return [entry.unit for entry in self._entries]

    @property
    def factors(self) -> list[float]:
        """From a reading of each column to SI units."""
        return [_UNITS[unit][0] for unit in self.stated_units]


class QuantityColumns(FrozenModel, Generic[UnitT]):
    """Columns of a quantity of the drives 1, 2 … in one unit; None for a drive that was not recorded."""

    columns: Annotated[tuple[ColumnName | None, ...], Field(min_length=1, max_length=MOST_DRIVES)]
    unit: UnitT

    @field_validator("columns")
    @classmethod
    def _each_column_once(cls, columns: tuple[str | None, ...]) -> tuple[str | None, ...]:
        named = [column for column in columns if column is not None]
        if not named or len(set(named)) < len(named):
            raise ValueError("none or one twice, allowed: a column for each drive, null for one that was not recorded")
        return columns


class DriveColumns(FrozenModel):
    """Columns of torque and speed of the drives, by their number.

    Attributes
    ----------
    torque, speed : QuantityColumns or None
        At least one of them.
    ratio : float
        Turns of the motor per turn of the pinion where the columns are the motor's; 1: they are the pinion's.
    low_pass_hz : float or None
        Corner of the filter that the values went through before they were recorded, Hz.
    """

    torque: QuantityColumns[Literal["N.m", "kN.m", "MN.m"]] | None = None
    speed: QuantityColumns[Literal["rad/s", "r/min"]] | None = None
    ratio: Positive = 1.0
    low_pass_hz: Positive | None = None

    @model_validator(mode="after")
    def _one_quantity(self) -> DriveColumns:
        if self.torque is None and self.speed is None:
            raise ValueError("torque or speed: missing, allowed: at least one of them")
        return self

    @property
    def count(self) -> int:
        """Highest number of a drive."""
        return max(len(one.columns) for one in (self.torque, self.speed) if one)

    @property
    def _quantities(self) -> list[tuple[QuantityColumns[Any] | None, float]]:
        """Torque and speed, and from the columns' side to that of the pinion."""
        return [(self.torque, self.ratio), (self.speed, 1.0 / self.ratio)]

    @property
    def columns(self) -> list[str | None]:
        """Columns of the torques of all drives, then of the speeds."""
        return [
            column
            for one, _ in self._quantities
            for column in ((*one.columns, *[None] * (self.count - len(one.columns))) if one else [None] * self.count)
        ]

    @property
    def constants(self) -> list[float]:
        """What is written where there is no column: nothing is known."""
        return [math.nan] * len(self.columns)

    @property
    def stated_units(self) -> list[str]:
        """Unit of each column; of one that is not there any."""
        return [one.unit if one else "N.m" for one, _ in self._quantities for _ in range(self.count)]

    @property
    def factors(self) -> list[float]:
        """From a reading of each column to SI units on the side of the pinion."""
        sides = [factor for _, factor in self._quantities for _ in range(self.count)]
        return [_UNITS[unit][0] * factor for unit, factor in zip(self.stated_units, sides, strict=True)]

    def written(self) -> DriveMapping | None:
        """How they are read from the recording: on the side of the pinion; None where the contract says it all."""
        return DriveMapping(low_pass_hz=self.low_pass_hz) if self.low_pass_hz else None


StreamColumns: TypeAlias = PointColumns | OperatingColumns | DriveColumns


class Description(FileLayout):
    """An import description; `docs/importing.md` explains it.

    Attributes
    ----------
    points : dict
        Columns of each test point.
    operating_point : OperatingColumns or None
        Columns or values of the operating point.
    drives : DriveColumns or None
        Columns of torque and speed of the drives.
    files : dict
        What is different in a file of several, by its name.
    """

    points: dict[Name, PointColumns] = Field(default_factory=dict)
    operating_point: OperatingColumns | None = None
    drives: DriveColumns | None = None
    files: dict[Name, FileLayout] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _name_points(cls, content: object) -> object:
        if not isinstance(content, dict) or not isinstance(points := content.get("points"), dict):
            return content
        named = {key: {"point": key, **value} if isinstance(value, dict) else value for key, value in points.items()}
        return content | {"points": named}

    @model_validator(mode="after")
    def _complete(self) -> Description:
        if not self.streams:
            raise ValueError(
                "points, operating_point or drives: missing, allowed: at least one of them, in the file of --map or as "
                "--map POINT=X,Y,Z"
            )
        if not any(column for entry in self.streams.values() for column in entry.columns):
            raise ValueError("operating_point: constant, and no points, allowed: at least one column")
        for key, point in self.points.items():
            if not _POINT_NAME.fullmatch(key) or point.point != key or key in NO_POINTS:
                raise ValueError(
                    f"point {quoted(key)}, allowed: a name of letters, digits and _, such as {topics.TEST_POINTS[0]}"
                )
        if not self.files:
            self.check_time()
        for name in self.files:
            self.layout(name)
        return self

    @property
    def streams(self) -> dict[str, StreamColumns]:
        """Columns of each stream: test points, the operating point under its topic, and the drives."""
        operating = {topics.OPERATING_POINT: self.operating_point} if self.operating_point else {}
        return {**self.points, **operating, **({DRIVES: self.drives} if self.drives else {})}

    def layout(self, file: str) -> FileLayout:
        """Layout of a file by its name: what is stated for it goes over what is stated for all.

        Raises
        ------
        ValueError
            It does not say when a sample was taken.
        """
        own = self.files.get(file, FileLayout())
        stated = {key: getattr(own, key) for key in own.model_fields_set}
        common = {key: getattr(self, key) for key in FileLayout.model_fields}
        if {"time", "rate"} & stated.keys():  # one of them takes the place of the other
            common |= {"time": None, "rate": None}
        layout = FileLayout.model_construct(**(common | stated))
        try:
            layout.check_time()
        except ValueError as error:
            raise ValueError(f"files.{file}: {error}" if own.model_fields_set else str(error)) from None
        return layout


def describe(path: str | Path | None, changes: Mapping[str, object] | None = None) -> Description:
    """Describe a file by a YAML file, or by nothing, and by what is stated beside it.

    Parameters
    ----------
    path : str or Path, optional
        YAML file.
    changes : mapping, optional
        Goes over the file: keys of a mapping are joined, everything else is replaced.
    """
    label = "import description"
    if path is None:
        return validated(Description, changes or {}, label, RecordingError)
    content = read_yaml(path, f"an {label}", Description.model_fields, RecordingError)
    beside = ", with what is stated beside it" if changes else ""
    return validated(Description, _joined(content, changes or {}), f"{path}{beside}", RecordingError)


def _joined(content: Mapping[str, object], changes: Mapping[str, object]) -> dict[str, object]:
    joined = dict(content)
    for key, value in changes.items():
        old = joined.get(key)
        joined[key] = _joined(old, value) if isinstance(value, Mapping) and isinstance(old, dict) else value
    return joined
