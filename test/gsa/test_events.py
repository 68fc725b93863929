"""Events and contexts in the history: kept once, ended, acknowledged, listed; a file of the version before goes on."""

import json
import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tbm_gsa.history import (
    Context,
    Event,
    EventSelection,
    History,
    HistoryEntry,
    HistoryError,
    Selection,
    WindowSource,
)
from tbm_gsa.history.context import ContextLog, read_context
from tbm_gsa.history.recorded_context import recorded_contexts
from tbm_msgs_py import BagWriter
from tbm_msgs_py.bags.definitions import typestore
from tbm_msgs_py.base.errors import InputError

SECOND = 1_000_000_000
SOURCE = WindowSource("live", "/tbm/analysis_node", "", "dz101", "ab" * 32)
NIGHT = Context(412, 1234.5, "III", "night")
ALARM = Event(10 * SECOND, "sensor", "shield", "warning", "sensor", "gain at shield x", context=NIGHT)
ROCK = Event(20 * SECOND, "rock", "", "info", "rock", "lateral 1.5", level="6.7 r/min")


def entry(second, point="shield"):
    return HistoryEntry(point, "x", second * SECOND, SECOND, 1.0, 1.0, 0.0, 1.0)


def said(context):
    return lambda _: context


@pytest.fixture
def history(tmp_path):
    with History(tmp_path / "h.sqlite") as opened:
        yield opened


def test_an_event_is_stored_once_and_ends(history):
    first = history.store_event(SOURCE, ALARM)
    second = history.store_event(SOURCE, ROCK)
    seen = history.acknowledge([first.number], "Anna", "cable", 99 * SECOND)
    ended = history.store_event(SOURCE, replace(ALARM, end_ns=15 * SECOND, snapshot="/a/b", verdict="machine"))
    assert (ended.number, ended.acknowledged_by, ended.event.snapshot) == (first.number, "Anna", "/a/b")
    assert seen[0].event == first.event == ALARM
    assert history.events() == [ended, second]
    assert history.events(newest=1) == [second]
    for selection, numbers in (
        (EventSelection(standing=True), [2]),
        (EventSelection(open=True), [2]),
        (EventSelection(kind="sensor", point="shield", machine="dz101"), [1]),
        (EventSelection(since_ns=16 * SECOND), [2]),
        (EventSelection(since_ns=15 * SECOND, until_ns=20 * SECOND), [1]),
        (EventSelection(machine="south"), []),
        (EventSelection(source="live", node=SOURCE.name, machine="abababab"), [1, 2]),
        (EventSelection(source="replay"), []),
    ):
        assert [one.number for one in history.events(selection)] == numbers


def test_events_are_acknowledged_all_or_none(history):
    for event in (ALARM, ROCK):
        history.store_event(SOURCE, event)
    for numbers, by, problem in (
        ([1, 3], "Anna", r"no event 3, there: 1 to 2$"),
        ([1], " ", r"name ' ', allowed: 1 to 1000 printable characters$"),
        ([1], "a\nb", "printable"),
    ):
        with pytest.raises(HistoryError, match=problem):
            history.acknowledge(numbers, by, "", 0)
    assert len(history.events(EventSelection(open=True))) == 2
    history.acknowledge([1], "Anna", "", 0)
    with pytest.raises(HistoryError, match=r"event 1: acknowledged by Anna already, allowed: .* --replace$"):
        history.acknowledge([2, 1], "Bert", "", 0)
    assert [one.acknowledged_by for one in history.acknowledge([2, 1], "Bert", "", 0, replace=True)] == ["Bert"] * 2


def test_a_window_carries_the_context_of_its_begin(history):
    history.add(SOURCE, [entry(0), entry(1)])
    history.add(SOURCE, [entry(2), entry(3)], said(NIGHT))
    history.add(SOURCE, [entry(2, "girder"), entry(3, "girder")], said(NIGHT))
    history.add(SOURCE, [entry(4), entry(5)], said(replace(NIGHT, ring=9, rock_class="IV")))
    history.add(replace(SOURCE, kind="replay"), [entry(5)])
    found = {(one.source.kind, one.entry.point, one.entry.start_ns // SECOND): one.context for one in history.windows()}
    assert [found["live", "shield", second].ring for second in range(6)] == [None, None, 412, 412, 9, 9]
    assert found["live", "girder", 3] == NIGHT
    assert found["replay", "shield", 5] == Context()
    shield = Selection(point="shield", source="live")
    for by, expected in (
        ("rock_class", [("", 2), ("III", 2), ("IV", 2)]),
        ("ring", [("", 2), ("9", 2), ("412", 2)]),  # as numbers
        ("shift", [("", 2), ("night", 4)]),
    ):
        groups = list(history.groups(("point", "axis"), shield, by))
        assert [(group.key[-1], len(group.start_ns)) for group in groups] == expected
    history.discard(SOURCE.name, 0, 3 * SECOND, 100)
    assert [one.context.ring for one in history.all_windows(shield)] == [412, 9, 9]
    kept = sqlite3.connect(history.path).execute("SELECT since_ns FROM contexts").fetchall()
    assert kept == [(2 * SECOND,), (4 * SECOND,)]


def test_a_file_of_the_version_before_gets_events(tmp_path):
    old = tmp_path / "old.sqlite"
    connection = sqlite3.connect(old)
    connection.executescript(Path(__file__).with_name("history_5.sql").read_text())
    connection.close()
    with History(old) as opened, History(tmp_path / "new.sqlite") as new:
        assert opened.windows()[0].context == Context()
        opened.store_event(SOURCE, ALARM)
        paths = (opened.path, new.path)
        for table in ("contexts", "events"):
            found = [sqlite3.connect(path).execute(f"PRAGMA table_info({table})").fetchall() for path in paths]
            assert found[0] == found[1]


@pytest.mark.parametrize(
    "change",
    [
        "events SET event = 'moon'",
        "events SET end_ns = 'never'",
        "events SET ring = 'one'",
        "contexts SET chainage = 'far'",
        "contexts SET shift = x'07'",
    ],
)
def test_events_and_contexts_of_others_are_refused(history, change):
    history.store_event(SOURCE, ALARM)
    history.add(SOURCE, [entry(0)], said(NIGHT))
    with sqlite3.connect(history.path) as connection:
        connection.execute(f"UPDATE {change}")
    with pytest.raises(HistoryError, match=r"(an event|a context) that is not one of tbm_monitor"):
        _ = history.events(), history.windows()


def test_the_command_lists_and_acknowledges(history, typed):
    for event in (ALARM, ROCK):
        history.store_event(SOURCE, event)
    where = ("--history", str(history.path))
    code, out, _ = typed("events", *where, "--json")
    (alarm, rock) = json.loads(out)["events"]
    assert (code, alarm["begin"], alarm["end"], alarm["ring"]) == (0, "1970-01-01T00:00:10.000Z", None, 412)
    assert (rock["id"], rock["severity"], rock["verdict"], rock["level"]) == (2, "info", "rock", "6.7 r/min")
    assert typed("events", "ack", "2", "--by", "Anna", "--comment", "sandstone", *where)[0] == 0
    out = typed("events", *where)[1]
    assert "2: lateral 1.5; seen by Anna: sandstone" in out
    assert typed("events", "--open", *where)[1].count("shield") == 2
    for line, problem in (
        (("events", "ack", "7", "--by", "Anna", *where), "no event 7, there: 1 to 2"),
        (("events", *where, "ack", "1", "--by", "Anna"), "allowed: options behind the command"),
        (("events", "--kind", "moon", *where), "'machine', 'sensor', 'rock'"),
    ):
        code, _, error = typed(*line)
        assert (code, problem in error, error.count("\n")) == (2, True, 1)


def test_trends_are_told_apart_by_what_the_site_says(history, typed):
    for second, rock in enumerate(("III", "III", "IV", None)):
        history.add(SOURCE, [replace(entry(second), relative_error=0.1 * second)], said(Context(rock_class=rock)))
    where = ("--history", str(history.path))
    code, out, _ = typed("history", *where, "--by", "rock_class", "--json")
    found = json.loads(out)
    assert (code, found["by"]) == (0, "rock_class")
    trends = {one["group"]: (one["windows"], one["error_mean"]) for one in found["summary"]}
    assert trends == {"": (1, pytest.approx(0.3)), "III": (2, pytest.approx(0.05)), "IV": (1, pytest.approx(0.2))}
    assert [one["rock_class"] for one in found["windows"]] == ["III", "III", "IV", None]
    assert "rock_class" in typed("history", *where, "--by", "rock_class")[1]
    assert [one["group"] for one in json.loads(typed("history", *where, "--json")[1])["summary"]] == [None]
    code, _, error = typed("history", *where, "--by", "moon")
    assert (code, "'ring', 'chainage', 'rock_class', 'shift'" in error) == (2, True)


@given(
    st.lists(
        st.tuples(st.sampled_from(["ring", "chainage", "rock_class", "shift", "x"]), st.text(max_size=9)), max_size=5
    )
)
@settings(max_examples=60, deadline=None)
def test_any_texts_are_a_context_or_one_line(pairs):
    try:
        found = read_context(pairs)
    except InputError as error:
        assert "allowed: " in str(error) and str(error).isprintable()
        return
    with sqlite3.connect(":memory:") as connection:  # what the history can hold
        row = connection.execute("SELECT ?, ?, ?, ?", (found.ring, found.chainage, found.rock_class, found.shift))
        assert row.fetchone() == (found.ring, found.chainage, found.rock_class, found.shift)


def test_a_context_holds_from_its_stamp_on():
    log = ContextLog()
    one, two, three = (Context(ring=ring) for ring in (1, 2, 3))
    assert log.add(10 * SECOND, one, 20 * SECOND) == log.add(12 * SECOND, two, 20 * SECOND) == ""
    assert [log.at(second * SECOND) for second in (9, 10, 12, 99)] == [Context(), one, two, two]
    assert log.add(0, three, 20 * SECOND) == "the stamp is 0: it holds from now on"
    assert log.add(90 * SECOND, three, 20 * SECOND) == "the stamp is 70.000 s ahead: it holds from now on"
    assert [log.at(second * SECOND) for second in (19, 20)] == [two, three]
    assert log.add(11 * SECOND, three, 11 * SECOND) == ""  # a recording begins anew
    assert [log.at(second * SECOND) for second in (10, 12)] == [one, three]


def test_the_context_of_a_recording_is_found(tmp_path):
    """Messages that rosbags serialises, among them one that is no context and one without a stamp."""
    store = typestore()  # of rosbags
    types = store.types

    def diagnostics(second, **values):
        stamp = types["builtin_interfaces/msg/Time"](second, 0)
        pairs = [types["diagnostic_msgs/msg/KeyValue"](key, value) for key, value in values.items()]
        status = types["diagnostic_msgs/msg/DiagnosticStatus"](0, "site", "", "", pairs)
        header = types["std_msgs/msg/Header"](stamp, "")
        made = types["diagnostic_msgs/msg/DiagnosticArray"](header, [status])
        return bytes(store.serialize_cdr(made, "diagnostic_msgs/msg/DiagnosticArray"))

    with BagWriter(tmp_path / "bag") as writer:
        for log, content in (
            (100, diagnostics(90, ring="7", shift="day")),
            (110, diagnostics(110, ring="seven")),
            (120, diagnostics(0, ring="8")),
        ):
            writer.write("/tbm/context", "diagnostic_msgs/msg/DiagnosticArray", log * SECOND, content)
    log, problem = recorded_contexts(tmp_path / "bag")
    assert [log.at(second * SECOND) for second in (89, 90, 119, 120)] == [
        Context(),
        *[Context(ring=7, shift="day")] * 2,
        Context(ring=8),
    ]
    assert problem == "context: ring 'seven', allowed: a whole number, and 1 more"
    with BagWriter(tmp_path / "none") as writer:
        writer.write("/tbm/a", "diagnostic_msgs/msg/DiagnosticArray", SECOND, content)
    log, problem = recorded_contexts(tmp_path / "none")
    assert (log.at(9 * SECOND), problem) == (Context(), "")
