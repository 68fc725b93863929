"""Windows of the analysis node on their way into the history, past a file that is locked, unusable or of a stranger.

The lock is SQLite's own, held by a connection of the standard library.
"""

import sqlite3
import time
from contextlib import contextmanager

import numpy as np
import pytest

from tbm_gsa.app.nodes import history_writer
from tbm_gsa.app.nodes.history_writer import HistoryWriter, kind_of, live_now
from tbm_gsa.comparison import WindowResult
from tbm_gsa.history import Baseline, History, HistoryError, WindowSource
from tbm_gsa.history.baseline import ErrorStatistics

SECOND = 1_000_000_000
SOURCE = WindowSource("live", "/tbm/analysis_node", "", "dz101", "sum")


def window(number):
    three = np.ones(3)
    return WindowResult(
        "shield", number * 2 * SECOND, 2 * SECOND, three, three, 0.1 * three, 1.0, 1.0, three, 3 * three
    )


def add(writer, number):
    """Hand over a live window: the computer's clock stands at its end."""
    writer.add(window(number), False, (number + 1) * 2 * SECOND)


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
    add(writer, 0)
    assert (writer.written, writer.problem) == (3, "")
    with locked(tmp_path / "h.sqlite"):
        add(writer, 1)
        add(writer, 2)
        assert writer.problem == "database is locked"
        assert writer.written == 3
    assert said == ["history: database is locked; the comparison goes on"]
    add(writer, 3)
    assert (writer.written, writer.lost, writer.problem) == (12, 0, "")
    assert starts(tmp_path / "h.sqlite") == [0, 1, 2, 3]


def test_the_oldest_are_lost_when_too_many_wait(tmp_path, writer, monkeypatch):
    monkeypatch.setattr(history_writer, "MOST_WAITING", 6)
    with locked(tmp_path / "h.sqlite"):
        for number in range(4):
            add(writer, number)
    assert writer.lost == 6
    writer.close()  # tries once more
    assert starts(tmp_path / "h.sqlite") == [2, 3]


def test_a_default_file_that_cannot_be_used_only_warns(tmp_path, said, monkeypatch):
    monkeypatch.setenv("TBM_HISTORY", str(tmp_path / "h.sqlite"))
    (tmp_path / "h.sqlite").write_text("no database")
    writer = HistoryWriter("", SOURCE, said.append)
    add(writer, 0)
    writer.close()
    assert (writer.path, writer.written) == (str(tmp_path / "h.sqlite"), 0)
    assert len(said) == 1
    assert "h.sqlite" in said[0]
    with pytest.raises(HistoryError, match="no history to find it in"):
        writer.usual_ratios("sound")
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
            add(writer, number)
        with pytest.raises(HistoryError, match=r"baseline sound: no history to find it in \(.*is locked"):
            writer.usual_ratios("sound")
    assert (writer.written, writer.lost, writer.problem) == (0, 3, f"{file}: database is locked")
    assert said == [f"history: {file}: database is locked; the comparison goes on"]
    add(writer, 3)
    assert (writer.written, writer.lost) == (0, 6), "too early to try again"
    monkeypatch.setattr(writer, "_next_try", 0.0)
    add(writer, 4)
    assert (writer.written, writer.lost, writer.problem) == (6, 9, "")
    writer.close()
    assert starts(file) == [3, 4]


def test_a_stamp_of_the_future_deletes_no_window(tmp_path, said, monkeypatch):
    file, day = tmp_path / "h.sqlite", 43_200  # windows
    writer = HistoryWriter(str(file), SOURCE, said.append, days=1.0)
    for number in range(10):
        add(writer, number)
    add(writer, day + 5)
    assert len(starts(file)) == 11, "too early to look again"
    monkeypatch.setattr(history_writer, "DISCARD_S", 0.0)
    writer._next_discard = 0.0
    monkeypatch.setattr(history_writer, "MOST_DISCARDED", 9)
    for place, left in enumerate(([3, 4, 5, 6, 7, 8, 9], [5, 6, 7, 8, 9])):
        add(writer, day + 5)
        assert starts(file) == [*left, day + 5], place
    now = time.time_ns() // (2 * SECOND)
    for number in (now - 5, now, 2 * now, now):
        add(writer, number)
    assert {now - 5, now} < set(starts(file))
    writer.close()
    forever = HistoryWriter(str(file), SOURCE, said.append, days=0.0)
    add(forever, 2 * now)
    assert {now - 5, now} < set(starts(file))
    forever.close()
    assert said == []


@pytest.mark.parametrize(
    ("late", "kind"),
    [(0, "live"), (59 * SECOND, "live"), (-59 * SECOND, "live"), (61 * SECOND, "replay"), (-61 * SECOND, "replay")],
)
def test_a_window_is_a_replay_if_its_stamps_are_not_of_now(late, kind):
    assert kind_of(16 * SECOND, 16 * SECOND + late) == kind


def test_a_window_on_a_simulated_clock_is_a_replay():
    rclpy_clock = pytest.importorskip("rclpy.clock")
    clock = rclpy_clock.ROSClock()
    assert live_now(clock) == pytest.approx(time.time_ns(), abs=600 * SECOND)
    clock._set_ros_time_is_active(True)  # what `use_sim_time` does
    assert live_now(clock) is None
    assert kind_of(16 * SECOND, None) == "replay"


def test_live_and_replayed_windows_are_kept_apart_through_a_lock(tmp_path, writer):
    with locked(tmp_path / "h.sqlite"):
        for number in (0, 1):
            add(writer, number)
        for number in (1, 2):
            writer.add(window(number), False, None)
        add(writer, 3)
    writer.add(window(4), False, None)
    with History(tmp_path / "h.sqlite") as history:
        found = [(one.source.kind, one.entry.start_ns // (2 * SECOND)) for one in history.windows()]
    assert sorted(set(found)) == [*(("live", number) for number in (0, 1, 3)), *(("replay", n) for n in (1, 2, 4))]
    assert (writer.written, writer.lost, writer.problem) == (18, 0, "")


def test_windows_of_a_replay_have_no_age(tmp_path, said, monkeypatch):
    monkeypatch.setattr(history_writer, "DISCARD_S", 0.0)
    day, file = 43_200, tmp_path / "h.sqlite"  # windows
    writer = HistoryWriter(str(file), SOURCE, said.append, days=1.0)
    add(writer, 0)
    for number in (1, 3 * day):
        writer.add(window(number), False, None)
    assert starts(file) == [0, 1, 3 * day]
    add(writer, 3 * day)  # the live one of the first day goes, the replay of that day stays
    assert starts(file) == [1, 3 * day]
    writer.close()


def test_a_baseline_of_a_synthetic_recording_is_a_warning(tmp_path, writer, said):
    usual = {("shield", "x"): ErrorStatistics(0.4, 0.01, 9, -0.34, 0.01)}
    with History(tmp_path / "h.sqlite") as history:
        for kind in ("offline", "synthetic"):
            history.store_baseline(Baseline(kind, "dz101", "", 1, 0, 1, usual, kind))
    assert np.asarray(writer.usual_ratios("offline")["shield"].mean)[0] == -0.34
    assert said == []
    assert np.asarray(writer.usual_ratios("synthetic")["shield"].mean)[0] == -0.34
    assert said == ["baseline synthetic: of a synthetic recording: alarms are set against nothing measured"]


@pytest.mark.parametrize(
    ("usual", "warning"),
    [
        (ErrorStatistics(0.4, 0.01, 9), "of an older version, without logarithms of levels: make it anew"),
        (ErrorStatistics(0.4, 0.3, 9, -0.34, 0.3), "shield x scatters so much that only a change by a factor of 2.5"),
    ],
)
def test_a_baseline_that_is_of_no_use_is_a_warning(tmp_path, writer, said, usual, warning):
    with History(tmp_path / "h.sqlite") as history:
        history.store_baseline(Baseline("one", "dz101", "", 1, 0, 1, {("shield", "x"): usual}, "live"))
    assert ("shield" in writer.usual_ratios("one")) == (usual.log_mean is not None)
    assert len(said) == 1
    assert warning in said[0]


def test_a_file_that_fails_gives_no_baseline_and_a_reason(tmp_path, writer):
    with sqlite3.connect(tmp_path / "h.sqlite") as other:
        other.execute("DROP TABLE usual_errors")
        other.execute("DROP TABLE baselines")
    with pytest.raises(HistoryError, match=r"baseline sound: .*h\.sqlite: no such table: baselines"):
        writer.usual_ratios("sound")


def test_a_baseline_has_to_be_of_the_same_machine(tmp_path, writer):
    usual = {("shield", "x"): ErrorStatistics(0.4, 0.01, 9, -0.34, 0.01)}
    with History(tmp_path / "h.sqlite") as history:
        history.store_baseline(Baseline("sound", "dz101", "", 1, 0, 1, usual))
        for name in ("sound", "foreign"):
            history.store_baseline(
                Baseline(name, "open380", "", 1, 0, 1, {("shield", "x"): ErrorStatistics(0.9, 0.01, 9, -0.64, 0.01)})
            )
    assert np.asarray(writer.usual_ratios("sound")["shield"].mean)[0] == -0.34
    with pytest.raises(HistoryError, match="baseline foreign: of machine open380, allowed: one of dz101"):
        writer.usual_ratios("foreign")


def test_a_history_of_none_keeps_nothing(said):
    writer = HistoryWriter("none", SOURCE, said.append)
    add(writer, 0)
    assert (writer.path, writer.written, said) == ("", 0, [])
