"""Events: what began, and ended, at a machine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

from tbm_gsa.history.context import UNKNOWN, Context
from tbm_gsa.history.entries import SourceKind, WindowSource, machine_condition

EventKind = Literal["machine", "sensor", "rock", "level", "dead", "silent", "lost", "refused"]
EVENT_KINDS: Final[tuple[EventKind, ...]] = get_args(EventKind)
Severity = Literal["info", "warning", "error"]
SEVERITIES: Final[tuple[Severity, ...]] = get_args(Severity)
EventVerdict = Literal["", "rock", "machine", "sensor", "not explained"]
EVENT_VERDICTS: Final[tuple[EventVerdict, ...]] = get_args(EventVerdict)


@dataclass(frozen=True, slots=True)
class Event:
    """What began at a machine; the same source, begin, kind, test point and level are the same event.

    Attributes
    ----------
    begin_ns : int
        Header time, ns.
    kind : {"machine", "sensor", "rock", "level", "dead", "silent", "lost", "refused"}
        Alarm of the watch for the machine or for a sensor; change of the rock; alarm on the level; dead channel; signal
        that is silent, with holes, or that cannot be used.
    point : str
        Test point; empty where it is none alone.
    severity : {"info", "warning", "error"}
    verdict : {"", "rock", "machine", "sensor", "not explained"}
    text : str
        What it is, in a sentence.
    level : str
        Of operation, in words, where the event is of a level alone.
    end_ns : int, optional
        None while it stands.
    snapshot : str
        Path of the recording of its moment; empty without one.
    context : Context
        At the begin.
    """

    begin_ns: int
    kind: EventKind
    point: str
    severity: Severity
    verdict: EventVerdict
    text: str
    level: str = ""
    end_ns: int | None = None
    snapshot: str = ""
    context: Context = UNKNOWN


@dataclass(frozen=True, slots=True)
class StoredEvent:
    """An event as it is read back.

    Attributes
    ----------
    number : int
        By which it is acknowledged.
    source : WindowSource
    event : Event
    acknowledged_by : str
        Empty as long as nobody has.
    acknowledged_ns : int, optional
    comment : str
    """

    number: int
    source: WindowSource
    event: Event
    acknowledged_by: str = ""
    acknowledged_ns: int | None = None
    comment: str = ""


@dataclass(frozen=True)
class EventSelection:
    """Which events are wanted; None and False leave that out.

    Attributes
    ----------
    since_ns, until_ns : int, optional
        Events that stood at or after, and that began before.
    kind : EventKind, optional
    point : str, optional
    machine : str, optional
        As in `Selection`.
    node : str, optional
        Name of the node that found them.
    source : SourceKind, optional
        Of the machine or of a replay.
    standing : bool
        Only those that have not ended.
    open : bool
        Only those that nobody has acknowledged.
    """

    since_ns: int | None = None
    until_ns: int | None = None
    kind: EventKind | None = None
    point: str | None = None
    machine: str | None = None
    node: str | None = None
    source: SourceKind | None = None
    standing: bool = False
    open: bool = False

    def condition(self) -> tuple[str, list[str | int]]:
        """Condition in SQL and its values."""
        parts: list[tuple[str, str | int | None]] = [
            ("ifnull(end_ns, 9e18) >= ?", self.since_ns),
            ("begin_ns < ?", self.until_ns),
            ("event = ?", self.kind),
            ("point = ?", self.point),
            (machine_condition(self.machine), self.machine),
            ("name = ?", self.node),
            ("kind = ?", self.source),
        ]
        given = [(text, value) for text, value in parts if value is not None]
        flags = ["end_ns IS NULL"] * self.standing + ["acknowledged_ns IS NULL"] * self.open
        return " AND ".join([*(text for text, _ in given), *flags]) or "1", [value for _, value in given]
