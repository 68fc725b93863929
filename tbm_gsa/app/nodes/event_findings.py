"""What of the watch, of the simple alarm and of the signals makes events."""

from __future__ import annotations

from collections.abc import Iterator

from tbm_gsa.app.nodes.event_keeper import Finding
from tbm_gsa.app.nodes.statuses import dead_channels, holes
from tbm_gsa.app.nodes.stream_health import Condition
from tbm_gsa.app.nodes.watch_statuses import alarm_text, rock_text
from tbm_gsa.comparison import WindowResult
from tbm_gsa.explanation.machine_watch import LIKELY, WatchState
from tbm_gsa.history import EventKind, EventVerdict

SIGNAL_KINDS: tuple[EventKind, ...] = ("refused", "silent", "dead", "lost")


def watch_findings(level: str, state: WatchState) -> Iterator[Finding]:
    """Alarm and change of the rock after a minute at a level of operation."""
    alarm = state.alarm
    if alarm is not None:
        point = alarm.sensor.point if alarm.sensor else ""
        named: EventVerdict = alarm.kind if alarm.sensor or alarm.input else "not explained"
        yield Finding(alarm.kind, point, "warning", named, alarm_text(state), level, alarm.since_ns)
    since = [one.since_ns for one in state.loads if one.probability >= LIKELY and one.since_ns is not None]
    if since:
        yield Finding("rock", "", "info", "rock", f"rock {rock_text(state)}", level, min(since))


class SignalFindings:
    """Faults of the signals at the test points, look by look.

    Holes count once a point has had a whole window since its signals came: in the first a filter settles.
    """

    def __init__(self) -> None:
        self._whole: set[str] = set()

    def at(self, point: str, latest: WindowResult | None, condition: Condition) -> Iterator[Finding]:
        """Faults at a test point, by its latest window and what was found since the last look."""
        if condition.refused:
            yield Finding("refused", point, "error", "", "; ".join(condition.refused))
        if condition.silent:
            self._whole.discard(point)
            yield Finding("silent", point, "error", _of_sensor(condition.silent), "; ".join(condition.silent))
        if latest is None:
            return
        if latest.operation == "steady" and (dead := dead_channels(latest)):
            yield Finding("dead", point, "error", "sensor", "; ".join(dead))
        missing = holes(latest)
        if not missing:
            self._whole.add(point)
        elif point in self._whole:
            yield Finding("lost", point, "warning", _of_sensor(missing), "; ".join(missing))


def _of_sensor(texts: list[str]) -> EventVerdict:
    """Verdict: a fault of the field's signal is one of the sensor or its line; of the model's, of a node."""
    return "sensor" if any("field" in text for text in texts) else ""
