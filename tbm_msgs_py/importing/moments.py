"""Moments that people and files write: ISO 8601 or German dates, with their zone or in one that is stated."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from typing import Final
from zoneinfo import ZoneInfo, available_timezones

ALLOWED: Final = (
    "2026-03-01T08:00:00+01:00; without its zone, or as 01.03.2026 08:00:00, where `timezone` says which it is in"
)
_MOMENT = re.compile(
    r"(?:(?P<Y>\d{4})-(?P<m>\d\d)-(?P<d>\d\d)|(?P<d_>\d{1,2})\.(?P<m_>\d{1,2})\.(?P<Y_>\d{4}))"
    r"[T ](?P<H>\d\d):(?P<M>\d\d)(?::(?P<S>\d\d)(?:[.,](?P<part>\d{1,9}))?)?"
    r" ?(?P<zone>Z|[+-]\d\d:?\d\d)?",
    re.ASCII,
)
_OFFSET = re.compile(r"(?P<sign>[+-])(?P<hours>\d\d):?(?P<minutes>\d\d)", re.ASCII)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_OF_THIS_COMPUTER = {"localtime", "Factory"}  # names of the list of zones that mean another zone on every computer


def zone_of(text: str) -> tzinfo:
    """Time zone of a name of the IANA list, or of an offset such as ``+01:00``.

    Raises
    ------
    ValueError
        None of them.
    """
    if offset := _fixed(text):
        return offset
    known = available_timezones() - _OF_THIS_COMPUTER
    if not known:
        raise ValueError(
            "no list of time zones is installed, allowed: an offset such as '+01:00', or pip install tzdata"
        )
    if text not in known:
        raise ValueError("no time zone, allowed: a name such as Europe/Berlin or UTC, or an offset such as '+01:00'")
    return ZoneInfo(text)


def moment_ns(text: str, zone: tzinfo | None = None) -> int:
    """Nanoseconds since the epoch of a moment that a text says.

    Parameters
    ----------
    text : str
        ISO 8601, or ``DD.MM.YYYY HH:MM:SS,mmm``, with its zone or without it.
    zone : tzinfo, optional
        Where clocks show it, if the text does not say so.

    Raises
    ------
    ValueError
        What is wrong and what is allowed.
    """
    parts = _MOMENT.fullmatch(text)
    if parts is None:
        raise ValueError(f"no date and time, allowed: {ALLOWED}")
    year, month, day = (int(parts[name] or parts[f"{name}_"]) for name in "Ymd")
    try:
        clock = datetime(year, month, day, int(parts["H"]), int(parts["M"]), int(parts["S"] or 0))
        stated = _fixed(parts["zone"]) if parts["zone"] else None
    except ValueError as error:
        raise ValueError(f"{error}, allowed: {ALLOWED}") from None
    return local_ns(clock, stated or zone) + int((parts["part"] or "").ljust(9, "0"))


def local_ns(clock: datetime, zone: tzinfo | None) -> int:
    """Nanoseconds since the epoch when clocks of a zone show `clock`, which has no zone of its own.

    Raises
    ------
    ValueError
        No zone is stated, or its clocks show that twice or never.
    """
    if zone is None:
        raise ValueError("without its zone, allowed: one that says it, or `timezone` in the description")
    early, late = (clock.replace(tzinfo=zone, fold=fold) for fold in (0, 1))
    if early.utcoffset() != late.utcoffset():
        back = early.astimezone(UTC).astimezone(zone).replace(tzinfo=None)
        often = "twice" if back == clock else "never"
        raise ValueError(f"clocks of {zone} show that {often}, allowed: a time with its offset from UTC")
    return _since_epoch(early)


def _since_epoch(moment: datetime) -> int:
    return (moment - _EPOCH) // timedelta(microseconds=1) * 1000


def _fixed(text: str) -> tzinfo | None:
    """Zone of an offset, None of anything else."""
    if text == "Z":
        return UTC
    if not (parts := _OFFSET.fullmatch(text)):
        return None
    offset = timedelta(hours=int(parts["hours"]), minutes=int(parts["minutes"]))
    if int(parts["minutes"]) > 59 or offset > timedelta(hours=14):
        raise ValueError(f"{text}: no offset of a time zone, allowed: up to 14:00")
    return timezone(-offset if parts["sign"] == "-" else offset)
