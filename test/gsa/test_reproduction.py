"""`tbm-monitor reproduce`: every table and figure has its rows; runs again, goes on, and refuses bad input.

The whole of it, in the paper's numbers, takes minutes and is marked `verify`; a tiny one runs always.
"""

import json
import re
from dataclasses import replace

import pytest
from here import pictures_without_layout, simulations_here, small_samplings
from report_pages import check_page, check_widths

from tbm_dynamics.indicators import INDICATORS
from tbm_gsa.app.cli import output
from tbm_gsa.app.cli.shipped import shipped_bag
from tbm_gsa.paper.published import TRENDS
from tbm_gsa.paper.reproduction import studies, workflow
from tbm_gsa.paper.reproduction.loads import gather_loads, load_rows
from tbm_gsa.paper.reproduction.model import mesh_curves, model_rows
from tbm_gsa.paper.reproduction.response import gather_response
from tbm_gsa.paper.reproduction.response_rows import response_rows
from tbm_gsa.paper.reproduction.result import SOURCES, ReproductionResult, Sizes
from tbm_gsa.paper.reproduction.sensitivity import sensitivity_rows
from tbm_gsa.paper.reproduction.surrogates import surrogate_rows
from tbm_gsa.paper.reproduction.verdict import VERDICTS
from tbm_gsa.paper.reproduction.workflow import reproduce
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS
from tbm_gsa.sensitivity.study.problem import StudyProblem
from tbm_gsa.sensitivity.study.store import Store

TINY = Sizes(
    train=12, test=2, other_train=11, simulation_s=0.02, run_s=2.0, model_s=2.0, loads_s=20.0, whole_study=False
)

# Section by section what the paper says, as ids of rows: written by hand, not taken from the code.
CONTRACT = [
    *(f"table2.{point}.{kind}" for point in ("cutterhead", "shield", "gripper") for kind in ("predicted", "measured")),
    *(f"table2.{point}.error" for point in ("cutterhead", "shield", "gripper")),
    "figure7.peak",
    *(f"figure7.decay.{axis}" for axis in "xyz"),
    *("figure5.axial", "figure5.load_line", "figure5.mesh.1", "figure5.mesh.2", "figure5.mesh.3"),
    *("figure5.mesh.load_0.89", "figure5.mesh.load_130.3"),
    *(f"table6.{name}.{method}" for name in INDICATORS for method in ("best", "rbf", "krg", "svr")),
    *(f"figure10.{name}" for name in INDICATORS),
    *("figure11.RDef_A.main", "figure13.PAcc_A.main", "figure13.PAcc_L.main", "figure13.PAcc_R.main"),
    *("figure14.MF_M.main", "figure14.MF_Se.main"),
    *("figure13.PAcc_A.x4", "figure13.PAcc_R.x2", "figure14.MF_M.x2", "figure14.MF_Se.x11"),
    *(f"figure11.{name}.{kind}" for name in ("RDef_A", "RDef_L", "RDef_R") for kind in ("sum", "total")),
    *(f"figure13.{name}.{kind}" for name in ("PAcc_A", "PAcc_L", "PAcc_R") for kind in ("sum", "total")),
    *(f"figure14.{name}.{kind}" for name in ("MF_M", "MF_Se") for kind in ("sum", "total")),
    *(f"figure12.RDef_A.{code}" for code in ("x3", "x16", "x18", "x19", "x22")),
    *(f"figure12.PAcc_L.{code}" for code in ("x1", "x2", "x11", "x23", "x24")),
    *("figure15.MF_M.x2", "figure15.MF_Se.x2", "figure15.MF_Se.x11", "figure15.MF_Se.x20"),
    *("figure15.MF_M.x8", "figure15.MF_Se.x8"),
    *(f"table1.{name}.{kind}" for name in ("fx", "fy", "fz", "mx", "my", "mz") for kind in ("mean", "lines")),
    *(f"table4.x{number}" for number in range(1, 26)),
    *(f"table5.k_{name}" for name in ("r_ct", "r_gd", "c_cf", "c_fb", "c_bc", "c_cg", "b_io", "b_pc", "s_pg", "h_gd")),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("reproduction")


@pytest.fixture(scope="module")
def result(folder):
    with simulations_here(), small_samplings():
        return reproduce("dz101", folder, shipped_bag(), sizes=TINY, workers=1)


def _without_times(document):
    return {key: value for key, value in document.items() if key != "seconds"}


def test_every_table_and_figure_has_its_rows(result):
    rows = result.result.rows
    assert {row.source for row in rows} == set(SOURCES)
    assert set(SOURCES) == {*(f"Table {k}" for k in range(1, 7)), *(f"Figure {k}" for k in range(2, 16))}
    ids = [row.id for row in rows]
    assert len(set(ids)) == len(ids)
    assert set(CONTRACT) <= set(ids)
    assert sum(len(codes) for codes in TRENDS.values()) == 14
    for row in rows:
        assert row.verdict in VERDICTS
    assert sum(result.result.verdicts.values()) == sum("@" not in name for name in ids)


def test_an_input_handed_back_is_no_agreement(result):
    rows = {row.id: row for row in result.result.rows}
    given = [
        name for name in rows if re.match(r"table[45]\.|table2\..*measured|table1\.f?m?[xyz]\.(mean|lines)$", name)
    ]
    assert len(given) == 25 + 10 + 3 + 12
    assert {rows[name].verdict for name in given if not name.startswith("table1")} == {"given"}
    assert {rows[name].verdict for name in given} <= {"given", "differs"}
    assert rows["figure5.load_line"].verdict in {"given", "differs"}
    for name in ("table2.cutterhead.predicted", "table2.shield.predicted", "figure5.axial", "figure7.decay.x"):
        assert rows[name].verdict in {"calibrated", "differs"}


def test_both_readings_of_the_dampings_are_shown(result):
    ids = {row.id for row in result.result.rows}
    for name in ("table2.cutterhead.predicted", "table6.RDef_A.best", "figure13.PAcc_A.x4", "figure5.axial_shows"):
        assert {name, f"{name}@ratio"} <= ids
    assert [one.name for one in result.result.readings] == ["stiffness_proportional", "ratio"]
    # Fitted under the first only: under the other nothing is calibrated.
    assert not any(row.verdict == "calibrated" for row in result.result.rows if row.id.endswith("@ratio"))


def test_rows_of_the_smaller_campaign_say_how_small_it_was(result):
    rests = re.compile(r"(table6|figure(9|1[0-5]))\..*@ratio")
    noted = {row.id for row in result.result.rows if "11 points" in row.note}
    assert noted == {row.id for row in result.result.rows if rests.fullmatch(row.id)}
    assert len(noted) > 80


def test_what_no_surrogate_follows_is_no_finding(result):
    rows = {row.id: row for row in result.result.rows}
    study = result.studies[0]
    poor = [name for name, output in study.outputs.items() if output.best.r2_cv < 0.5]
    assert 0 < len(poor) < len(study.outputs)
    for name in study.outputs:
        row = next(row for name_, row in rows.items() if name_.endswith(f".{name}.sum"))
        assert (row.ours == "not determined") == (row.verdict == "no number") == (name in poor)
        assert (f"R² of {name}" in row.note) == (name in poor)


def test_again_it_redoes_no_simulation_and_says_the_same(result, folder, monkeypatch):
    def refuse(*_):
        raise AssertionError("simulated again")

    monkeypatch.setattr(studies.MachineEvaluation, "__call__", refuse)
    own = result.readings[0]
    campaign = studies.Campaign(own, "dz101", TINY.train, TINY.test, TINY.simulation_s, 0)
    store = folder / own.name / "store.sqlite"
    before = store.read_bytes()
    with small_samplings():
        study = studies.fitted_study(campaign, folder / own.name, workers=1, progress=lambda *_: None)
    assert store.read_bytes() == before
    again = [*surrogate_rows(study), *sensitivity_rows(study)]
    said = {row.id: row for row in result.result.rows}
    assert len(again) > 80
    assert all(said[row.id] == row for row in again)
    other = gather_loads(own.machine, 0, TINY.loads_s), mesh_curves(own.machine)
    assert all(said[row.id] == row for row in (*load_rows(other[0]), *model_rows(own.machine, other[1])))
    response = gather_response(own, shipped_bag(), 0, TINY.run_s, TINY.model_s)
    assert all(said[row.id] == row for row in response_rows(response))


def test_the_command_says_what_differs_on_a_whole_page(result, tmp_path, typed, monkeypatch):
    monkeypatch.setattr(workflow, "reproduce", lambda *_, **__: result)
    monkeypatch.setattr(output.results, "_width", 400)  # nothing is wrapped
    with pictures_without_layout():
        code, out, err = typed("reproduce", "--out", str(tmp_path))
    assert (code, err.split()) == (0, ["page:", f"{tmp_path}/reproduction.html"])
    rows = result.result.rows
    differing = [row for row in rows if row.verdict == "differs" and row.reading in (None, "stiffness_proportional")]
    assert len(differing) > 5
    assert all(row.what.split("\n")[0][:30] in out for row in differing)
    assert f"{result.result.verdicts['differs']} differs" in out
    written = (tmp_path / "reproduction.json").read_text("utf-8")
    assert ReproductionResult.model_validate_json(written) == result.result
    keys = {"id", "source", "what", "paper", "ours", "difference", "unit", "verdict", "note", "reading"}
    assert all(set(row) == keys for row in json.loads(written)["rows"])
    text = (tmp_path / "reproduction.html").read_text("utf-8")
    page = check_page(text)
    assert {source.lower().replace(" ", "") for source in SOURCES} <= set(page.ids)
    check_widths(text)
    assert "synthetic" in text


def _refused(answer, *words):
    code, out, err = answer
    assert code == 2
    assert out == ""
    assert len(err.strip().splitlines()) == 1
    for word in words:
        assert word in err


def test_bad_input_is_one_line(tmp_path, typed):
    file = tmp_path / "file"
    file.write_text("")
    _refused(typed("reproduce", "--out", str(file), "--json"), str(file), "is a file", "allowed: a folder")
    _refused(typed("reproduce", "--out", str(file / "below"), "--json"), str(file))
    out = tmp_path / "new"
    _refused(typed("reproduce", "--machine", "nowhere", "--out", str(out)), "nowhere")
    _refused(typed("reproduce", "--machine", "open380", "--out", str(out)), "open380")
    assert not out.exists()
    other = tmp_path / "other"
    with Store.create_or_open(
        other / "stiffness_proportional/store.sqlite", StudyProblem(PAPER_INPUTS, INDICATORS, 10, 2, 5)
    ):
        pass
    _refused(typed("reproduce", "--out", str(other)), "store.sqlite", "holds another study")


@pytest.mark.verify
def test_the_whole_reproduction_is_written(tmp_path, typed):
    code, out, _ = typed("reproduce", "--out", str(tmp_path), "--json")
    assert code == 0
    document = json.loads(out)
    assert json.loads((tmp_path / "reproduction.json").read_text(encoding="utf-8")) == document
    assert (tmp_path / "reproduction.html").stat().st_size > 100_000
    assert document["sizes"] == {**vars(replace(Sizes()))}
    rows = {row["id"]: row for row in document["rows"]}
    # What the design expects of this reading: surrogates, main parameters and sums as in the paper.
    for name in ("RDef_A", "RDef_L", "RDef_R", "PAcc_A", "PAcc_R", "MF_M", "MF_Se"):
        assert rows[f"table6.{name}.best"]["verdict"] == "agrees"
    assert rows["figure14.MF_M.main"]["verdict"] == "agrees"
    code, out, _ = typed("reproduce", "--out", str(tmp_path), "--json")
    assert code == 0
    assert _without_times(json.loads(out)) == _without_times(document)
