"""The history file: what goes in comes out, in any order and from several processes; wrong files are one line."""

import math
import multiprocessing
import sqlite3
from dataclasses import replace

import numpy as np
import pytest
from history_writers import LENGTH, START, entry, write
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tbm_gsa.comparison import AlarmRule, WindowResult
from tbm_gsa.comparison.results import AxisResult, ComparisonResult, DwellResult, LevelAxis, LevelResult, WindowColumns
from tbm_gsa.history import (
    BY_ORIGIN,
    SOURCE_KINDS,
    History,
    HistoryEntry,
    HistoryError,
    Selection,
    WindowSource,
    default_history,
    live_entries,
    make_baseline,
    recording_entries,
)
from tbm_gsa.history.schema import write_ahead
from tbm_gsa.history.summary import history_summary

LIVE = WindowSource("live", "/tbm/analysis_node", "", "dz101", "ab" * 32)
BAG = WindowSource("offline", "bags/field", "cd" * 32, "dz101", "ab" * 32)

numbers = st.floats(allow_nan=True, allow_infinity=True).map(lambda value: value + 0.0)  # one zero, as SQLite has
entries = st.builds(
    HistoryEntry,
    point=st.sampled_from(["shield", "gripper", "a'b\"; --"]),
    axis=st.sampled_from(["x", "y", "z", "yz"]),
    start_ns=st.integers(0, 2**62),
    length_ns=st.integers(1, 2**40),
    field_rms=numbers,
    model_rms=numbers,
    relative_error=numbers,
    coverage=st.floats(0.0, 1.0).map(abs),
    field_peak=numbers,
    field_kurtosis=numbers,
)


@pytest.fixture
def history(tmp_path):
    with History(tmp_path / "deep" / "h.sqlite") as opened:
        yield opened


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rows=st.lists(entries, max_size=6, unique_by=lambda e: (e.point, e.axis, e.start_ns, e.length_ns)))
def test_what_goes_in_comes_out(tmp_path_factory, rows):
    with History(tmp_path_factory.mktemp("h") / "h.sqlite") as opened:
        assert opened.add(LIVE, rows) == len(rows)
        found = opened.windows()
    assert {repr(window.entry) for window in found} == {repr(row) for row in rows}  # repr: NaN equals NaN
    assert [w.entry.start_ns for w in found] == sorted(row.start_ns for row in rows)
    assert all(window.source == LIVE for window in found)


def test_the_same_window_again_replaces_the_old_one(history):
    history.add(BAG, [entry(0), entry(1)])
    history.add(BAG, [entry(1, error=0.9), entry(2)])
    assert [window.entry.relative_error for window in history.windows()] == [0.2, 0.9, 0.2]
    history.add(LIVE, [entry(1)])
    assert history.count() == 4


def test_a_selection_chooses_by_every_option(history):
    history.add(LIVE, [entry(n, point) for n in range(4) for point in ("shield", "gripper")])
    history.add(BAG, [entry(n) for n in range(10, 12)])
    other = WindowSource("offline", "bags/100%_other", "", "open380", "")
    history.add(other, [entry(20)])

    def chosen(**values):
        return [(window.entry.start_ns - START) // LENGTH for window in history.windows(Selection(**values))]

    assert chosen(point="gripper") == [0, 1, 2, 3]
    assert chosen(source="live") == [0, 0, 1, 1, 2, 2, 3, 3]
    assert chosen(source="replay") == chosen(source="synthetic") == []
    assert chosen(source="offline") == [10, 11, 20]
    assert chosen(source="field") == [10, 11]
    assert chosen(source="100%_") == [20]
    assert chosen(machine="open380") == [20]
    assert chosen(machine="abababab", source="offline") == chosen(machine="ab" * 32, source="offline") == [10, 11]
    assert chosen(machine="abababa") == chosen(machine="abababac") == []
    assert chosen(since_ns=START + 3 * LENGTH, until_ns=START + 11 * LENGTH, point="shield") == [3, 10]
    assert chosen(point="nowhere") == []
    assert [w.entry.start_ns for w in history.windows(newest=2)] == [START + 11 * LENGTH, START + 20 * LENGTH]
    assert history.count(Selection(point="shield")) == 7


VERSION_1 = """
CREATE TABLE sources (
    id INTEGER PRIMARY KEY, kind TEXT NOT NULL CHECK (kind IN ('live', 'offline')), name TEXT NOT NULL,
    digest TEXT NOT NULL, machine TEXT NOT NULL, machine_sha256 TEXT NOT NULL,
    UNIQUE (kind, name, digest, machine, machine_sha256)
);
CREATE TABLE windows (
    source INTEGER NOT NULL REFERENCES sources (id), point TEXT NOT NULL, axis TEXT NOT NULL,
    start_ns INTEGER NOT NULL, length_ns INTEGER NOT NULL, field_rms REAL, model_rms REAL, relative_error REAL,
    coverage REAL NOT NULL, PRIMARY KEY (start_ns, source, point, axis, length_ns)
) WITHOUT ROWID;
CREATE TABLE baselines (
    name TEXT PRIMARY KEY, machine TEXT NOT NULL, machine_sha256 TEXT NOT NULL, created_ns INTEGER NOT NULL,
    since_ns INTEGER NOT NULL, until_ns INTEGER NOT NULL
) WITHOUT ROWID;
CREATE TABLE usual_errors (
    baseline TEXT NOT NULL REFERENCES baselines (name) ON DELETE CASCADE, point TEXT NOT NULL, axis TEXT NOT NULL,
    mean REAL NOT NULL, scatter REAL NOT NULL, windows INTEGER NOT NULL, PRIMARY KEY (baseline, point, axis)
) WITHOUT ROWID;
PRAGMA application_id = 0x54424D48;
PRAGMA user_version = 1;
PRAGMA journal_mode = WAL;
INSERT INTO baselines VALUES ('spring', 'dz101', '', 1, 0, 1);
INSERT INTO usual_errors VALUES ('spring', 'shield', 'x', 0.3, 0.01, 9);
"""


@pytest.fixture
def old(tmp_path):
    """A file as the first version wrote it: two windows at the shield, the second without a known error."""
    path = tmp_path / "old.sqlite"
    connection = sqlite3.connect(path)
    connection.executescript(VERSION_1)
    connection.execute("INSERT INTO sources VALUES (1, ?, ?, ?, ?, ?)", tuple(vars(LIVE).values()))
    for number, error in enumerate((0.2, None)):
        row = (1, "shield", "x", START + number * LENGTH, LENGTH, 1.0, 1.2, error, 1.0)
        connection.execute("INSERT INTO windows VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", row)
    connection.commit()
    connection.close()
    return path


def test_a_file_of_version_1_is_kept_and_goes_on(old):
    new = replace(entry(2), field_peak=4.0, field_kurtosis=3.5)
    with History(old) as opened:
        kept = [window.entry for window in opened.windows()]
        assert repr(kept) == repr([entry(0), entry(1, error=math.nan)])  # peak and kurtosis are NaN
        spring = opened.baseline("spring", "dz101")
        assert (spring.usual["shield", "x"].mean, spring.kind) == (0.3, None)
        assert opened.windows()[0].source == LIVE
        opened.add(LIVE, [new])
    connection = sqlite3.connect(old)
    assert connection.execute("PRAGMA user_version").fetchone() == (7,)
    written = connection.execute("SELECT field_peak, field_kurtosis FROM windows").fetchall()
    assert written == [(None, None), (None, None), (4.0, 3.5)]
    with History(old, create=False) as opened:
        assert opened.windows()[-1].entry == new
        assert opened.count() == 3


def test_a_migrated_file_has_the_columns_of_a_new_one(old, history):
    with History(old):
        pass
    with History(old) as opened:
        for kind in SOURCE_KINDS:
            opened.add(replace(LIVE, kind=kind), [entry(0)])
    assert sqlite3.connect(old).execute("PRAGMA foreign_key_check").fetchall() == []
    for table in ("sources", "windows", "baselines", "usual_errors"):
        for pragma in ("table_info", "foreign_key_list"):
            found = [
                sqlite3.connect(path).execute(f"PRAGMA {pragma}({table})").fetchall() for path in (old, history.path)
            ]
            assert found[0] == found[1]


def test_a_version_1_file_that_cannot_be_migrated_stays_as_it_is(old):
    connection = sqlite3.connect(old)
    connection.execute("ALTER TABLE windows ADD COLUMN field_kurtosis REAL")  # the second statement fails
    connection.close()
    with pytest.raises(HistoryError, match="duplicate column name: field_kurtosis") as caught:
        History(old)
    assert "\n" not in str(caught.value)
    connection = sqlite3.connect(old)
    assert connection.execute("PRAGMA user_version").fetchone() == (1,)
    assert "field_peak" not in [row[1] for row in connection.execute("PRAGMA table_info(windows)")]


@pytest.mark.parametrize("there", [False, True])
def test_processes_share_a_file_while_one_creates_or_migrates_it(tmp_path, old, there):
    path = old if there else tmp_path / "shared.sqlite"
    context = multiprocessing.get_context("forkserver")  # which loads once what all of them need
    context.set_forkserver_preload(["tbm_gsa.history"])
    writers = [context.Process(target=write, args=(path, number)) for number in range(3)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert [writer.exitcode for writer in writers] == [0, 0, 0]
    with History(path) as opened:
        assert opened.count() == 150 + 2 * there
    assert sqlite3.connect(path).execute("PRAGMA journal_mode").fetchone() == ("wal",)


def test_another_writer_is_waited_for_where_sqlite_does_not():
    class Busy:
        """A connection to a file that another program writes to, for three looks."""

        looks = 0

        def execute(self, _):
            self.looks += 1
            if self.looks <= 3:
                error = sqlite3.OperationalError("database is locked")
                error.sqlite_errorcode = sqlite3.SQLITE_BUSY
                raise error

    busy = Busy()
    write_ahead(busy, 60.0)
    assert busy.looks == 4
    with pytest.raises(sqlite3.OperationalError):
        write_ahead(Busy(), -1.0)


def test_a_reader_does_not_wait_for_a_writer(history):
    history.add(LIVE, [entry(0)])
    writer = sqlite3.connect(history.path, isolation_level=None)
    writer.execute("BEGIN IMMEDIATE")
    assert history.count() == 1
    writer.execute("ROLLBACK")


@pytest.mark.parametrize(
    "content", [b"no database at all, but text that is long enough to be one" * 20, b"\x00" * 4096]
)
def test_a_file_of_something_else_is_one_line_and_stays_as_it_is(tmp_path, content):
    path = tmp_path / "h.sqlite"
    path.write_bytes(content)
    with pytest.raises(HistoryError, match=r"h\.sqlite: not a history of tbm_monitor") as caught:
        History(path)
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == content


def test_another_database_a_damaged_one_and_a_newer_one(tmp_path, history):
    other = tmp_path / "other.sqlite"
    with sqlite3.connect(other) as connection:
        connection.execute("CREATE TABLE mine (a)")
    with pytest.raises(HistoryError, match="a database of something else"):
        History(other)
    history.add(LIVE, [entry(n) for n in range(500)])
    history._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    whole = bytearray(history.path.read_bytes())
    damaged = tmp_path / "damaged.sqlite"
    damaged.write_bytes(bytes(whole[:2000]))
    with pytest.raises(HistoryError, match="not a history of tbm_monitor"):
        History(damaged)
    newer = tmp_path / "newer.sqlite"
    newer.write_bytes(bytes(whole))
    with sqlite3.connect(newer) as connection:
        connection.execute("PRAGMA user_version = 99")
    with pytest.raises(HistoryError, match=r"schema version 99, allowed: 1 to 7$"):
        History(newer)


def test_a_place_that_cannot_be_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file" / "h.sqlite", tmp_path):
        with pytest.raises(HistoryError) as caught:
            History(path)
        assert str(path) in str(caught.value)
    with pytest.raises(HistoryError, match="no such history"):
        History(tmp_path / "nowhere.sqlite", create=False)
    assert not (tmp_path / "nowhere.sqlite").exists()


def test_where_the_history_is(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.delenv("TBM_HISTORY", raising=False)
    assert default_history() == tmp_path / "tbm_monitor" / "history.sqlite"
    monkeypatch.setenv("TBM_HISTORY", str(tmp_path / "mine.sqlite"))
    assert default_history() == tmp_path / "mine.sqlite"


def of_error(number, error, axis="x"):
    """Entry in which less was measured than computed, by this relative error."""
    return replace(entry(number, axis=axis, error=error), field_rms=1.2 / (1.0 + error))


def test_alarms_are_set_against_mean_and_scatter(history):
    errors = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    history.add(LIVE, [of_error(n, error) for n, error in enumerate(errors.tolist())])
    history.add(LIVE, [of_error(n, 0.6, "yz") for n in range(5)])
    history.add(LIVE, [entry(9, error=math.inf), entry(10, error=math.nan), entry(11, "girder")])
    history.store_baseline(make_baseline("first", history.groups(BY_ORIGIN), START))
    found = history.baseline("first", "dz101")
    assert (found.machine, found.since_ns, found.until_ns) == ("dz101", START, START + 12 * LENGTH)
    assert set(found.usual) == {("shield", "x"), ("shield", "yz")}  # one window of the girder is too few
    usual, logs = found.usual["shield", "x"], -np.log1p(errors)
    assert (usual.mean, usual.scatter, usual.windows) == (pytest.approx(0.3), pytest.approx(np.std(errors, ddof=1)), 5)
    assert (usual.log_mean, usual.log_scatter) == (pytest.approx(logs.mean()), pytest.approx(np.std(logs, ddof=1)))
    ready = found.usual_ratios()["shield"]
    np.testing.assert_allclose(ready.mean, [logs.mean(), -np.log(1.6), -np.log(1.6)])

    def result(error):
        level = np.ones(3)
        return WindowResult("shield", 0, LENGTH, level, level / (1.0 + error), error, 1.0, 1.0, level, level)

    rule, wide = AlarmRule(0.05, 1, found.usual_ratios()), np.exp(3.0 * np.std(logs, ddof=1) - logs.mean())
    assert not rule.update(result(np.array([0.99 * wide - 1.0, 0.6, 0.6])))
    assert rule.update(result(np.array([1.01 * wide - 1.0, 0.6, 0.6])))
    with pytest.raises(HistoryError, match="no baseline second, there: first"):
        history.baseline("second", "dz101")


def test_windows_of_a_dead_sensor_are_no_part_of_a_baseline(history):
    dead = [HistoryEntry("shield", "x", START + n * LENGTH, LENGTH, 1e-6, 1.2, 1.2e6, 1.0) for n in range(90, 94)]
    history.add(LIVE, [*(entry(n) for n in range(8)), *dead])
    usual = make_baseline("one", history.groups(BY_ORIGIN), START).usual["shield", "x"]
    assert (usual.mean, usual.windows) == (pytest.approx(0.2), 8)


def test_a_baseline_is_replaced_only_if_that_is_asked_for(history):
    history.add(LIVE, [entry(n, error=0.2) for n in range(5)])
    history.store_baseline(make_baseline("one", history.groups(BY_ORIGIN), START))
    history.add(LIVE, [entry(n, error=0.4) for n in range(5)])
    other = make_baseline("one", history.groups(BY_ORIGIN), START)
    with pytest.raises(HistoryError, match="baseline one: there is one of dz101 already, allowed: another name"):
        history.store_baseline(other)
    assert [one.usual["shield", "x"].mean for one in history.baselines()] == [pytest.approx(0.2)]
    history.store_baseline(other, replace=True)
    assert [one.usual["shield", "x"].mean for one in history.baselines()] == [pytest.approx(0.4)]


def test_a_deleted_baseline_leaves_nothing_behind(history):
    for machine in ("dz101", "south"):
        history.add(WindowSource("live", machine, "", machine, "ab"), [entry(n) for n in range(5)])
        history.store_baseline(make_baseline("one", history.groups(BY_ORIGIN, Selection(machine=machine)), START))
    with pytest.raises(HistoryError, match="baseline one: of several machines: dz101, south; choose by --machine"):
        history.delete_baseline("one")
    assert history.delete_baseline("one", "dz101").machine == "dz101"
    assert history.delete_baseline("one").machine == "south"
    for table in ("baselines", "usual_errors"):
        assert sqlite3.connect(history.path).execute(f"SELECT COUNT(*) FROM {table}").fetchone() == (0,)
    assert history.count() == 10


def test_each_machine_has_its_own_baseline_of_a_name(history):
    for number, machine in enumerate(("dz101", "south")):
        history.add(
            WindowSource("live", machine, "", machine, "ab"), [entry(n, error=0.2 + 0.2 * number) for n in range(5)]
        )
        history.store_baseline(make_baseline("one", history.groups(BY_ORIGIN, Selection(machine=machine)), START))
    means = {machine: history.baseline("one", machine).usual["shield", "x"].mean for machine in ("dz101", "south")}
    assert means == {"dz101": pytest.approx(0.2), "south": pytest.approx(0.4)}
    with pytest.raises(HistoryError, match="baseline one: of machine dz101, south, allowed: one of open380"):
        history.baseline("one", "open380")


def test_baselines_without_sense_are_refused(history):
    with pytest.raises(ValueError, match="0 windows with a known error at a point and axis, allowed: at least 5"):
        make_baseline("none", [], START)
    history.add(LIVE, [entry(n) for n in range(5)])
    history.add(WindowSource("live", "n", "", "dz101", "ef" * 32), [entry(n) for n in range(5)])
    with pytest.raises(ValueError, match="windows of several machines: dz101 abababab, dz101 efefefef; choose by"):
        make_baseline("two", history.groups(BY_ORIGIN), START)
    assert make_baseline("two", history.groups(BY_ORIGIN, Selection(machine="efefefef")), START).machine == "dz101"


def test_a_baseline_is_of_windows_of_one_kind(history):
    for place, kind in enumerate(SOURCE_KINDS):
        history.add(replace(LIVE, kind=kind), [entry(n, error=0.1 * place) for n in range(5)])
    with pytest.raises(ValueError, match="several kinds: live, offline, replay, synthetic; choose by --source"):
        make_baseline("one", history.groups(BY_ORIGIN), START)
    for place, kind in enumerate(SOURCE_KINDS):
        made = make_baseline(kind, history.groups(BY_ORIGIN, Selection(source=kind)), START)
        assert (made.kind, made.usual["shield", "x"].mean) == (kind, pytest.approx(0.1 * place))
        history.store_baseline(made)
        assert history.baseline(kind).kind == kind


def test_live_windows_give_an_entry_an_axis():
    three = np.array([1.0, 2.0, 2.0])
    peak, kurtosis = np.array([4.0, 6.0, 6.0]), np.array([3.0, 3.2, np.nan])
    result = WindowResult("shield", START, LENGTH, 2 * three, three, np.ones(3), 1.0, 0.75, peak, kurtosis)
    assert [(one.axis, one.field_rms, one.coverage, one.field_peak) for one in live_entries(result, False)] == [
        ("x", 1.0, 0.75, 4.0),
        ("y", 2.0, 0.75, 6.0),
        ("z", 2.0, 0.75, 6.0),
    ]
    turning = [(one.axis, one.field_crest_factor, one.field_kurtosis) for one in live_entries(result, True)]
    assert turning == [("x", 4.0, 3.0), ("yz", 3.0, 3.2)]
    unknown = np.full(3, np.nan)
    silent = WindowResult("shield", START, LENGTH, three, unknown, unknown, 1.0, 0.0, unknown, unknown)
    assert list(live_entries(silent, False)) == []


def test_windows_at_no_level_are_kept_empty_ones_are_not():
    windows = WindowColumns.model_construct(
        start=(0.0, 2.0, 4.0, 6.0, 8.0),
        level=(0, None, 0, 1, 2),
        field_rms=(1.0, 1.0, None, 0.0, 1.0),
        relative_error=(0.5, None, None, None, None),
        coverage=(1.0, 1.0, 0.0, 0.5, 1.0),
        field_peak=(4.0, 5.0, None, 0.0, 6.0),
        field_kurtosis=(3.0, 3.5, None, None, 4.0),
    )
    at_level = {"shield": {"x": LevelAxis.model_construct(model_rms=1.5)}}
    # The third level is too short for a spectrum at this point: nothing was compared there.
    levels = [LevelResult.model_construct(points=points) for points in (at_level, at_level, {})]
    points = {"shield": {"x": AxisResult.model_construct(windows=windows)}}
    result = ComparisonResult.model_construct(window_s=2.0, points=points, levels=levels, dwells=())
    first, moving, dead, short = recording_entries(result, {"shield": START})
    nan = math.nan
    assert first == HistoryEntry("shield", "x", START, LENGTH, 1.0, 1.5, 0.5, 1.0, 4.0, 3.0)
    assert repr(moving) == repr(HistoryEntry("shield", "x", START + LENGTH, LENGTH, 1.0, nan, nan, 1.0, 5.0, 3.5))
    assert (dead.start_ns, dead.relative_error, dead.coverage) == (START + 3 * LENGTH, math.inf, 0.5)
    assert np.isnan([dead.field_kurtosis, dead.field_crest_factor]).all()
    assert repr(short) == repr(HistoryEntry("shield", "x", START + 4 * LENGTH, LENGTH, 1.0, nan, nan, 1.0, 6.0, 4.0))
    outside = DwellResult(begin=0.0, end=2.0, kind="outside", level=None)
    stretch = result.model_copy(update={"dwells": (outside,)})
    kept = list(map(repr, recording_entries(stretch, {"shield": START})))
    assert kept == [repr(first), repr(dead), repr(short)]  # what is known of the others is not replaced


def test_windows_at_no_level_change_no_baseline_and_no_summary(history):
    """A standstill is quiet: its RMS must not lower the median that tells a dead sensor from one that lives, either."""
    sound = [entry(n, error=0.1 * n) for n in range(1, 7)]
    history.add(BAG, sound)
    usual = make_baseline("one", history.groups(BY_ORIGIN), START).usual
    (before,) = history_summary(history, Selection(), 0).summary
    still = [replace(entry(n, error=math.nan), field_rms=1e-3, model_rms=math.nan) for n in range(10, 40)]
    history.add(BAG, still)
    assert make_baseline("one", history.groups(BY_ORIGIN), START).usual == usual
    (after,) = history_summary(history, Selection(), 0).summary
    errors = ("error_mean", "error_scatter", "error_latest")
    assert [getattr(after, name) for name in errors] == [getattr(before, name) for name in errors]
    assert (before.windows, after.windows) == (6, 36)
