"""Every compared window of live and offline comparisons in one SQLite file, baselines made of them, and events."""

from tbm_gsa.history.baseline import BY_ORIGIN, Baseline, make_baseline
from tbm_gsa.history.context import CONTEXT_KEYS, UNKNOWN, Context, ContextKey
from tbm_gsa.history.entries import (
    SOURCE_KINDS,
    HistoryEntry,
    SourceKind,
    StateEntry,
    StoredEntry,
    StoredState,
    WatchSource,
    WindowGroup,
    WindowSource,
    live_entries,
    recording_entries,
)
from tbm_gsa.history.events import (
    EVENT_KINDS,
    Event,
    EventKind,
    EventSelection,
    EventVerdict,
    Severity,
    StoredEvent,
)
from tbm_gsa.history.queries import Queries, Selection
from tbm_gsa.history.reader import HistoryReader
from tbm_gsa.history.schema import HistoryError, HistoryLockedError
from tbm_gsa.history.store import History, check_history, default_history

__all__ = [
    "BY_ORIGIN",
    "CONTEXT_KEYS",
    "EVENT_KINDS",
    "SOURCE_KINDS",
    "UNKNOWN",
    "Baseline",
    "Context",
    "ContextKey",
    "Event",
    "EventKind",
    "EventSelection",
    "EventVerdict",
    "History",
    "HistoryEntry",
    "HistoryError",
    "HistoryLockedError",
    "HistoryReader",
    "Queries",
    "Selection",
    "Severity",
    "SourceKind",
    "StateEntry",
    "StoredEntry",
    "StoredEvent",
    "StoredState",
    "WatchSource",
    "WindowGroup",
    "WindowSource",
    "check_history",
    "default_history",
    "live_entries",
    "make_baseline",
    "recording_entries",
]
