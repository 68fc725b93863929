"""Watches in the history: spans and states, whole or not at all; a file that the version before wrote."""

import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest

from tbm_gsa.history import History, HistoryError, Selection, StateEntry, WatchSource
from tbm_gsa.history.summary import history_summary

MINUTE = 60_000_000_000
WATCH = WatchSource("live", "/tbm/analysis_node", "dz101", "ab" * 32, "commissioning", 0.7, 4e6, 9e6, "{}")
STATES = (
    StateEntry("rock", "lateral", 1.5, 1.4, 1.6, 0.99, 3 * MINUTE),
    StateEntry("machine", "x22", 0.6, 0.5, 0.7, 0.9),
    StateEntry("alarm", "machine", *(4 * [float("nan")]), 2 * MINUTE, "machine: x22 is 0.6"),
)


@pytest.fixture
def old(tmp_path):
    """A file that version 5 wrote: three windows of two sources, and a baseline."""
    path = tmp_path / "old.sqlite"
    connection = sqlite3.connect(path)
    connection.executescript(Path(__file__).with_name("history_5.sql").read_text())
    connection.close()
    return path


def test_a_file_of_version_5_is_kept_and_goes_on(old, tmp_path):
    with History(old) as opened:
        assert [window.entry.point for window in opened.windows()] == ["girder", "shield", "shield"]
        assert opened.baseline("sound").usual["shield", "x"].log_mean == -0.2
        assert opened.states() == opened.watches() == []
        opened.add_span(WATCH, MINUTE, b"", STATES, 1, 1)
    with History(tmp_path / "new.sqlite") as opened:
        pass
    connections = [sqlite3.connect(path) for path in (old, opened.path)]
    assert [one.execute("PRAGMA user_version").fetchone() for one in connections] == [(7,), (7,)]
    for table in ("watches", "spans", "states"):
        for pragma in ("table_info", "foreign_key_list"):
            found = [one.execute(f"PRAGMA {pragma}({table})").fetchall() for one in connections]
            assert found[0] == found[1]


def test_what_a_watch_said_last_comes_out(tmp_path):
    with History(tmp_path / "h.sqlite") as opened:
        for number in range(3):
            opened.add_span(WATCH, number * MINUTE, bytes([number]), STATES[: number + 1], 2, 1)
        other = replace(WATCH, speed=0.8)
        opened.add_span(other, 0, b"", STATES[:1], 2, 1)
        assert opened.watches() == [WATCH, other]
        assert opened.spans(WATCH) == [(0, b"\0"), (MINUTE, b"\1"), (2 * MINUTE, b"\2")]
        found = opened.states()
        assert [(one.watch, one.start_ns, one.entry.part) for one in found] == [
            (other, 0, "rock"),
            (WATCH, 2 * MINUTE, "alarm"),
            (WATCH, 2 * MINUTE, "machine"),
            (WATCH, 2 * MINUTE, "rock"),
        ]
        assert {repr(one.entry) for one in found[1:]} == set(map(repr, STATES))  # repr: NaN equals NaN
        last = history_summary(opened, Selection(), 1).states[-1]
    assert (last.name, last.since, last.speed_r_min) == (
        "lateral",
        "1970-01-01T00:03:00.000Z",
        pytest.approx(6.6845, rel=1e-5),
    )


def test_the_baseline_and_the_newest_spans_are_kept(tmp_path):
    with History(tmp_path / "h.sqlite") as opened:
        for number in range(9):
            opened.add_span(WATCH, number, b"", (), 3, 2)
        assert [start for start, _ in opened.spans(WATCH)] == [0, 1, 2, 7, 8]


def test_a_span_is_there_with_its_states_or_not_at_all(tmp_path):
    def failing():
        yield STATES[0]
        raise KeyboardInterrupt

    with History(tmp_path / "h.sqlite") as opened:
        with pytest.raises(KeyboardInterrupt):
            opened.add_span(WATCH, 0, b"", failing(), 1, 1)
        assert opened.watches() == opened.states() == []


def test_states_of_a_node_go_with_its_windows(tmp_path):
    with History(tmp_path / "h.sqlite") as opened:
        for number in range(4):
            opened.add_span(WATCH, number * MINUTE, b"", STATES, 9, 9)
        opened.discard(WATCH.node, 0, 2 * MINUTE, 10)
        starts = sqlite3.connect(opened.path).execute("SELECT DISTINCT start_ns FROM states").fetchall()
        assert starts == [(2 * MINUTE,), (3 * MINUTE,)]
        assert len(opened.spans(WATCH)) == 4


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ("UPDATE states SET part = 'moon'", "state"),
        ("UPDATE states SET value = 'much'", "state"),
        ("UPDATE watches SET speed = 'fast'", "watch"),
        ("UPDATE spans SET log_powers = 'text'", "span"),
    ],
)
def test_rows_that_no_watch_wrote_are_refused(tmp_path, change, what):
    with History(tmp_path / "h.sqlite") as opened:
        opened.add_span(WATCH, 0, b"", STATES, 1, 1)
        with sqlite3.connect(opened.path) as connection:
            connection.execute(change)
        with pytest.raises(HistoryError, match=f"a {what} that is not one of tbm_monitor"):
            opened.spans(WATCH)
            opened.watches()
            opened.states()


def test_the_command_prints_rock_machine_and_alarm(tmp_path, typed):
    with History(tmp_path / "h.sqlite") as opened:
        opened.add_span(WATCH, MINUTE, b"", STATES, 1, 1)
    code, out, _ = typed("history", "--history", str(opened.path), "--state")
    assert code == 0
    assert "dz101 at 6.68 r/min, 4e+03 kN·m, 9e+03 kN, after 1970-01-01T00:01 (baseline commissioning)" in out
    assert [line.split() for line in out.splitlines() if line.startswith(("alarm", "machine  ", "rock"))] == [
        ["alarm", "machine", "–", "–", "to", "–", "–", "1970-01-01T00:02"],
        ["machine", "x22", "0.6", "0.5", "to", "0.7", "0.9"],
        ["rock", "lateral", "1.5", "1.4", "to", "1.6", "0.99", "1970-01-01T00:03"],
    ]
    assert "machine: x22 is 0.6; since 1970-01-01T00:02" in out
    assert "x22" not in typed("history", "--history", str(opened.path))[1]
