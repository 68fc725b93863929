"""Events as statuses on `analysis/events`, and read back from there."""

from __future__ import annotations

from typing import Final

from diagnostic_msgs.msg import DiagnosticStatus
from pydantic import ValidationError

from tbm_gsa.history import Severity
from tbm_gsa.history.event_list import ListedEvent
from tbm_msgs_py.nodes import messages

_LEVELS: Final[dict[Severity, messages.Level]] = {"info": "ok", "warning": "warn", "error": "error"}
_MAYBE: Final = ("id", "end", "acknowledged", "ring", "chainage", "rock_class", "shift")  # keys that may be null


def event_status(prefix: str, event: ListedEvent) -> DiagnosticStatus:
    """One event; an ended one is no fault any more. `name` and `since` are those of `rock` and `machine`."""
    values = {key: "" if value is None else value for key, value in event.model_dump(exclude={"text"}).items()}
    values |= {"node": event.name, "name": event.kind, "since": event.begin}
    level: messages.Level = "ok" if event.end else _LEVELS[event.severity]
    return messages.status(f"{prefix} {event.id or event.begin} {event.kind}", level, event.text, values, event.machine)


def listed_event(status: DiagnosticStatus) -> ListedEvent | None:
    """Event that `event_status` has made a status of; None of any other status."""
    told = {pair.key: pair.value for pair in status.values}
    known = {key: told[key] for key in ListedEvent.model_fields if key in told}
    values = {key: None if value == "" and key in _MAYBE else value for key, value in known.items()}
    values |= {"text": status.message, "name": told.get("node")}
    try:
        return ListedEvent.model_validate(values, strict=False)
    except ValidationError:
        return None
