"""Every compared window of live and offline comparisons in one SQLite file, and baselines made of them."""

from tbm_gsa.history.baseline import Baseline, make_baseline
from tbm_gsa.history.entries import Entry, Source, Window, live_entries, recording_entries
from tbm_gsa.history.store import History, HistoryError, Selection, default_history

__all__ = [
    "Baseline",
    "Entry",
    "History",
    "HistoryError",
    "Selection",
    "Source",
    "Window",
    "default_history",
    "live_entries",
    "make_baseline",
    "recording_entries",
]
