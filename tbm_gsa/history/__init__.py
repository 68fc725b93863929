"""Every compared window of live and offline comparisons in one SQLite file, and baselines made of them."""

from tbm_gsa.history.baseline import BY_ORIGIN, Baseline, make_baseline
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
from tbm_gsa.history.queries import Queries, Selection
from tbm_gsa.history.reader import HistoryReader
from tbm_gsa.history.schema import HistoryError, HistoryLockedError
from tbm_gsa.history.store import History, check_history, default_history

__all__ = [
    "BY_ORIGIN",
    "SOURCE_KINDS",
    "Baseline",
    "History",
    "HistoryEntry",
    "HistoryError",
    "HistoryLockedError",
    "HistoryReader",
    "Queries",
    "Selection",
    "SourceKind",
    "StateEntry",
    "StoredEntry",
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
