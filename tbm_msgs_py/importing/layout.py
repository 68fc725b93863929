"""How a file is read, and when its samples were taken: stated by the user, never guessed."""

from __future__ import annotations

from datetime import datetime, tzinfo
from typing import Annotated, Literal, TypeAlias, get_args

from pydantic import AfterValidator, BeforeValidator, Field, field_validator, model_validator

from tbm_msgs_py.base.fields import FrozenModel, Name
from tbm_msgs_py.base.texts import quoted
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.importing.moments import ALLOWED, moment_ns, zone_of

LAST_NS = 2**31 * 10**9
"""ROS counts the seconds since 1970 in 31 bits: its times end here, in 2038."""

# Strict: True, or a number in quotes, is none.
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True)]
Number = Annotated[float, Field(allow_inf_nan=False, strict=True)]


def _number_as_name(given: object) -> object:
    """Name of a column that is a number, as those of a WAV file are, which YAML reads as one."""
    return str(given) if type(given) is int else given


ColumnName = Annotated[Name, BeforeValidator(_number_as_name)]


class TimeColumn(FrozenModel):
    """Column that holds the time of each row.

    Attributes
    ----------
    column : str
        Name.
    unit : str
        ``s``, ``ms``, ``us`` or ``ns`` after `start`, or ``datetime`` for ISO 8601 or German dates (CSV only).
    restart_gap : float or None
        A time that steps back begins a new run, put this many s after the row before; None: it is an error.
    """

    column: ColumnName
    unit: Literal["s", "ms", "us", "ns", "datetime"]
    restart_gap: Annotated[Positive, Field(le=LAST_NS / NANOSECONDS)] | None = None

    @model_validator(mode="after")
    def _dates_do_not_restart(self) -> TimeColumn:
        if self.unit == "datetime" and self.restart_gap is not None:
            raise ValueError("restart_gap: stated beside dates, allowed: with a relative time")
        return self


TimeBase: TypeAlias = TimeColumn | Literal["file"] | None
Thousands: TypeAlias = Literal[".", ",", " ", "'", "\u2019", "_", "\u00a0", "\u202f"]
THOUSANDS: tuple[Thousands, ...] = get_args(Thousands)


class CsvLayout(FrozenModel):
    """How a CSV file is laid out.

    Attributes
    ----------
    delimiter, decimal, encoding : str
        Between the cells; ``.`` or ``,``; of the text.
    header, first : int
        Line of the column names, and of the first row of numbers (default: the one after), counted from 1; a header of
        0: there are no names, and columns are called ``1``, ``2`` ....
    thousands : str or None
        Between groups of three digits before the decimal sign; None: there is none.
    """

    delimiter: Annotated[str, Field(min_length=1, max_length=1)] = ","
    decimal: Literal[".", ","] = "."
    encoding: Name = "utf-8-sig"
    header: Annotated[int, Field(ge=0, strict=True)] = 1
    first: Annotated[int, Field(ge=1, strict=True)] | None = None
    thousands: Thousands | None = None

    @field_validator("delimiter")
    @classmethod
    def _is_no_part_of_a_number(cls, delimiter: str) -> str:
        if delimiter.isalnum() or delimiter in '+-._"\r\n\0':
            raise ValueError("part of a number or of a line, allowed: a sign such as , ; | or a tab")
        return delimiter

    @model_validator(mode="after")
    def _consistent(self) -> CsvLayout:
        if self.delimiter == self.decimal:
            raise ValueError(
                f"delimiter and decimal: both {self.decimal!r}, allowed: two signs; a decimal comma often goes with ;"
            )
        if self.thousands == self.decimal:
            raise ValueError(f"thousands and decimal: both {self.decimal!r}, allowed: two signs")
        if self.first is not None and self.first <= self.header:
            raise ValueError(f"first: {self.first}, allowed: a line after the header, which is line {self.header}")
        return self

    @property
    def first_line(self) -> int:
        """Line of the first row of numbers."""
        return self.header + 1 if self.first is None else self.first


def _moment(given: object) -> object:
    """Text of a moment; a number is none, whatever it counts."""
    if isinstance(given, datetime):  # as YAML reads it
        return given.isoformat()
    if not isinstance(given, str):
        raise ValueError(  # noqa: TRY004 - pydantic makes a line of this one
            f"no date and time, allowed: {ALLOWED}, or `file`"
        )
    return given


def _zone(text: str) -> str:
    zone_of(text)
    return text


class FileLayout(FrozenModel):
    """How one file is read, and when its samples were taken.

    Attributes
    ----------
    time : TimeColumn or ``file``
        Time column, or the time base that the file itself states; instead of it
    rate : float
        Sample rate, Hz.
    start : str or ``file``
        Moment of time 0, or the one that the file states.
    timezone : str
        Where the clocks stood that showed times without a zone: Europe/Berlin, UTC, +01:00.
    csv : CsvLayout
        For CSV files.
    """

    time: TimeBase = None
    rate: Annotated[Positive, Field(ge=1e-6, le=NANOSECONDS)] | None = None
    start: Annotated[str, BeforeValidator(_moment)] | None = None
    timezone: Annotated[Name, AfterValidator(_zone)] | None = None
    csv: CsvLayout = CsvLayout()

    @property
    def zone(self) -> tzinfo | None:
        """Zone of times without one, None when it is not stated."""
        return None if self.timezone is None else zone_of(self.timezone)

    @property
    def start_ns(self) -> int:
        """Stated moment of time 0, ns since the epoch; 0 when it comes from the file or from dates."""
        return 0 if self.start in (None, "file") else moment_ns(self.start, self.zone)

    def check_time(self) -> None:
        """Raise a `ValueError` unless exactly one statement says when a sample was taken."""
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
        try:
            start_ns = self.start_ns
        except ValueError as error:
            raise ValueError(f"start: {quoted(self.start)}: {error}") from None
        if not 0 <= start_ns < LAST_NS:
            raise ValueError(f"start: {self.start}, allowed: from 1970 to 2038, the times of ROS")
