"""The windows of a history as a table for other programs: CSV, or Parquet by pyarrow, an extra."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, Final, Literal

from tbm_gsa.history.entries import StoredEntry
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.files import unfinished
from tbm_msgs_py.base.units import iso_time

TableKind = Literal["CSV table", "Parquet table"]
COLUMNS: Final = {  # with what pyarrow calls their type, and their unit
    "start": ("timestamp", ""),
    "start_ns": ("int64", "ns"),
    "length_s": ("float64", "s"),
    "point": ("string", ""),
    "axis": ("string", ""),
    "field_rms": ("float64", "m/s²"),
    "model_rms": ("float64", "m/s²"),
    "relative_error": ("float64", "1"),
    "coverage": ("float64", "1"),
    "field_peak": ("float64", "m/s²"),
    "field_kurtosis": ("float64", "1"),
    "source": ("string", ""),
    "name": ("string", ""),
    "machine": ("string", ""),
    "machine_sha256": ("string", ""),
    "ring": ("int64", ""),
    "chainage": ("float64", "m"),
    "rock_class": ("string", ""),
    "shift": ("string", ""),
}
_GROUP: Final = 65_536  # rows that are held at a time
_KINDS: Final[dict[str, TableKind]] = {".csv": "CSV table", ".parquet": "Parquet table"}


def table_kind(path: Path) -> TableKind:
    """Kind of a table by the suffix of its file; an InputError for any other suffix, or where pyarrow is missing."""
    if path.suffix not in _KINDS:
        raise InputError(f"{path}: allowed: a file that ends in {' or '.join(_KINDS)}")
    if path.suffix == ".parquet":
        _pyarrow()
    return _KINDS[path.suffix]


def write_table(path: Path, windows: Iterable[StoredEntry]) -> int:
    """Write windows into a file whole, some at a time; the number of rows."""
    write: Callable[[Path, Iterator[tuple[Any, ...]]], int]
    write = _write_csv if table_kind(path) == "CSV table" else _write_parquet
    with unfinished(path) as fresh:
        return write(fresh, map(_row, windows))


def _row(window: StoredEntry) -> tuple[Any, ...]:
    """Values by `COLUMNS`; the time as ns, None where a number is not known."""
    entry, source = window.entry, window.source
    numbers = (entry.field_rms, entry.model_rms, entry.relative_error, entry.coverage, entry.field_peak)
    known = (None if math.isnan(value) else value for value in (*numbers, entry.field_kurtosis))
    times = (entry.start_ns, entry.start_ns, entry.length_ns * 1e-9)
    origin = (source.kind, source.name, source.machine, source.machine_sha256)
    said = window.context
    context = (said.ring, said.chainage, said.rock_class, said.shift)
    return (*times, entry.point, entry.axis, *known, *origin, *context)


def _write_csv(path: Path, rows: Iterator[tuple[Any, ...]]) -> int:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer, count = csv.writer(file), 0
        writer.writerow(COLUMNS)
        for start_ns, *values in rows:
            writer.writerow((iso_time(start_ns), *values))
            count += 1
    return count


def _write_parquet(path: Path, rows: Iterator[tuple[Any, ...]]) -> int:
    arrow = _pyarrow()
    kinds = {"timestamp": arrow.timestamp("ns", "UTC")}
    schema = arrow.schema(
        arrow.field(name, kinds.get(kind) or getattr(arrow, kind)(), metadata={"unit": unit} if unit else None)
        for name, (kind, unit) in COLUMNS.items()
    )
    count = 0
    with arrow.parquet.ParquetWriter(path, schema) as writer:
        while group := list(islice(rows, _GROUP)):
            columns = zip(*group, strict=True)
            arrays = [arrow.array(column, one.type) for column, one in zip(columns, schema, strict=True)]
            writer.write_table(arrow.Table.from_arrays(arrays, schema=schema))
            count += len(group)
    return count


def _pyarrow() -> Any:
    try:
        import pyarrow.parquet  # noqa: PLC0415 - an extra
    except ImportError:
        raise InputError(
            "Parquet needs the package pyarrow, allowed: pip install 'tbm_monitor[export]', or a .csv file"
        ) from None
    return pyarrow
