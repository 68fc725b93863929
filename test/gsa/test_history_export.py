"""Windows as a table: what other readers find in it, and what is refused."""

import csv
import json
import math
import sys
from dataclasses import replace

import pytest

from tbm_gsa.history import Context, History, HistoryEntry, WindowSource, export

SECOND, START = 10**9, 1_700_000_000 * 10**9
SOURCE = WindowSource("live", '/tbm/node, "a"', "", "dz101", "ab" * 32)
FIRST = HistoryEntry("girder", "x", START, 2 * SECOND, 1.5, 1.2, 0.2, 1.0)


@pytest.fixture
def file(tmp_path):
    with History(tmp_path / "h.sqlite") as history:
        history.add(SOURCE, [FIRST], lambda _: Context(412, 1234.5, "III, wet", None))
        later = replace(FIRST, start_ns=START + 2 * SECOND, relative_error=math.inf, field_peak=6.0, field_kurtosis=3.1)
        history.add(SOURCE, [later, replace(FIRST, point="shield", start_ns=START + 2 * SECOND)])
    return history.path


def test_a_csv_reader_finds_every_window(file, tmp_path, typed):
    out = tmp_path / "w.csv"
    code, said, _ = typed("history", "export", str(out), "--history", str(file), "--json")
    assert (code, json.loads(said)) == (0, {"path": str(out), "format": "CSV table", "rows": 3})
    with out.open(encoding="utf-8", newline="") as opened:
        rows = list(csv.DictReader(opened))
    first = rows[0]
    assert (first["start"], first["start_ns"]) == ("2023-11-14T22:13:20.000Z", str(START))
    assert (first["rock_class"], first["ring"], first["shift"], first["field_peak"]) == ("III, wet", "412", "", "")
    assert (first["name"], float(first["length_s"]), float(first["field_rms"])) == (SOURCE.name, 2.0, 1.5)
    assert [(one["point"], one["relative_error"], one["ring"]) for one in rows[1:]] == [
        ("girder", "inf", ""),
        ("shield", "0.2", ""),
    ]
    assert typed("history", "export", str(out), "--history", str(file), "--point", "shield")[0] == 0  # in its place
    assert len(out.read_text().splitlines()) == 2


def test_a_parquet_reader_finds_every_window(file, tmp_path, typed, monkeypatch):
    parquet = pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr(export, "_GROUP", 2)
    out = tmp_path / "w.parquet"
    assert typed("history", "export", str(out), "--history", str(file))[0] == 0
    found = parquet.ParquetFile(out)
    assert (found.num_row_groups, found.metadata.num_rows) == (2, 3)
    table = found.read().to_pydict()
    assert list(table) == list(export.COLUMNS)
    assert [value.isoformat()[:19] for value in table["start"]] == ["2023-11-14T22:13:20", *["2023-11-14T22:13:22"] * 2]
    assert (table["field_peak"], table["relative_error"]) == ([None, 6.0, None], [0.2, math.inf, 0.2])
    assert (table["ring"], table["rock_class"]) == ([412, None, None], ["III, wet", None, None])
    assert found.schema_arrow.field("field_rms").metadata[b"unit"].decode() == "m/s²"


def test_what_cannot_be_exported_is_one_line(file, tmp_path, typed, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    (tmp_path / "theirs.csv").write_text("a,b\n")
    for name, more, problem in (
        ("w.parquet", (), "Parquet needs the package pyarrow, allowed: pip install 'tbm_monitor[export]'"),
        ("w.xlsx", (), "allowed: a file that ends in .csv or .parquet"),
        ("theirs.csv", (), "exists already and is no CSV table"),
        ("no/w.csv", (), "no folder"),
        ("w.csv", ("--since", "2025-01-01"), "no window begins in that time"),
        ("w.csv", ("--point", "moon"), "no test point moon, there: girder, shield"),
    ):
        code, _, error = typed("history", "export", str(tmp_path / name), "--history", str(file), *more)
        assert (code, problem in error, error.count("\n")) == (2, True, 1), error
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".csv", ".sqlite"]
