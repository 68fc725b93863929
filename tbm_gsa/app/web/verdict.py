"""How it is, in one sentence: what is missing first, then what stands, the gravest first."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from tbm_gsa.app.web.state import NodeState, Verdict, VerdictKind
from tbm_gsa.history.event_list import ListedEvent

_SIGNAL_KINDS = ("dead", "silent", "lost", "refused")


@dataclass(frozen=True)
class Situation:
    """What is known at a moment.

    Attributes
    ----------
    now : str
        ISO 8601, as all times.
    nodes : sequence of NodeState
        That have to be there.
    events : sequence of ListedEvent
        The newest ones, the oldest first.
    unseen : str
        Since when no signal of the field has been compared; empty while there is one.
    still : str
        Since when the machine stands still; empty while it turns.
    learning : str
        Why a change of the machine cannot be seen yet; empty once it can.
    """

    now: str
    nodes: Sequence[NodeState] = ()
    events: Sequence[ListedEvent] = ()
    unseen: str = ""
    still: str = ""
    learning: str = ""


@dataclass(frozen=True)
class _Finding:
    kind: VerdictKind
    title: str
    text: str
    since: str | None


def judge(situation: Situation, before: Verdict | None = None) -> Verdict:
    """Verdict of a situation; what has no time of its own stands since the verdict before, if that was the same."""
    found = [*_missing(situation), *_standing(situation.events), *_quiet(situation)]
    found = sorted(found, key=lambda one: _ORDER.index(one.kind))
    first, others = found[0], found[1:]
    since = first.since
    if since is None:
        same = before is not None and before.kind == first.kind
        since = before.since if before is not None and same else situation.now
    also = [one.text for one in others if one.kind not in ("well", "learning")]
    also += [f"{node.name}: {node.text}" for node in situation.nodes if node.condition == "faulty"]
    return Verdict(kind=first.kind, title=first.title, text=first.text, since=since, also=tuple(also))


_ORDER: tuple[VerdictKind, ...] = ("no_data", "machine", "sensor", "level", "still", "rock", "learning", "well")


def _missing(situation: Situation) -> Iterable[_Finding]:
    gone = [node for node in situation.nodes if node.condition in ("missing", "inactive")]
    if gone:
        text = "; ".join(f"{node.name}: {node.text}" for node in gone)
        names = ", ".join(node.name for node in gone)
        missing = any(node.condition == "missing" for node in gone)
        title = f"No data: {names} {'is' if len(gone) == 1 else 'are'} {'missing' if missing else 'not active'}"
        if all(node.condition == "missing" for node in situation.nodes) and len(gone) > 1:
            title = "No data: no node is heard"
        since = min((node.heard for node in gone if node.heard and node.condition == "missing"), default=None)
        yield _Finding("no_data", title, text, since)
    elif situation.unseen:
        yield _Finding("no_data", "No data: no sensor is heard", "no signal of the field", situation.unseen)


def _standing(events: Sequence[ListedEvent]) -> Iterable[_Finding]:
    standing = [event for event in events if event.end is None]
    for event in standing:
        if event.kind == "machine":
            title = "Machine changed" if event.verdict == "machine" else "Something changed, not explained"
            yield _Finding("machine", title, event.text, event.begin)
        elif event.kind == "level":
            yield _Finding("level", f"Level not as expected: {event.point}", event.text, event.begin)
        elif event.kind == "rock":
            yield _Finding("rock", "Rock changed", event.text, event.begin)
    sensors = [event for event in standing if event.kind == "sensor" or event.kind in _SIGNAL_KINDS]
    for event in sensors:
        place = f"{event.point}: " if event.point and not event.text.startswith(event.point) else ""
        points = ", ".join(dict.fromkeys(one.point for one in sensors if one.point))
        title = f"Sensor: {points}" if points else "Sensor"
        yield _Finding("sensor", title, f"{place}{event.text}", event.begin)


def _quiet(situation: Situation) -> Iterable[_Finding]:
    if situation.still:
        yield _Finding("still", "Not boring", "the cutterhead does not turn", situation.still)
    ended = max((event.end for event in situation.events if event.end is not None), default=None)
    if situation.learning:
        yield _Finding("learning", "No alarm, still learning", situation.learning, None)
    yield _Finding("well", "All well", "machine, rock and sensors are as at the commissioning", ended)
