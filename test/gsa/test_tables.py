"""Tables of the command line fit 80 characters: no figure is cut off, no word broken.

What takes minutes to compute is printed from a document of the widest entries that it may have.
"""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from compare_bags import START_NS, noise, write_bag

from tbm_gsa.app.cli import demo, explain, gsa, reproduce, run
from tbm_gsa.app.cli.output import results
from tbm_gsa.explanation.result import Explanation, InputCause, Misfits, StretchFinding
from tbm_gsa.history import History, HistoryEntry, WindowSource
from tbm_gsa.paper.reproduction.result import ReadingSummary, ReproductionResult, Row
from tbm_gsa.reading import MachineFile
from tbm_gsa.sensitivity.results import OutputResult, StudyResult
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS

LONG_OUTPUT = "rms_120-140_hz_cutterhead_yz"
FIRST = {"x16": 0.93, "x11": 0.85, "x19": 0.77, "x22": 0.61, "x17": 0.54}


@pytest.fixture(autouse=True)
def _as_piped(monkeypatch):
    monkeypatch.setattr(results, "width", 80)


def _fits(out, *expected):
    assert out.strip()
    assert max(map(len, out.splitlines())) <= 80, out
    assert "…" not in out
    assert set(" ".join(expected).split()) <= set(out.split()), out


@pytest.mark.parametrize(
    "given",
    [
        "machine show --machine dz101 --count 25",
        "machine show --machine open380",
        "machine check",
        "machine loads --duration 20",
        "simulate --duration 0.05",
    ],
)
def test_what_a_machine_prints_fits(typed, given):
    code, out, _ = typed(*given.split())
    assert code == 0
    _fits(out)


def test_what_a_recording_prints_fits(typed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_bag("bag", {"cutterhead": noise(6.0), "shield": noise(6.0)})
    _fits(typed("bag", "info", "bag", "--scan")[1], "cutterhead", "sensor_msgs/msg/PointCloud2")
    title, *lines = typed("compare", "bag", "--model-duration", "2", "--no-keep")[1].splitlines()
    assert str(tmp_path) in title
    _fits("\n".join(lines), "cutterhead", "100.000%")


def test_what_a_history_prints_fits(typed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with History(Path("h.sqlite")) as history:
        for n in range(8):
            error = 10.0 + n  # 1350% ± 245%
            rows = [HistoryEntry("cutterhead", "x", START_NS + n, 1, 1.0, 1.2, error, 1.0)]
            history.add(WindowSource("synthetic", "recording", "", "open380_updated", "ab" * 32), rows)
    given = ("--history", "h.sqlite")
    assert typed("history", "baseline", "set", "commissioning_spring", *given)[0] == 0
    _fits(typed("history", *given)[1], "cutterhead", "synthetic open380_updated", "1350% ± 245%", "1700%")
    _fits(typed("history", "baseline", "list", *given)[1], "commissioning_spring", "open380_updated")
    _fits(typed("history", "baseline", "show", "commissioning_spring", *given)[1], "1350%", "245%")


def test_what_a_study_prints_fits(capsys):
    output = OutputResult.model_construct(surrogate="krg", r2_test=-0.123, r2_cv=0.997, first=FIRST)
    untested = output.model_copy(update={"r2_test": None})  # all test simulations failed
    results.print(gsa.strongest_table(StudyResult.model_construct(outputs={"RDef_A": untested, LONG_OUTPUT: output})))
    pairs = [f"{code}:{share:.2f}" for code, share in FIRST.items()]
    _fits(capsys.readouterr().out, LONG_OUTPUT, "-0.123", "0.997", *pairs)


def test_what_the_demo_prints_fits(capsys):
    point = demo.DemoPoint(node=43, predicted_g=10.234, measured_g=0.4, relative_error=24.59, windows=15)
    output = demo.DemoOutput(surrogate="krg", r2_test=-0.123, r2_cv=0.997, determined=True, strongest=FIRST)
    found = demo.DemoResult(
        points={"cutterhead": point},
        outputs={LONG_OUTPUT: output},
        blocks={},
        findings=(StretchFinding(begin=0.0, end=30.4, verdict="rock", sentence="rock: the loads", folder="f"),),
        trigger="",
        report="r",
        seconds=1.0,
        machine_file=MachineFile(origin="dz101", sha256="0" * 64),
        seed=0,
        recording=demo.PlayedRecording(path="bag", mapping=None),
    )
    demo.print_tables(found, synthetic=True)
    pairs = [f"{code}:{share:.2f}" for code, share in FIRST.items()]
    _fits(
        capsys.readouterr().out,
        "cutterhead",
        "10.2",
        "2459",
        LONG_OUTPUT,
        "-0.123",
        *pairs,
        "0 to 30 s: rock: the loads",
    )


def test_what_an_explanation_prints_fits(capsys):
    numbers = {"probability": 0.123, "value": -1.23e-5, "interval": (-1.11e-5, -2.22e-5), "machine_value": -3.33e-5}
    causes = [
        InputCause.model_construct(input=item.code, name=item.symbol, unit=item.unit, **numbers)
        for item in PAPER_INPUTS.inputs
    ]
    misfits = Misfits(model=3.0, predicted=2.0, checked=2.0)
    for first in range(0, len(causes), 8):
        shown = causes[first : first + 8]
        explain._print(
            Explanation.model_construct(
                causes=shown, statistics=(), misfit=misfits, standardised_misfit=misfits, explained=True
            )
        )
        out = capsys.readouterr().out
        _fits(out, "-1.23e-05", "-1.11e-05 to -2.22e-05", "-3.33e-05", *(cause.input for cause in shown))


def test_what_the_reproduction_prints_fits(capsys):
    what = "PAcc_A of the cutterhead: share of the strongest input, closed form against sampling"
    row = Row("figure12.a", what, "x3, x16, x18, x19, x22", -1.234e-12, "differs")
    reproduce._print(
        ReproductionResult.model_construct(
            rows=(row, replace(row, paper=1.5, ours=None)),
            readings=(ReadingSummary(name="one", title="one", own=True, fitted=False),),
            verdicts={"differs": 2},
            seconds={"total": 1.0},
        )
    )
    _fits(capsys.readouterr().out, row.what, row.paper, "-1.234e-12", "Figure 12")


def test_what_a_run_prints_fits(capsys):
    count = SimpleNamespace(received=12_345_678, lost=1_234_567, stream_time=1_234_567.89)
    names = ("/tbm/model/cutterhead/block", "/tbm/model/mesh_forces")
    state = SimpleNamespace(blocks={name.removeprefix("/tbm/"): count for name in names}, diagnostics={})
    run._print_table(run.RunResult.of(state, 1.0))
    _fits(capsys.readouterr().out, *names, "12345678", "1234567", "1234567.89")


def test_a_narrow_terminal_cuts_off_no_figure(command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    _fits(command("bag", "info", "field_dz101")[1], "/tbm/field/cutterhead/block", "sensor_msgs/msg/PointCloud2", "297")
