"""Trends that SQLite sums up, against numpy on the same windows."""

import math
from threading import Thread

import numpy as np
import pytest

from tbm_gsa.app.web.site import MachineSite
from tbm_gsa.app.web.spectra import LiveSpectra
from tbm_gsa.app.web.state import Acknowledgement
from tbm_gsa.app.web.trends import TrendReader
from tbm_gsa.history import Event, History, HistoryEntry, Selection, WindowSource
from tbm_gsa.history.trends import trend_rows

MINUTE = 60 * 10**9
START = 1_700_000_000 * 10**9 // (120 * MINUTE) * 120 * MINUTE
SOURCE = WindowSource("live", "/tbm/analysis_node", "", "dz101", "ab" * 32)


@pytest.fixture(scope="module")
def windows():
    """Point, axis, begin, measured, computed, error: three minutes with holes, a dead sensor, another machine's."""
    random = np.random.default_rng(3)
    made = []
    for place in range(90):
        for point in ("girder", "shield"):
            measured, computed = random.lognormal(0.0, 0.3, 2)
            error = math.nan if place % 10 == 0 else 0.1
            made.append(HistoryEntry(point, "x", START + place * 2 * 10**9, 2 * 10**9, measured, computed, error, 1.0))
            made.append(HistoryEntry(point, "y", START + place * 2 * 10**9, 2 * 10**9, 99.0, 1.0, 0.1, 1.0))
    made.append(HistoryEntry("girder", "x", START + 1, 2 * 10**9, 1e-4, 1.0, 0.1, 1.0))
    made.append(HistoryEntry("girder", "x", START + 3, 2 * 10**9, 1.0, math.nan, 0.1, 1.0))
    return made


@pytest.fixture(scope="module")
def file(windows, tmp_path_factory):
    path = tmp_path_factory.mktemp("history") / "h.sqlite"
    with History(path) as history:
        history.add(SOURCE, windows)
        other = WindowSource("replay", "/tbm/analysis_node", "", "dz101", "ab" * 32)
        history.add(other, [HistoryEntry("girder", "x", START, 2 * 10**9, 50.0, 1.0, 0.1, 1.0)])
    return path


def test_a_bin_is_what_numpy_makes_of_its_windows(file, windows):
    with History(file) as history:
        rows = trend_rows(history, Selection(source="live", machine="ab" * 32, axis="x"), MINUTE)
    assert [(row.point, (row.begin_ns - START) // MINUTE) for row in rows] == [
        (point, minute) for minute in range(3) for point in ("girder", "shield")
    ]
    for row in rows:
        inside = [
            one
            for one in windows
            if (one.point, one.axis) == (row.point, "x")
            and row.begin_ns <= one.start_ns < row.begin_ns + MINUTE
            and one.model_rms > 0.0
            and not math.isnan(one.relative_error)
            and one.field_rms > 0.01 * one.model_rms
        ]
        ratio = [one.field_rms / one.model_rms for one in inside]
        assert row.windows == len(inside) == 27
        expected = np.quantile(ratio, [0.05, 0.5, 0.95], method="nearest")
        assert [row.low, row.median, row.high] == pytest.approx(expected, rel=1e-12)
        assert row.level == pytest.approx(np.median([one.field_rms for one in inside]))


def test_bins_that_are_over_are_read_once(file, monkeypatch):
    reader = TrendReader(file, "ab" * 32, None)
    now = START + 5 * MINUTE
    first = reader.read("hour", now, "live")
    assert [len(bins) for bins in first.points.values()] == [3, 3]
    read = []
    monkeypatch.setattr("tbm_gsa.app.web.trends.trend_rows", lambda _, chosen, __: read.append(chosen.since_ns) or [])
    again = reader.read("hour", now, "live")
    assert again.points == first.points
    assert read == [START + 4 * MINUTE, START + 5 * MINUTE]  # that just ended, and that is not over
    assert reader.read("hour", now, "replay").points == {}


def test_an_event_is_acknowledged_while_trends_are_read(tmp_path, machine, monkeypatch):
    """One process: SQLite would refuse to write what it has open to read only."""
    path = tmp_path / "h.sqlite"
    with History(path) as keeps_its_log:
        event = keeps_its_log.store_event(SOURCE, Event(START, "dead", "girder", "error", "sensor", "nothing"))
        reader = TrendReader(path, "ab" * 32, None)
        site = MachineSite(machine, LiveSpectra([]), tmp_path, path, reader.lock)
        seen = []
        asked = Acknowledgement(id=event.number, by="Anna")
        asking = Thread(target=lambda: seen.append(site.acknowledge(asked)))

        def trend_rows(*_):
            if not seen and not asking.ident:
                asking.start()
                asking.join(0.02)  # it waits, and is not refused
                assert asking.is_alive()
            return []

        monkeypatch.setattr("tbm_gsa.app.web.trends.trend_rows", trend_rows)
        assert reader.read("day", START, "live").problem == ""
        asking.join()
    assert [one.acknowledged_by for one in seen] == ["Anna"]


def test_a_history_that_is_not_there_is_said(tmp_path):
    missing = TrendReader(tmp_path / "h.sqlite", "ab" * 32, None).read("day", START, "live")
    assert "no such history" in missing.problem
    assert TrendReader(None, "ab" * 32, None).read("day", START, "live").problem == "no history is kept"
