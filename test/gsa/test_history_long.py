"""A history of months: reading it needs little memory, and a node deletes what is too old without growing the file."""

import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from tbm_gsa.history import BY_ORIGIN, History, HistoryEntry, Selection, WindowSource, make_baseline
from tbm_gsa.history.summary import history_summary

START = 1_700_000_000_000_000_000
LENGTH = 2_000_000_000
LIVE = WindowSource("live", "/tbm/analysis_node", "", "dz101", "ab" * 32)
BAG = WindowSource("offline", "bags/field", "cd" * 32, "dz101", "ab" * 32)


def entry(number, point="shield", axis="x", error=0.2):
    return HistoryEntry(point, axis, START + number * LENGTH, LENGTH, 1.0, 1.2, error, 1.0)


@pytest.fixture
def history(tmp_path):
    with History(tmp_path / "h.sqlite") as opened:
        yield opened


def test_a_long_history_is_summarised_in_little_memory(history):
    """Some 40 bytes a window of one point and axis are held, not hundreds of every one."""
    strength = np.random.default_rng(0).lognormal(size=1500).tolist()
    axes = [(point, axis) for point in ("shield", "girder") for axis in "xyz"]
    history.add(
        LIVE, [entry(n, *axis, error=math.nan if n % 7 == 0 else e) for axis in axes for n, e in enumerate(strength)]
    )
    history.add(BAG, [replace(entry(n), field_rms=1e-6 if n % 5 == 0 else 1.0) for n in range(90)])
    tracemalloc.start()
    document = history_summary(history, Selection(), 5)
    peak = tracemalloc.get_traced_memory()[1]
    made = make_baseline("one", history.groups(BY_ORIGIN, Selection(source="live")), START)
    assert max(peak, tracemalloc.get_traced_memory()[1]) < 600_000
    tracemalloc.stop()
    windows = history.windows()
    for trend in document.summary:
        key = (trend.point, trend.axis, trend.machine, trend.source)
        of = [w for w in windows if (w.entry.point, w.entry.axis, w.source.machine, w.source.kind) == key]
        alive = [w.entry for w in of if w.entry.field_rms > 0.5]
        errors = [one.relative_error for one in alive if math.isfinite(one.relative_error)]
        assert trend.windows == len(of)
        assert (trend.error_mean, trend.error_latest) == (pytest.approx(np.mean(errors)), errors[-1])
        assert trend.error_scatter == pytest.approx(np.std(errors, ddof=1))
    assert document.total == len(windows) == 9090
    assert [one.start_ns for one in document.windows] == [one.entry.start_ns for one in windows[-5:]]
    assert made.usual["shield", "y"].windows == document.summary[5].windows - 215


def test_old_windows_are_deleted_in_portions_and_pages_reused(history):
    old = replace(LIVE, machine_sha256="ef" * 32)  # the same node before its machine file changed
    others = [BAG, replace(LIVE, name="/south/analysis_node")]
    for source in (LIVE, old, *others):
        history.add(source, [entry(n) for n in range(100)])
    end = START + 60 * LENGTH
    reached = [0]
    while reached[-1] < end:
        reached.append(history.discard(LIVE.name, reached[-1], end, 100))
    assert [(at - START) // LENGTH for at in reached[1:]] == [25, 50, 60]
    assert history.discard(LIVE.name, START, START + LENGTH, 1) == START + 1  # more at once than a portion
    left = [window.source for window in history.windows()]
    assert [left.count(source) for source in (LIVE, old, *others)] == [40, 40, 100, 100]

    def pages():
        return history._connection.execute("PRAGMA page_count").fetchone()[0]

    sizes = []
    for day in range(1, 5):
        history.add(LIVE, [entry(1000 * day + n) for n in range(1000)])
        history.discard(LIVE.name, 0, START + 1000 * day * LENGTH, 5000)
        sizes.append(pages())
    assert max(sizes[1:]) <= sizes[1] + 2
