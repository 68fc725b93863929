"""The result of `tbm-monitor events`, and what `analysis/events` and a site's hook get: its keys are a contract."""

from __future__ import annotations

from dataclasses import asdict
from typing import Final

from tbm_gsa.history.entries import SourceKind
from tbm_gsa.history.events import EventKind, EventSelection, EventVerdict, Severity, StoredEvent
from tbm_gsa.history.queries import Queries
from tbm_gsa.reading import Part
from tbm_msgs_py.base.units import iso_time

NEWEST: Final = 100
"""Events that are listed unless another number is asked for."""


class ListedEvent(Part):
    """An event as it is listed; times in ISO 8601, UTC.

    `id` is the number by which it is acknowledged, null of one that no history holds; `end` is null while it stands.
    """

    id: int | None
    begin: str
    end: str | None
    kind: EventKind
    point: str
    severity: Severity
    verdict: EventVerdict
    text: str
    level: str
    snapshot: str
    acknowledged_by: str
    acknowledged: str | None
    comment: str
    ring: int | None
    chainage: float | None
    rock_class: str | None
    shift: str | None
    source: SourceKind
    name: str
    machine: str

    @classmethod
    def of(cls, found: StoredEvent) -> ListedEvent:
        """Event as it is listed; the number 0 is none."""
        event, source = found.event, found.source
        return cls(
            id=found.number or None,
            begin=iso_time(event.begin_ns),
            end=_moment(event.end_ns),
            kind=event.kind,
            point=event.point,
            severity=event.severity,
            verdict=event.verdict,
            text=event.text,
            level=event.level,
            snapshot=event.snapshot,
            acknowledged_by=found.acknowledged_by,
            acknowledged=_moment(found.acknowledged_ns),
            comment=found.comment,
            **asdict(event.context),
            source=source.kind,
            name=source.name,
            machine=source.machine,
        )


class EventList(Part):
    """The newest events of a selection, in the order of their begin."""

    path: str
    events: tuple[ListedEvent, ...]

    @classmethod
    def of(cls, history: Queries, selection: EventSelection, newest: int | None = None) -> EventList:
        """Events of an open history."""
        return cls(path=str(history.path), events=tuple(map(ListedEvent.of, history.events(selection, newest))))


def _moment(stamp_ns: int | None) -> str | None:
    return None if stamp_ns is None else iso_time(stamp_ns)
