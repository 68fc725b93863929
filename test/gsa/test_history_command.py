"""`tbm-monitor history` and the windows that `compare` puts there."""

import json
import re
import sys
from dataclasses import fields, replace
from datetime import UTC, datetime
from importlib import resources
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from compare_bags import START_NS, noise, write_bag
from matplotlib.image import imread
from report_pages import check_page, check_widths

from tbm_dynamics import load_machine
from tbm_gsa.app.cli.main import main
from tbm_gsa.app.report.history_figures import by_trend, trends
from tbm_gsa.app.report.quantiles import quantiles
from tbm_gsa.comparison import AlarmRule, UsualRatio, WindowResult
from tbm_gsa.history import Baseline, Context, Event, History, HistoryEntry, StoredEvent, WindowSource, spread
from tbm_gsa.history.baseline import ErrorStatistics
from tbm_gsa.history.spread import TrendGroup
from tbm_gsa.provenance import machine_sha256
from tbm_msgs_py import OperatingPoint


@pytest.fixture
def run(monkeypatch, capsys):
    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["tbm-monitor", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            main()
        caught = capsys.readouterr()
        return left.value.code, caught.out, caught.err

    return call


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "h.sqlite"
    source = WindowSource("live", "/tbm/<b>node", "", "dz101", "ab")
    with History(path) as history:
        for n in range(30):
            rows = [
                HistoryEntry(
                    point, axis, START_NS + n * 2_000_000_000, 2_000_000_000, 1.0 + 0.01 * n, 1.2, 0.2 + 0.01 * n, 1.0
                )
                for point in ("shield", "<i>$x_{")
                for axis in "xyz"
            ]
            history.add(source, rows, lambda _: Context(shift="<b>night"))
    return path


@pytest.mark.parametrize("there", ["history", "link", "device", "text"])
@pytest.mark.parametrize("command", ["history --html", "history --png", "machine show --out", "compare --html"])
def test_a_result_replaces_only_its_kind(run, file, tmp_path, command, there):
    """One rule for all that write a page or a picture: another file, or what a link leads to, stays as it is."""
    suffix = ".html" if command.endswith("html") else ".png"
    target, other = tmp_path / f"result{suffix}", tmp_path / "other"
    other.write_text("theirs")
    kinds = {
        "history": lambda: target.write_bytes(file.read_bytes()),
        "link": lambda: target.symlink_to(other),
        "device": lambda: target.symlink_to("/dev/null"),
        "text": lambda: target.write_text("theirs"),
    }
    kinds[there]()
    before = target.read_bytes()
    words = command.split()
    first = {"history": ["history", "--history", file], "machine": ["machine", "show", "open380"]}
    start = first.get(words[0]) or ["compare", write_bag(tmp_path / "bag", {"shield": noise(6.0)})]
    code, out, err = run(*start, words[-1], target)
    assert (code, out) == (2, "")
    assert "exists already" in err
    assert len(err.splitlines()) == 1
    assert target.read_bytes() == before
    target.unlink()
    if words[0] != "compare" and there == "text":  # nothing of the others is left
        assert [run(*start, words[-1], target)[0] for _ in range(2)] == [0, 0]  # an earlier one of ours goes


def test_a_compare_that_fails_leaves_no_history(run, tmp_path):
    bag = write_bag(tmp_path / "bag", {"shield": noise(6.0)})
    before = sorted(tmp_path.rglob("*"))
    command = ("compare", bag, "--history", tmp_path / "new" / "h.sqlite")
    for wrong in (["--machine", "nowhere"], ["--mapping", tmp_path / "no.yaml"], ["--window", "0"]):
        assert run(*command, *wrong)[0] == 2
        assert sorted(tmp_path.rglob("*")) == before


def test_compare_puts_its_windows_into_the_history(run, tmp_path):
    bag = write_bag(tmp_path / "bag", {"shield": noise(6.0)})
    history = tmp_path / "h.sqlite"
    for _ in range(2):  # the same recording again is no more windows
        code, out, err = run("compare", bag, "--model-duration", 2, "--history", history, "--json")
        assert (code, err) == (0, "")
    document = json.loads(out)
    listed = json.loads(run("history", "--history", history, "--json")[1])
    assert listed["total"] == 9
    windows = [window for window in listed["windows"] if window["axis"] == "y"]
    assert [window["relative_error"] for window in windows] == document["points"]["shield"]["y"]["windows"][
        "relative_error"
    ]
    assert [window["start_ns"] - START_NS for window in windows] == [0, 2_000_000_000, 4_000_000_000]
    assert windows[0]["start"] == datetime.fromtimestamp(START_NS // 10**9, UTC).isoformat().replace("+00:00", ".000Z")
    assert windows[0]["name"] == str(bag)
    for name in ("field_peak", "field_crest_factor", "field_kurtosis"):
        compared = document["points"]["shield"]["y"]["windows"][name]
        assert [window[name] for window in windows] == pytest.approx(compared)
    assert run("compare", bag, "--model-duration", 2, "--no-keep", "--history", tmp_path / "no.sqlite")[0] == 0
    assert not (tmp_path / "no.sqlite").exists()


def test_a_synthetic_recording_is_kept_out_unless_asked_for(run, tmp_path):
    bag = write_bag(tmp_path / "bag", {"shield": noise(10.0)}, custom_data={"synthetic": "true"})
    history = tmp_path / "h.sqlite"
    compared = ("compare", bag, "--model-duration", 2, "--history", history)
    code, out, err = run(*compared)
    assert (code, "(synthetic)" in out) == (0, True)
    assert err == "not put into the history: the recording is synthetic, --keep puts it there\n"
    assert run(*compared, "--no-keep")[::2] == (0, "")
    assert not history.exists()
    assert run(*compared, "--keep")[::2] == (0, "")
    document = json.loads(run("history", "--history", history, "--json")[1])
    assert {window["source"] for window in document["windows"]} == {"synthetic"}
    assert {row["source"] for row in document["summary"]} == {"synthetic"}
    code, out, _ = run("history", "baseline", "set", "one", "--history", history, "--json")
    assert (code, json.loads(out)["source"]) == (0, "synthetic")


def test_a_baseline_over_a_mixture_is_refused_unless_it_is_named(run, file):
    mixed = [
        WindowSource("replay", "/tbm/<b>node", "", "dz101", "ab"),
        WindowSource("live", "/tbm/<b>node", "", "south", "cd"),
    ]
    for place, source in enumerate(mixed):
        with History(file) as history:
            rows = [HistoryEntry("shield", "x", START_NS + n, 1, 1.0, 1.0, 0.5 + 0.1 * place, 1.0) for n in range(6)]
            history.add(source, rows)
    command = ("history", "baseline", "set", "one", "--history", file, "--json")
    code, out, err = run(*command)
    assert (code, out, len(err.strip().splitlines())) == (2, "", 1)
    assert "windows of several machines: dz101 ab, south cd; choose by --machine" in err
    code, out, err = run(*command, "--machine", "dz101")
    assert (code, out, len(err.strip().splitlines())) == (2, "", 1)
    assert "windows of several kinds: live, replay; choose by --source" in err
    found = json.loads(run(*command, "--machine", "dz101", "--source", "replay")[1])
    assert (found["machine"], found["source"]) == ("dz101", "replay")
    assert found["points"]["shield"]["x"]["mean"] == pytest.approx(0.5)


def test_a_recorded_standstill_enters_the_history_error_free(run, tmp_path):
    driven, still = OperatingPoint(0.5, 3e6, 1e7), OperatingPoint(0.0, 0.0, 0.0)
    operating = [(at, driven if at < 20 else still) for at in range(28)]
    bag = write_bag(tmp_path / "bag", {"shield": noise(28.0)}, operating=operating)
    history = tmp_path / "h.sqlite"
    code, _, err = run("compare", bag, "--model-duration", 2, "--history", history, "--json")
    assert code == 0, err
    document = json.loads(run("history", "--history", history, "--json")[1])
    windows = [window for window in document["windows"] if window["axis"] == "x"]
    assert [window["relative_error"] is None for window in windows] == [False] * 10 + [True] * 4
    assert [window["model_rms"] is None for window in windows] == [False] * 10 + [True] * 4
    assert all(window["field_kurtosis"] == pytest.approx(3.0, abs=0.5) for window in windows)
    row = next(row for row in document["summary"] if row["axis"] == "x")
    assert (row["windows"], row["error_latest"]) == (14, windows[9]["relative_error"])


def test_a_history_that_cannot_be_used(run, tmp_path, monkeypatch):
    bag, wrong = write_bag(tmp_path / "bag", {"shield": noise(3.0)}), tmp_path / "wrong.sqlite"
    wrong.write_text("text " * 500)
    code, out, err = run("compare", bag, "--model-duration", 2, "--history", wrong, "--json")
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert "not a history of tbm_monitor" in err
    monkeypatch.setenv("TBM_HISTORY", str(wrong))  # the default one spoils no comparison
    code, out, err = run("compare", bag, "--model-duration", 2, "--json")
    assert code == 0
    assert json.loads(out)["points"]
    assert "not put into the history" in err


def test_list_filters_and_summary(run, file):
    code, out, err = run("history", "--history", file, "--json")
    document = json.loads(out)
    assert (code, err, document["total"], len(document["windows"])) == (0, "", 180, 180)
    row = next(one for one in document["summary"] if (one["point"], one["axis"]) == ("shield", "x"))
    assert (row["windows"], row["error_mean"], row["error_latest"]) == (30, pytest.approx(0.345), pytest.approx(0.49))
    since = datetime.fromtimestamp(START_NS // 10**9 + 40, UTC).isoformat()
    chosen = json.loads(run("history", "--history", file, "--point", "shield", "--since", since, "--json")[1])
    assert chosen["total"] == 30
    assert json.loads(run("history", "--history", file, "--until", since[:19], "--json")[1])["total"] == 120
    assert json.loads(run("history", "--history", file, "--since", "1h", "--json")[1])["total"] == 0
    assert json.loads(run("history", "--history", file, "--source", "offline", "--json")[1])["total"] == 0
    limited = json.loads(run("history", "--history", file, "--limit", 6, "--json")[1])
    assert (limited["total"], len(limited["windows"])) == (180, 6)
    assert limited["windows"][-1]["start_ns"] == START_NS + 29 * 2_000_000_000
    code, out, _ = run("history", "--history", file)
    assert code == 0
    assert "34% ± 9%" in out
    assert "2023-11-14" in out


def test_a_baseline_and_pictures(run, file, tmp_path):
    code, out, _ = run("history", "baseline", "set", "spring", "--history", file, "--json")
    assert code == 0
    assert json.loads(out)["points"]["shield"]["x"]["mean"] == pytest.approx(0.345)
    assert json.loads(run("history", "--history", file, "--json")[1])["baselines"][0]["name"] == "spring"
    page, picture = tmp_path / "h.html", tmp_path / "h.png"
    code, _, err = run("history", "--history", file, "--by", "shift", "--html", page, "--png", picture)
    assert code == 0, err
    text = page.read_text("utf-8")
    assert "Baseline spring" in text
    shown = check_page(text, drawn=0)  # another machine file than the shipped one
    assert not {"i", "b"} & set(shown.tags)
    assert shown.tags.count("svg") == 2
    assert "&lt;b&gt;night" in text
    check_widths(text)
    assert imread(picture).shape[1] == 1200
    assert "spring" in run("history", "--history", file)[1]


@pytest.mark.parametrize("typed", [["commissioning"], ["--history", "{file}"], ["spring", "--history", "{file}"]])
def test_the_old_form_stores_nothing_and_names_the_new_one(run, file, typed):
    code, out, err = run("history", "baseline", *(word.replace("{file}", str(file)) for word in typed))
    assert (code, out, len(err.strip().splitlines())) == (2, "", 1)
    assert "allowed: list, show, set, delete; `history baseline set NAME` stores a baseline" in err
    assert json.loads(run("history", "baseline", "list", "--history", file, "--json")[1])["baselines"] == []


def test_no_baseline_is_overwritten_unless_that_is_asked_for(run, file):
    def mean(*arguments):
        return json.loads(run("history", "baseline", *arguments, "--history", file, "--json")[1])["points"]["shield"][
            "x"
        ]["mean"]

    until = datetime.fromtimestamp(START_NS // 10**9 + 20, UTC).isoformat()
    assert mean("set", "spring") == pytest.approx(0.345)
    code, out, err = run("history", "baseline", "set", "spring", "--until", until, "--history", file)
    assert (code, out) == (2, "")
    assert "baseline spring: there is one of dz101 already, allowed: another name, or --replace" in err
    assert mean("show", "spring") == pytest.approx(0.345)
    assert mean("set", "spring", "--until", until, "--replace") == pytest.approx(0.245)
    assert mean("show", "spring") == pytest.approx(0.245)


def test_baselines_are_listed_and_deleted_by_name(run, file):
    for name in ("spring", "list"):
        assert run("history", "baseline", "set", name, "--history", file)[0] == 0
    document = json.loads(run("history", "baseline", "list", "--history", file, "--json")[1])
    assert document["path"] == str(file)
    assert [one["name"] for one in document["baselines"]] == ["spring", "list"]
    shown = run("history", "baseline", "list", "--history", file)[1]
    assert "2 baselines" in shown
    assert "spring" in shown
    code, out, _ = run("history", "baseline", "delete", "list", "--history", file)
    assert (code, "baseline list of live dz101" in out) == (0, True)
    assert "1 baseline\n" in run("history", "baseline", "list", "--history", file)[1]
    assert "no baseline list, there: spring" in run("history", "baseline", "show", "list", "--history", file)[2]
    assert json.loads(run("history", "--history", file, "--json")[1])["total"] == 180


def test_a_long_history_is_drawn_of_moments_and_says_so(run, file, tmp_path, monkeypatch):
    code, out, _ = run("history", "--history", file, "--html", tmp_path / "h.html")
    assert (code, "180 entries" in out) == (0, True)
    whole = (tmp_path / "h.html").read_text("utf-8")
    monkeypatch.setattr(spread, "MOST_OF_PART", 5)  # of six windows at a time
    monkeypatch.setattr(spread, "PARTS", 10)
    monkeypatch.setattr(spread, "MOMENTS", 1)
    code, out, _ = run("history", "--history", file, "--html", tmp_path / "h.html")
    said = "60 windows read: of 10 of 10 parts of the time, which have more than 5 windows each, those of 1 moments"
    assert (code, said in " ".join(out.split())) == (0, True)
    page = (tmp_path / "h.html").read_text("utf-8")
    assert (said in page, "windows read" in whole) == (True, False)


def test_quantiles_are_those_of_numpy():
    rng = np.random.default_rng(3)
    edges = np.linspace(0.0, 10.0, 6)
    time, values = np.sort(rng.uniform(0.0, 10.0, 200)), rng.normal(size=200)
    time[(time > 4.0) & (time < 6.0)] += 2.0  # a part without any
    time = np.sort(time)
    values[::9] = np.nan
    found = quantiles(time, values, edges)
    parts = [np.isfinite(values) & (time >= low) & (time < high) for low, high in pairwise(edges)]
    parts = [part for part in parts if part.any()]
    np.testing.assert_allclose(found.values.T, [np.quantile(values[part], (0.05, 0.5, 0.95)) for part in parts])
    np.testing.assert_allclose(found.time, [time[part].mean() for part in parts])


def trend_of(*entries, kind="live", machine="dz101"):
    """The only trend of windows of one point."""
    names = [field.name for field in fields(TrendGroup) if field.name != "key"]
    values = [{name: np.array([getattr(one, name)]) for name in names} for one in entries]
    (found,) = by_trend(
        TrendGroup((one.point, one.axis, machine, kind), **columns)
        for one, columns in zip(entries, values, strict=True)
    )
    return found


def drawn(*entries, usual=None, events=()):
    begins = [one.start_ns for one in entries]
    edges = np.linspace(min(begins), max(begins) + 1, 301)
    return trends(trend_of(*entries), "shield", edges, usual or {}, events).axes


def test_crest_factor_and_kurtosis_are_drawn_where_known():
    plain = [HistoryEntry("shield", axis, START_NS, 2_000_000_000, 2.0, 1.2, 0.2, 1.0) for axis in "xy"]
    assert len(drawn(*plain)) == 4
    known = [*plain, replace(plain[0], start_ns=START_NS + 2_000_000_000, field_peak=9.0, field_kurtosis=3.5)]
    panels = drawn(*known)
    assert len(panels) == 6
    assert {line.get_label(): line.get_ydata().tolist() for line in panels[2].lines} == {
        "crest factor": [4.5],
        "kurtosis": [3.5],
    }


def test_the_limits_are_those_of_the_rule_and_events_are_marked():
    one = HistoryEntry("shield", "x", START_NS, 2_000_000_000, 2.0, 1.0, 1.0, 1.0)
    usual = ErrorStatistics(0.3, 0.1, 9, log_mean=0.5, log_scatter=0.2)
    source = WindowSource("live", "node", "", "dz101", "ab")
    event = StoredEvent(1, source, Event(START_NS, "level", "shield", "error", "", "too loud"))
    for statistics, mean, scatter in ((usual, 0.5, 0.2), (None, np.nan, 0.0)):
        panel = drawn(one, usual={"x": statistics} if statistics else {}, events=[event])[1]
        low, high = (line.get_ydata()[0] for line in panel.lines[1:3])
        assert [one.get_label() for one in panel.collections[1:]] == ["event, error"]
        for ratio, counts in ((low * 1.001, False), (low * 0.999, True), (high * 0.999, False), (high * 1.001, True)):
            rule = AlarmRule(windows=1, baseline={"shield": UsualRatio(np.full(3, mean), np.full(3, scatter))})
            three = np.ones(3)
            window = WindowResult("shield", 0, 1, three, ratio * three, three, 1.0, 1.0, three, three)
            assert rule.update(window) is counts


def test_windows_of_other_kinds_and_machines_are_not_one_line(run, tmp_path):
    one = HistoryEntry("shield", "x", START_NS, 2_000_000_000, 2.0, 1.2, 0.2, 1.0)
    shipped = machine_sha256(load_machine("dz101"))
    here, south = (WindowSource("live", "node", "", *named) for named in (("dz101", shipped), ("south", "cd")))
    with History(tmp_path / "h.sqlite") as history:
        for source in (here, south, replace(here, kind="replay")):
            history.add(source, [one, replace(one, point="cutterhead"), replace(one, start_ns=START_NS + 60 * 10**9)])
        usual = {("shield", "x"): ErrorStatistics(0.2, 0.01, 9)}
        history.store_baseline(Baseline("spring", "south", "", 1, 0, 1, usual, "live"))
        history.store_event(here, Event(START_NS, "level", "shield", "error", "", "<b>too loud"))
    assert run("history", "--history", tmp_path / "h.sqlite", "--html", tmp_path / "h.html")[0] == 0
    page = (tmp_path / "h.html").read_text("utf-8")
    parts = re.split("<h2>", page)[1:7]
    assert [part.partition("</h2>")[0] for part in parts] == [
        *("cutterhead, live, dz101", "shield, live, dz101"),  # along the power flow
        *("cutterhead, replay, dz101", "shield, replay, dz101"),
        *("cutterhead, live, south", "shield, live, south"),
    ]
    assert ["baseline spring" in part for part in parts] == [False] * 4 + [True] * 2
    assert "Not drawn: no machine file of this name and content is at hand." in page
    assert ["Upright: events." in part for part in parts] == [False, True, *[False] * 4]
    assert "&lt;b&gt;too loud" in page
    check_page(page, machines=2, drawn=1)
    assert page.count("<title>Side view and drives of machine dz101") == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--history", "nowhere.sqlite"], "nowhere.sqlite: no such history"),
        (["--history", "{file}", "--since", "soon"], "--since soon: allowed: ISO 8601"),
        (["--history", "{file}", "--since", "2026-02-01", "--until", "2026-01-01"], "allowed: a time before another"),
        (["--history", "{file}", "--until", "2026-13-01"], "--until 2026-13-01: allowed"),
        (["--history", "{file}", "--until", "2001-01-01", "--html", "h.html"], "no windows to plot"),
        (["--history", "{file}", "--point", "none"], "{file}: no test point none, there: <i>$x_{, shield\n"),
        (["--history", "{file}", "--machine", "dz102"], "{file}: no machine dz102, there: dz101 ab\n"),
        (
            ["--history", "{file}", "--source", "north"],
            "no source north, there: live, replay, offline, synthetic, /",
        ),
        (["--history", "{file}", "--html", "no/such/h.html"], "no folder no/such"),
        (["baseline", "set", "one", "--history", "{file}", "--point", "none"], "no test point none, there"),
        (["baseline", "set", "one", "--history", "{file}", "--until", "2001-01-01"], "0 windows with a known error"),
        (["baseline", "set", " ", "--history", "{file}"], "baseline ' ': allowed: a name"),
        (["baseline", "set", "one", "--history", "nowhere.sqlite"], "no such history"),
        (["baseline", "list", "--history", "nowhere.sqlite"], "no such history"),
        (["baseline", "show", "one", "--history", "{file}"], "no baseline one, there: none"),
        (["baseline", "delete", "one", "--history", "{file}"], "no baseline one, there: none"),
        (["baseline", "set", "--history", "{file}"], "Missing argument"),
        (["baseline", "show", "--history", "{file}"], "Missing argument"),
        (["baseline", "delete", "--history", "{file}"], "Missing argument"),
        (["--history", "{file}", "baseline", "list"], "history --history … baseline: allowed: options behind"),
    ],
)
def test_bad_input_is_one_line(run, file, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    code, out, err = run("history", *(argument.replace("{file}", str(file)) for argument in arguments))
    assert (code, out) == (2, "")
    assert said.replace("{file}", str(file)) in err
    assert len(err.strip().splitlines()) == 1
    assert not list(Path().glob("*.html"))


@pytest.mark.parametrize(
    ("chosen", "note"),
    [
        (
            ["--since", "2100-01-01", "--point", "shield"],
            "no window begins in that time: those of any time",
        ),
        (["--source", "offline"], "no window meets all that was asked for: those of the history"),
        (["--source", "live"], ""),
    ],
)
def test_a_selection_of_nothing_says_what_there_is(run, file, chosen, note):
    code, out, err = run("history", "--history", file, *chosen)
    document = json.loads(run("history", "--history", file, *chosen, "--json")[1])
    assert (code, err) == (0, "")
    assert document["note"] == (note and f"{note} begin from 2023-11-14T22:13:20.000Z to 2023-11-14T22:14:18.000Z")
    assert document["note"] in out


def test_a_long_list_of_known_names_is_cut(run, file):
    with History(file) as history:
        rows = [HistoryEntry(f"point {n:02}", "x", START_NS, 1, 1.0, 1.0, 0.5, 1.0) for n in range(98)]
        history.add(WindowSource("live", "node", "", "dz101", "ab"), rows)
    err = run("history", "--history", file, "--point", "none")[2]
    assert err.endswith("point 17, point 18 and 80 more\n")  # of 100, the first twenty by name


def test_a_machine_file_chooses_its_windows_and_baselines(run, file, tmp_path):
    shipped = (resources.files("tbm_dynamics") / "machines" / "open380.yaml").read_text("utf-8")
    (tmp_path / "mine.yaml").write_text(f"# mine\n{shipped}", "utf-8")
    digits = json.loads(run("machine", "check", "--machine", "open380", "--json")[1])["sha256"]
    with History(file) as history:
        rows = [HistoryEntry("shield", "x", START_NS + n, 1, 1.0, 1.0, 0.5, 1.0) for n in range(7)]
        history.add(WindowSource("live", "node", "", "open380", digits), rows)
    chosen = ("--history", file, "--machine", tmp_path / "mine.yaml", "--json")
    assert json.loads(run("history", *chosen)[1])["total"] == 7
    assert json.loads(run("history", "baseline", "set", "spring", *chosen)[1])["machine_sha256"] == digits
    assert json.loads(run("history", "baseline", "show", "spring", *chosen)[1])["machine"] == "open380"
