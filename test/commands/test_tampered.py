"""What the program stored and somebody edited since: each command that reads it back ends with 0, or with one line."""

import json
import signal
import sqlite3
import sys
from contextlib import suppress
from functools import partial

import pytest
from tampered import REMOVED, WRONG, places, tampered

from tbm_dynamics import MachineError, load_machine
from tbm_gsa.app.cli.main import main
from tbm_gsa.comparison.results import ComparisonResult
from tbm_gsa.explanation import workflow
from tbm_gsa.explanation.result import read_explanation
from tbm_gsa.history import Context, Event, History, HistoryEntry, WindowSource
from tbm_gsa.provenance import machine_sha256
from tbm_gsa.reading import read_document
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS, InputSet
from tbm_gsa.sensitivity.study.problem import StudyProblem
from tbm_gsa.sensitivity.study.store import Store
from tbm_gsa.sensitivity.study.workers import Outcome
from tbm_msgs_py.base.errors import InputError

LONGEST = 2500  # characters of a line for a user
LEVEL = {
    "speed_r_min": 5.6,
    "torque_kn_m": 2280.0,
    "thrust_kn": 12000.0,
    "seconds": 60.0,
    "source": "recording",
    "note": "recorded",
}


@pytest.fixture
def command(tmp_path, monkeypatch, capsys):
    """Run a command line in an empty folder and hold its end against the promise; its exit code and complaint."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(signal, "signal", lambda *_: None)

    def run(line):
        monkeypatch.setattr(sys, "argv", ["tbm-monitor", *line.split()])
        with pytest.raises(SystemExit) as end:
            main()
        err = capsys.readouterr().err
        assert end.value.code in (0, 2), f"{line}: {err[:LONGEST]}"
        if end.value.code == 2:
            assert len(err.splitlines()) == 1, err[:LONGEST]
            assert len(err) < LONGEST
        return end.value.code, err

    return run


def explanation():
    digest = machine_sha256(load_machine("dz101"))
    rows = {"x9": (8.1e9, [7.6e9, 8.4e9]), "x16": (0.5, [0.4, 0.6])}
    texts = {"name": "Stiffness", "symbol": "k", "unit": "", "kind": "multiplier"}
    numbers = {"probability": 0.5, "log_evidence": -9.0}
    causes = [
        {"input": code, **texts, **numbers, "value": value, "interval": interval, "machine_value": 1.0}
        for code, (value, interval) in rows.items()
    ]
    searched = {"machine_value": 1.0, "learnt": 0.5, "lower": 0.3, "upper": 3.0, "distribution": "uniform"}
    return {
        "causes": [*causes, {"input": None, "name": "nothing has changed", **numbers}],
        "joint": {
            "inputs": {code: {"value": value, "interval": ends, **searched} for code, (value, ends) in rows.items()},
            "accepted": 0.3,
            "effective_samples": 900.0,
            "standardised_misfit": 1.0,
        },
        "statistics": [],
        "misfit": {"model": 0.3, "predicted": 0.1, "checked": 0.1},
        "standardised_misfit": {"model": 9.0, "predicted": 1.0, "checked": 1.0},
        "explained": True,
        "recording": {"path": "bag", "sha256": "0"},
        "machine": "dz101",
        "machine_file": {"origin": "dz101", "sha256": digest},
        "operating_point": LEVEL,
        "settings": {
            "machine": "dz101",
            "machine_sha256": digest,
            "duration": 6.0,
            "load_seed": 0,
            "high_hz": 400.0,
            "samples": 200,
            "seeds": 12,
            "model_error": 0.05,
            "seed": 0,
        },
        "seconds": 100.0,
        "versions": {"tbm_monitor": "0.1.0"},
    }


def comparison():
    bands = {"0.5-20_hz": 1.0, "20-100_hz": 2.0}
    intervals = {band: [0.9 * value, 1.1 * value] for band, value in bands.items()}
    names = ("rms", "peak", "crest_factor", "kurtosis", "velocity_rms")
    both = [f"{side}_{name}" for side in ("field", "model") for name in names]
    columns = ("start", "coverage", "relative_error", *(f"field_{name}" for name in names), "field_line_hz")
    line = {"frequency_hz": 130.3, "rms": 0.5, "match": "", "interval": [0.4, 0.6]}
    axis = {
        **dict.fromkeys(both, 2.0),
        **dict.fromkeys(("relative_error", "coverage", "field_rms_g", "model_rms_g"), 0.2),
        **{f"{side}_band_rms": bands for side in ("field", "model")},
        **{f"{side}_lines": [line] for side in ("field", "model")},
        "intervals": {
            **{key: [1.9, 2.1] for key in (*both, "relative_error")},
            **{f"{side}_band_rms": intervals for side in ("field", "model")},
        },
        "windows": {
            **{key: [0.5] for key in columns},
            "level": [0],
            "field_band_rms": {band: [1.0] for band in bands},
        },
    }
    spectrum = {"resolution_hz": 1.0, "density": [1.0], "segments": 9.0, "interval_factors": [0.5, 2.0]}
    of_level = {"field_rms": 2.0, "model_rms": 1.9, "relative_error": 0.1}
    at_level = {**of_level, "intervals": {key: [1.9, 2.1] for key in of_level}}
    return {
        "window_s": 2.0,
        "confidence": 0.95,
        "points": {"cutterhead": {"x": axis}},
        "spectra": {"cutterhead": {"x": {"field": spectrum, "model": spectrum}}},
        "nodes": {"cutterhead": 3},
        "bands": {"cutterhead": {"low_hz": 0.5, "high_hz": 1000.0, "field_rate_hz": 5000.0, "model_rate_hz": 1e4}},
        "skipped": {},
        "recording": {
            **{"path": "bag", "messages": 9, "lost": 0, "truncated": False, "damaged": 0, "sha256": "0"},
            **{"duration": 60.0, "points": {}},
        },
        "expected_lines": [{"name": "mesh", "frequency_hz": 14.2, "kind": "mesh"}],
        "machine": "dz101",
        "machine_file": {"origin": "dz101", "sha256": machine_sha256(load_machine("dz101"))},
        "operating_point": LEVEL,
        "levels": [{**LEVEL, "points": {"cutterhead": {"x": at_level}}}],
        "dwells": [{"begin": 0.0, "end": 60.0, "kind": "steady", "level": 0}],
        "model_duration": 30.0,
        "seed": 0,
        "versions": {"tbm_monitor": "0.1.0"},
    }


def everywhere_wrong(document, file, read):
    """Every value of a document wrong in every third way, others at the next: the place, and whether it is refused."""
    wrongs = [(place, wrong) for place in places(document) for wrong in WRONG.values()]
    for place, wrong in wrongs[::3]:
        file.write_text(json.dumps(tampered(document, place, wrong)))
        try:
            read(file)
        except InputError as error:
            assert len(str(error).splitlines()) == 1
            assert len(str(error)) < LONGEST
            yield place, True
        else:
            yield place, False


def test_a_tampered_explanation_is_one_line(tmp_path, command):
    document = explanation()
    (tmp_path / "right.json").write_text(json.dumps(document))
    assert command("machine update dz101 --from right.json --out right.yaml") == (0, "")
    given = (tmp_path / "right.yaml").read_text()
    refused = 0
    for number, (changed, wrong) in enumerate(everywhere_wrong(document, tmp_path / "wrong.json", read_explanation)):
        if number % (50 if wrong else 5):  # some go the whole way, for the command reads as was done here
            refused += wrong
            continue
        out = tmp_path / f"{number}.yaml"
        code, _ = command(f"machine update dz101 --from wrong.json --out {out.name} --input x9 --input x16")
        assert out.exists() == (code == 0), changed
        if code == 0:
            load_machine(out)
        refused += code == 2
    assert refused > 100
    assert (tmp_path / "right.yaml").read_text() == given


@pytest.mark.parametrize("value", [1e300, -1.0, 0.0, 8.6e9])
def test_a_value_no_explanation_finds_writes_no_machine(tmp_path, command, value):
    document = explanation()
    document["causes"][0]["value"] = value
    (tmp_path / "found.json").write_text(json.dumps(document))
    code, err = command("machine update dz101 --from found.json --out new.yaml")
    assert code == 2
    assert "found.json" in err
    assert [path.name for path in tmp_path.iterdir()] == ["found.json"]


def test_a_machine_in_no_folder_is_one_line(tmp_path, command):
    (tmp_path / "found.json").write_text(json.dumps(explanation()))
    code, err = command("machine update dz101 --from found.json --out nowhere/new.yaml")
    assert (code, err) == (2, "tbm-monitor: nowhere/new.yaml: No such file or directory\n")


def test_a_tampered_comparison_is_one_line(tmp_path, command, monkeypatch):
    def observed(*_):
        raise StudyError("as far as its document")

    monkeypatch.setattr(workflow, "observed", observed)
    document = comparison()
    (tmp_path / "right.json").write_text(json.dumps(document))
    assert "as far as its document" in command("gsa explain right.json")[1]
    refused = 0
    read = partial(read_document, form=ComparisonResult, what="a comparison")
    for number, (_, wrong) in enumerate(everywhere_wrong(document, tmp_path / "wrong.json", read)):
        if number % (50 if wrong else 5):
            refused += wrong
            continue
        refused += "as far as its document" not in command("gsa explain wrong.json")[1]
    assert refused > 300


NONE = {"empty": "", "deep": "[" * 100_000, "digits": "9" * 5000, "another": "{}", "a list": "[]", "nothing": "null"}


@pytest.mark.parametrize("text", [*NONE.values(), '{"a": NaN}', "\0"], ids=[*NONE, "no number", "a zero"])
@pytest.mark.parametrize("line", ["gsa explain wrong.json", "machine update dz101 --from wrong.json --out new.yaml"])
def test_a_document_that_is_none_is_one_line(tmp_path, command, line, text):
    (tmp_path / "wrong.json").write_text(text)
    code, err = command(line)
    assert code == 2
    assert err.startswith("tbm-monitor: wrong.json: not ")


def test_a_tampered_study_is_one_line(tmp_path):
    inputs = InputSet(PAPER_INPUTS.inputs[:2], {"both": ("x1", "x2")})
    evaluate = MachineEvaluation.of("dz101", 0.02, 0)
    problem = StudyProblem(inputs, evaluate.outputs, 3, 1, 0, evaluate.settings)
    with Store.create_or_open(tmp_path / "store.sqlite", problem) as store:
        for row, _ in store.pending()[:3]:
            store.record(Outcome(row, dict.fromkeys(problem.outputs, 1.0), None, 0.1))
    assert read_back(tmp_path / "store.sqlite") == ""
    refused = 0
    for key, text in problem.to_json().items():
        document = {"": json.loads(text)}
        for place in places(document):
            for wrong in WRONG.values():
                changed = tampered(document, place, wrong)
                with sqlite3.connect(tmp_path / "store.sqlite") as edited:
                    if changed:
                        edited.execute("REPLACE INTO problem VALUES (?, ?)", (key, json.dumps(changed[""])))
                    else:
                        edited.execute("DELETE FROM problem WHERE key = ?", (key,))
                refused += read_back(tmp_path / "store.sqlite") != ""
        with sqlite3.connect(tmp_path / "store.sqlite") as edited:
            edited.execute("REPLACE INTO problem VALUES (?, ?)", (key, text))
    assert refused > 300
    for column in ("inputs", "outputs"):
        texts = [json.dumps(wrong) for wrong in WRONG.values() if wrong is not REMOVED]
        for wrong in (*texts, "[", "", b"\xff", 3):
            with sqlite3.connect(tmp_path / "store.sqlite") as edited:
                (right,) = edited.execute(f"SELECT {column} FROM simulations WHERE row = 2").fetchone()
                edited.execute(f"UPDATE simulations SET {column} = ? WHERE row = 2", (wrong,))
            assert "store.sqlite: a simulation" in read_back(tmp_path / "store.sqlite"), wrong
            with sqlite3.connect(tmp_path / "store.sqlite") as edited:
                edited.execute(f"UPDATE simulations SET {column} = ? WHERE row = 2", (right,))


def read_back(path):
    """Read all that a study that is gone on with reads; the error for the user, one line."""
    try:
        with Store.open(path) as store:
            for part in ("train", "test"):
                store.problem.inputs.to_unit(store.results(part)[0])
            store.pending(), store.counts(), store.failures(), store.simulation_seconds()
            MachineEvaluation.from_settings(store.problem.settings, store.problem.outputs)
    except (InputError, MachineError) as error:
        assert len(str(error).splitlines()) == 1
        return str(error)
    return ""


HISTORY = [
    "history --json",
    "history",
    "history baseline list",
    "history baseline show commissioning",
    "history baseline set another --replace",
    "history --by ring",
    "history export w.csv",
    "events",
    "events --json",
    "events ack 1 --by Anna --replace",
]


def test_a_tampered_history_is_one_line(tmp_path, command, monkeypatch):
    file = tmp_path / "history.sqlite"
    monkeypatch.setenv("TBM_HISTORY", str(file))
    monkeypatch.chdir(tmp_path)
    with History(file) as history:
        source = WindowSource("live", "node", "", "dz101", "0")
        windows = [HistoryEntry("cutterhead", "x", k * 10**9, 10**9, 1.0, 1.1, 0.1, 1.0, 3.0, 3.0) for k in range(6)]
        context = Context(412, 1.5, "III", "night")
        history.add(source, windows, lambda _: context)
        history.store_event(source, Event(0, "dead", "girder", "error", "sensor", "x", context=context))
    assert command("history baseline set commissioning")[0] == 0
    whole = file.read_bytes()
    wrong = (None, "x", "x" * 100_000, b"\xff\xfe", 7, -(2**63), 2**63 - 1, 1e300, float("inf"), -1.5)
    tables = ("sources", "windows", "baselines", "usual_errors", "contexts", "events")
    opened = sqlite3.connect(file)
    columns = {table: [row[1] for row in opened.execute(f"PRAGMA table_info({table})")] for table in tables}
    opened.close()
    refused = 0
    changes = [(table, column, value) for table, found in columns.items() for column in found for value in wrong]
    for table, column, value in changes[::9]:  # every value of some columns
        file.write_bytes(whole)
        with sqlite3.connect(file) as edited:
            edited.execute("PRAGMA ignore_check_constraints = ON")
            edited.execute("PRAGMA foreign_keys = OFF")
            with suppress(sqlite3.IntegrityError):  # of a key that SQLite itself keeps whole
                edited.execute(f"UPDATE OR IGNORE {table} SET {column} = ?", (value,))
        edited.close()
        codes = [command(line)[0] for line in HISTORY]
        refused += 2 in codes
    assert refused > 15
