"""Windows of the analysis node on their way into the history, past a file that is locked, unusable or of a stranger.

The lock is SQLite's own, held by a connection of the standard library.
"""

import sqlite3
import time
from contextlib import contextmanager

import numpy as np
import pytest

from tbm_gsa.comparison import WindowResult
from tbm_gsa.history import Baseline, History, HistoryError, Source
from tbm_gsa.history.baseline import Usual
from tbm_gsa.nodes import history_writer
from tbm_gsa.nodes.history_writer import HistoryWriter

SECOND = 1_000_000_000
SOURCE = Source("live", "/tbm/analysis_node", "", "dz101", "sum")


def window(number):
    three = np.ones(3)
    return WindowResult(
        "shield", number * 2 * SECOND, 2 * SECOND, three, three, 0.1 * three, 1.0, 1.0, three, 3 * three
    )


@contextmanager
def locked(file):
    other = sqlite3.connect(file, isolation_level=None)
    other.execute("BEGIN EXCLUSIVE")
    yield
    other.execute("ROLLBACK")
    other.close()


@pytest.fixture
def said():
    return []


@pytest.fixture
def writer(tmp_path, said, monkeypatch):
    monkeypatch.setattr(history_writer, "WAIT_S", 0.0)
    made = HistoryWriter(str(tmp_path / "h.sqlite"), SOURCE, said.append)
    yield made
    made.close()


def starts(file):
    with History(file) as history:
        return sorted({found.entry.start_ns // (2 * SECOND) for found in history.windows()})


def test_windows_wait_while_the_file_is_locked(tmp_path, writer, said):
    writer.add(window(0), rotating=False)
    assert (writer.written, writer.problem) == (3, "")
    with locked(tmp_path / "h.sqlite"):
        writer.add(window(1), rotating=False)
        writer.add(window(2), rotating=False)
        assert writer.problem == "database is locked"
        assert writer.written == 3
    assert said == ["history: database is locked; the comparison goes on"]
    writer.add(window(3), rotating=False)
    assert (writer.written, writer.lost, writer.problem) == (12, 0, "")
    assert starts(tmp_path / "h.sqlite") == [0, 1, 2, 3]


def test_the_oldest_are_lost_when_too_many_wait(tmp_path, writer, monkeypatch):
    monkeypatch.setattr(history_writer, "MOST_WAITING", 6)
    with locked(tmp_path / "h.sqlite"):
        for number in range(4):
            writer.add(window(number), rotating=False)
    assert writer.lost == 6
    writer.close()  # tries once more
    assert starts(tmp_path / "h.sqlite") == [2, 3]


def test_a_default_file_that_cannot_be_used_only_warns(tmp_path, said, monkeypatch):
    monkeypatch.setenv("TBM_HISTORY", str(tmp_path / "h.sqlite"))
    (tmp_path / "h.sqlite").write_text("no database")
    writer = HistoryWriter("", SOURCE, said.append)
    writer.add(window(0), rotating=False)
    writer.close()
    assert (writer.path, writer.written) == (str(tmp_path / "h.sqlite"), 0)
    assert len(said) == 1
    assert "h.sqlite" in said[0]
    with pytest.raises(HistoryError, match="no history to find it in"):
        writer.usual_errors("sound")
    with pytest.raises(HistoryError, match=r"h\.sqlite"):
        HistoryWriter(str(tmp_path / "h.sqlite"), SOURCE, said.append)


@pytest.mark.parametrize("named", [True, False])
def test_a_file_that_is_locked_at_the_start_is_tried_again(tmp_path, said, monkeypatch, named):
    file = tmp_path / "h.sqlite"
    monkeypatch.setenv("TBM_HISTORY", str(file))
    monkeypatch.setattr(history_writer, "WAIT_S", 0.0)
    monkeypatch.setattr(history_writer, "MOST_WAITING", 6)
    with locked(file):
        writer = HistoryWriter(str(file) if named else "", SOURCE, said.append)
        for number in range(3):
            writer.add(window(number), rotating=False)
        with pytest.raises(HistoryError, match=r"baseline sound: no history to find it in \(.*is locked"):
            writer.usual_errors("sound")
    assert (writer.written, writer.lost, writer.problem) == (0, 3, f"{file}: database is locked")
    assert said == [f"history: {file}: database is locked; the comparison goes on"]
    writer.add(window(3), rotating=False)
    assert (writer.written, writer.lost) == (0, 6), "too early to try again"
    monkeypatch.setattr(writer, "_next_try", 0.0)
    writer.add(window(4), rotating=False)
    assert (writer.written, writer.lost, writer.problem) == (6, 9, "")
    writer.close()
    assert starts(file) == [3, 4]


def test_windows_that_are_too_old_are_deleted_but_none_because_of_a_stamp_of_the_future(tmp_path, said, monkeypatch):
    file, day = tmp_path / "h.sqlite", 43_200  # windows
    writer = HistoryWriter(str(file), SOURCE, said.append, days=1.0)
    for number in range(10):
        writer.add(window(number), rotating=False)
    writer.add(window(day + 5), rotating=False)
    assert len(starts(file)) == 11, "too early to look again"
    monkeypatch.setattr(history_writer, "DISCARD_S", 0.0)
    writer._next_discard = 0.0
    monkeypatch.setattr(history_writer, "MOST_DISCARDED", 9)
    for place, left in enumerate(([3, 4, 5, 6, 7, 8, 9], [5, 6, 7, 8, 9])):
        writer.add(window(day + 5), rotating=False)
        assert starts(file) == [*left, day + 5], place
    now = time.time_ns() // (2 * SECOND)
    for number in (now - 5, now, 2 * now, now):
        writer.add(window(number), rotating=False)
    assert {now - 5, now} < set(starts(file))
    writer.close()
    forever = HistoryWriter(str(file), SOURCE, said.append, days=0.0)
    forever.add(window(2 * now), rotating=False)
    assert {now - 5, now} < set(starts(file))
    forever.close()
    assert said == []


def test_a_file_that_fails_gives_no_baseline_and_a_reason(tmp_path, writer):
    with sqlite3.connect(tmp_path / "h.sqlite") as other:
        other.execute("DROP TABLE usual_errors")
        other.execute("DROP TABLE baselines")
    with pytest.raises(HistoryError, match=r"baseline sound: .*h\.sqlite: no such table: baselines"):
        writer.usual_errors("sound")


def test_a_baseline_has_to_be_of_the_same_machine(tmp_path, writer):
    usual = {("shield", "x"): Usual(0.4, 0.01, 9)}
    with History(tmp_path / "h.sqlite") as history:
        history.store_baseline(Baseline("sound", "dz101", "", 1, 0, 1, usual))
        for name in ("sound", "foreign"):
            history.store_baseline(Baseline(name, "open380", "", 1, 0, 1, {("shield", "x"): Usual(0.9, 0.01, 9)}))
    assert np.asarray(writer.usual_errors("sound")["shield"].mean)[0] == 0.4
    with pytest.raises(HistoryError, match="baseline foreign: of machine open380, allowed: one of dz101"):
        writer.usual_errors("foreign")


def test_none_keeps_nothing(said):
    writer = HistoryWriter("none", SOURCE, said.append)
    writer.add(window(0), rotating=False)
    assert (writer.path, writer.written, said) == ("", 0, [])
