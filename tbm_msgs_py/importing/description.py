"""What the columns of a file are: test points and axes, units, time. Stated by the user, never guessed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeAlias, TypeVar

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, field_validator, model_validator

from tbm_msgs_py import topics
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.fields import Name
from tbm_msgs_py.base.strict_yaml import read_yaml
from tbm_msgs_py.base.texts import quoted
from tbm_msgs_py.base.units import R_MIN, STANDARD_GRAVITY
from tbm_msgs_py.base.validation import validated
from tbm_msgs_py.recordings.mapping import SensorMapping

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]

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
_POINT_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def same_unit(label: str, unit: str) -> bool:
    """Whether what a file states means a unit of a description; the sign of a product and of a power is no matter."""
    return _plain(label) in {_plain(spelling) for spelling in _UNITS[unit][1]}


def _plain(label: str) -> str:
    """Label without signs and in small letters, but for mega: mN is not MN."""
    plain = label.translate(_SIGNS)
    return plain if plain.startswith("MN") else plain.lower()


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class TimeColumn(_Strict):
    """Column that holds the time of each row.

    Attributes
    ----------
    column : str
        Name.
    unit : str
        ``s``, ``ms``, ``us`` or ``ns`` after `start`, or ``datetime`` for ISO 8601 with its zone (CSV only).
    restart_gap : float or None
        A time that steps back begins a new run, put this many s after the row before; None: it is an error.
    """

    column: Name
    unit: Literal["s", "ms", "us", "ns", "datetime"]
    restart_gap: Positive | None = None

    @model_validator(mode="after")
    def _dates_do_not_restart(self) -> TimeColumn:
        if self.unit == "datetime" and self.restart_gap is not None:
            raise ValueError("restart_gap: stated beside dates, allowed: with a relative time")
        return self


TimeBase: TypeAlias = TimeColumn | Literal["file"] | None


class PointColumns(SensorMapping):
    """A test point: its sensor as in a mapping file, and the columns of the sensor's axes.

    Attributes
    ----------
    columns : tuple of str or None
        Columns of the sensor's x, y and z; None for an axis that was not measured, which is written as 0.
    full_scale : float or None
        Value in `units` of a reading of 1; a WAV file, whose readings are shares of full scale, needs it.
    """

    columns: tuple[Name | None, Name | None, Name | None]
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
    def stated_units(self) -> list[str]:
        """Unit of each column."""
        return [self.units] * len(self.columns)

    @property
    def factors(self) -> list[float]:
        """From a reading of each column to m/s²."""
        return [self.scale * (self.full_scale or 1.0)] * len(self.columns)

    def written(self) -> SensorMapping:
        """How the sensor is read from the recording: still in its own axes, in m/s²."""
        return SensorMapping(
            point=self.point,
            units="m/s2",
            gravity=self.gravity,
            frame=self.frame,
            axes=tuple(axis if axis and self.columns["xyz".index(axis[-1])] else None for axis in self.axes),
            rotation=self.rotation,
            range=None if self.range is None else self.range * self.scale,
        )


class QuantityColumn(_Strict, Generic[UnitT]):
    """Column of a quantity in one of its units."""

    column: Name
    unit: UnitT


class OperatingColumns(_Strict):
    """Columns of the operating point."""

    speed: QuantityColumn[Literal["rad/s", "r/min"]]
    torque: QuantityColumn[Literal["N.m", "kN.m", "MN.m"]]
    thrust: QuantityColumn[Literal["N", "kN", "MN"]]
    advance: QuantityColumn[Literal["m/s", "mm/min"]] | None = None

    @property
    def _entries(self) -> list[QuantityColumn[Any]]:
        """Columns in the order of `OperatingPoint`: speed, torque, thrust and, where stated, advance."""
        return [self.speed, self.torque, self.thrust, *([self.advance] if self.advance else [])]

    @property
    def columns(self) -> list[str]:
        """Names of the columns."""
        return [entry.column for entry in self._entries]

    @property
    def stated_units(self) -> list[str]:
        """Unit of each column."""
        return [entry.unit for entry in self._entries]

    @property
    def factors(self) -> list[float]:
        """From a reading of each column to SI units."""
        return [_UNITS[unit][0] for unit in self.stated_units]


class CsvLayout(_Strict):
    """How a CSV file is laid out.

    Attributes
    ----------
    delimiter, decimal, encoding : str
        Between the cells; ``.`` or ``,``; of the text.
    header, first : int
        Line of the column names, and of the first row of numbers (default: the one after), counted from 1.
    """

    delimiter: Annotated[str, Field(min_length=1, max_length=1)] = ","
    decimal: Literal[".", ","] = "."
    encoding: Name = "utf-8-sig"
    header: Annotated[int, Field(ge=1)] = 1
    first: Annotated[int, Field(ge=2)] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> CsvLayout:
        if self.delimiter == self.decimal:
            raise ValueError(
                f"delimiter and decimal: both {self.decimal!r}, allowed: two signs; a decimal comma often goes with ;"
            )
        if self.first is not None and self.first <= self.header:
            raise ValueError(f"first: {self.first}, allowed: a line after the header, which is line {self.header}")
        return self

    @property
    def first_line(self) -> int:
        """Line of the first row of numbers."""
        return self.header + 1 if self.first is None else self.first


class Description(_Strict):
    """An import description; `docs/importing.md` explains it.

    Attributes
    ----------
    points : dict
        Columns of each test point.
    operating_point : OperatingColumns or None
        Columns of the operating point.
    time : TimeColumn or ``file``
        Time column, or the time base that the file itself states; instead of it
    rate : float
        Sample rate, Hz.
    start : datetime or ``file``
        Moment of time 0, or the one that the file states.
    csv : CsvLayout
        For CSV files.
    """

    points: dict[Name, PointColumns] = {}
    operating_point: OperatingColumns | None = None
    time: TimeBase = None
    rate: Positive | None = None
    start: AwareDatetime | Literal["file"] | None = None
    csv: CsvLayout = CsvLayout()

    @model_validator(mode="before")
    @classmethod
    def _name_points(cls, content: object) -> object:
        if not isinstance(content, dict) or not isinstance(points := content.get("points"), dict):
            return content
        named = {key: {"point": key, **value} if isinstance(value, dict) else value for key, value in points.items()}
        return content | {"points": named}

    @model_validator(mode="after")
    def _complete(self) -> Description:
        if not self.points and self.operating_point is None:
            raise ValueError(
                "points or operating_point: missing, allowed: at least one of them, in the file of --map or as "
                "--map POINT=X,Y,Z"
            )
        for key, point in self.points.items():
            if not _POINT_NAME.fullmatch(key) or point.point != key or key == topics.OPERATING_POINT:
                raise ValueError(
                    f"point {quoted(key)}, allowed: a name of letters, digits and _, such as {topics.TEST_POINTS[0]}"
                )
        if (self.time is None) == (self.rate is None):
            given = "missing" if self.time is None else "both stated"
            raise ValueError(f"time or rate: {given}, allowed: one of them, which says when a sample was taken")
        dates = isinstance(self.time, TimeColumn) and self.time.unit == "datetime"
        if dates != (self.start is None):
            given = "stated beside dates" if dates else "missing"
            raise ValueError(
                f"start: {given}, allowed: the moment of time 0 with its zone, such as 2026-03-01T08:00:00+01:00, "
                "or `file`; none with a datetime column"
            )
        return self

    @property
    def streams(self) -> dict[str, PointColumns | OperatingColumns]:
        """Columns of each stream: test points, and the operating point under its topic."""
        operating = {topics.OPERATING_POINT: self.operating_point} if self.operating_point else {}
        return {**self.points, **operating}

    @property
    def start_ns(self) -> int:
        """Stated moment of time 0, ns since the epoch; 0 when it comes from the file or from dates."""
        return to_ns(self.start) if isinstance(self.start, datetime) else 0


def to_ns(moment: datetime) -> int:
    """Nanoseconds since the epoch of a moment with its zone."""
    return (moment - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000


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
    return validated(Description, _joined(content, changes or {}), str(path), RecordingError)


def _joined(content: Mapping[str, object], changes: Mapping[str, object]) -> dict[str, object]:
    joined = dict(content)
    for key, value in changes.items():
        old = joined.get(key)
        joined[key] = _joined(old, value) if isinstance(value, Mapping) and isinstance(old, dict) else value
    return joined
