"""Every compared window of live and offline comparisons in one SQLite file, and baselines made of them."""

from tbm_gsa.history.baseline import BY_MACHINE, Baseline, make_baseline
from tbm_gsa.history.entries import Entry, Group, Source, Window, live_entries, recording_entries
from tbm_gsa.history.errors import HistoryError, HistoryLockedError
from tbm_gsa.history.queries import Queries, Selection
from tbm_gsa.history.reading import HistoryReader
from tbm_gsa.history.store import History, default_history

__all__ = [
    "BY_MACHINE",
    "Baseline",
    "Entry",
    "Group",
    "History",
    "HistoryError",
    "HistoryLockedError",
    "HistoryReader",
    "Queries",
    "Selection",
    "Source",
    "Window",
    "default_history",
    "live_entries",
    "make_baseline",
    "recording_entries",
]
