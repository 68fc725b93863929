"""The events of a node: what is found begins one, what is found no more ends it; they outlive the node."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Final

from tbm_gsa.app.nodes.history_writer import HistoryWriter
from tbm_gsa.history import (
    Context,
    Event,
    EventKind,
    EventSelection,
    EventVerdict,
    History,
    Severity,
    SourceKind,
    StoredEvent,
)
from tbm_gsa.history.event_list import NEWEST, ListedEvent
from tbm_msgs_py.base.texts import LONGEST_LINE, printable

HOLD_NS: Final = 10_000_000_000
"""Time for which what was found has to be away before its event ends: what flickers is one event."""
Key = tuple[EventKind, str, str]
_Identity = tuple[SourceKind, int, Key]


@dataclass(frozen=True, slots=True)
class Finding:
    """What is found now, as an `Event` has it; `since_ns` where it began earlier than it was found."""

    kind: EventKind
    point: str
    severity: Severity
    verdict: EventVerdict
    text: str
    level: str = ""
    since_ns: int | None = None

    @property
    def key(self) -> Key:
        """By which it is the same as at the check before."""
        return self.kind, self.point, self.level


class EventKeeper:
    """Keeps the events of a node in memory and, as far as it can be written, in the history.

    An event that stood when the node ended goes on if it is found again.

    Parameters
    ----------
    history : HistoryWriter
    context_at : callable
        Context at a time, ns.
    record : callable
        Begins a recording of the moment of an event; its path, empty where none is made.
    tell : callable
        Called with every event that begins or ends.
    """

    def __init__(
        self,
        history: HistoryWriter,
        context_at: Callable[[int], Context],
        record: Callable[[Event], str],
        tell: Callable[[ListedEvent], object],
    ) -> None:
        self._history, self._context_at, self._record, self._tell = history, context_at, record, tell
        self._standing: dict[Key, StoredEvent] = {}
        self._absent: dict[Key, int] = {}  # of those that stand: since when they are not found
        self._unsaved: dict[_Identity, StoredEvent] = {}
        self._recent: dict[_Identity, StoredEvent] = {}
        self._seen: int | None = None  # state of the file that was read last
        self._adopted = False

    def update(self, found: Iterable[Finding], covers: Callable[[Key], bool], at_ns: int, kind: SourceKind) -> None:
        """Begin or continue the events of what a check found; what it covers and did not find may end.

        Parameters
        ----------
        found : iterable of Finding
        covers : callable
            Whether the check would have found what has a key.
        at_ns : int
            Time of the check, ns.
        kind : {"live", "replay"}
        """
        self._adopt()
        by_key = {one.key: one for one in found}
        for key, one in by_key.items():
            self._absent.pop(key, None)
            standing = self._standing.get(key)
            if standing is None:
                self._begin(one, at_ns, kind)
            elif one.verdict != standing.event.verdict:
                changed = replace(standing.event, verdict=one.verdict, severity=one.severity, text=_line(one.text))
                self._change(replace(standing, event=changed))
        for key in self._standing.keys() - by_key.keys():
            if covers(key):
                self._miss(key, at_ns)

    def poll(self) -> tuple[ListedEvent, ...]:
        """Write what waits; the newest events, and all that stand."""
        self._adopt()
        self._save()
        self._history.use(self._read)
        newest = sorted(self._recent.values(), key=lambda one: (one.event.begin_ns, one.number))
        return tuple(map(ListedEvent.of, newest))

    def drop_snapshot(self, path: str) -> None:
        """Remove the path of a recording that could not be written from its event."""
        for one in list(self._recent.values()):
            if one.event.snapshot == path:
                self._change(replace(one, event=replace(one.event, snapshot="")))

    def close(self, now_ns: int) -> None:
        """End the events of a replay, which nothing will go on with; those of the machine stand."""
        for key, one in list(self._standing.items()):
            if one.source.kind == "replay":
                self._end(key, now_ns)
        self._save()

    def _begin(self, one: Finding, at_ns: int, kind: SourceKind) -> None:
        begin_ns = at_ns if one.since_ns is None else one.since_ns
        said = (one.kind, one.point, one.severity, one.verdict, _line(one.text), one.level)
        event = Event(begin_ns, *said, context=self._context_at(begin_ns))
        event = replace(event, snapshot=self._record(event))
        made = StoredEvent(0, replace(self._history.source, kind=kind), event)
        self._standing[one.key] = made
        self._change(made)
        self._tell(ListedEvent.of(self._standing[one.key]))

    def _miss(self, key: Key, at_ns: int) -> None:
        """Take note that what stands was not found; it ends when that has lasted, in the time of its checks."""
        since_ns = self._absent.setdefault(key, at_ns)
        if at_ns < since_ns:  # the clock has jumped back
            self._absent[key] = at_ns
        elif at_ns - since_ns >= HOLD_NS:
            self._end(key, since_ns)

    def _end(self, key: Key, end_ns: int) -> None:
        self._absent.pop(key, None)
        standing = self._standing[key]
        ended = replace(standing, event=replace(standing.event, end_ns=max(end_ns, standing.event.begin_ns)))
        self._change(ended)
        del self._standing[key]
        self._tell(ListedEvent.of(self._recent[_identity(ended)]))

    def _change(self, one: StoredEvent) -> None:
        """Keep what has changed, and write it."""
        self._keep(one)
        if self._history.path:
            self._unsaved[_identity(one)] = one
            self._save()

    def _keep(self, one: StoredEvent) -> None:
        event = one.event
        self._recent[_identity(one)] = one
        if _key(event) in self._standing:
            self._standing[_key(event)] = one
        while len(self._recent) > NEWEST + len(self._standing):
            standing = {_identity(other) for other in self._standing.values()}
            del self._recent[next(known for known in self._recent if known not in standing)]

    def _save(self) -> None:
        if self._unsaved:
            self._history.use(self._write)

    def _write(self, history: History) -> None:
        for identity, one in list(self._unsaved.items()):
            stored = history.store_event(one.source, one.event)
            del self._unsaved[identity]
            self._keep(stored)
        self._seen = None

    def _read(self, history: History) -> None:
        """Read what others have written: events are acknowledged by a command."""
        if (state := history.state()) == self._seen:
            return
        own = EventSelection(machine=self._history.source.machine, node=self._history.source.name)
        found = [*history.events(replace(own, standing=True)), *history.events(own, NEWEST)]
        self._recent = {_identity(one): one for one in found} | self._unsaved
        self._seen = state

    def _adopt(self) -> None:
        """Take over, once, what stood when the node ended."""
        if not self._adopted:
            self._history.use(self._find_standing)

    def _find_standing(self, history: History) -> None:
        source = self._history.source
        for one in history.events(EventSelection(machine=source.machine, node=source.name, standing=True)):
            self._standing.setdefault(_key(one.event), one)
        self._adopted = True


def _key(event: Event) -> Key:
    return event.kind, event.point, event.level


def _identity(one: StoredEvent) -> _Identity:
    return one.source.kind, one.event.begin_ns, _key(one.event)


def _line(text: str) -> str:
    line = printable(text)
    return line if len(line) <= LONGEST_LINE else f"{line[: LONGEST_LINE - 1]}…"
