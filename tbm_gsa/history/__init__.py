"""Every compared window of live and offline comparisons in one SQLite file, and baselines made of them."""

from tbm_gsa.history.baseline import BY_ORIGIN, Baseline, make_baseline
from tbm_gsa.history.entries import KINDS, Entry, Group, Kind, Source, Window, live_entries, recording_entries
from tbm_gsa.history.errors import HistoryError, HistoryLockedError
from tbm_gsa.history.queries import Queries, Selection
from tbm_gsa.history.reading import HistoryReader
from tbm_gsa.history.store import History, check_history, default_history

__all__ = [
    "BY_ORIGIN",
    "KINDS",
    "Baseline",
    "Entry",
    "Group",
    "History",
    "HistoryError",
    "HistoryLockedError",
    "HistoryReader",
    "Kind",
    "Queries",
    "Selection",
    "Source",
    "Window",
    "check_history",
    "default_history",
    "live_entries",
    "make_baseline",
    "recording_entries",
]
