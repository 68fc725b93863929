"""`tbm-monitor bag import`: measurements of other systems into a recording."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from tbm_gsa.app.cli.output import JSON_OPTION, add_row, narrow_table, notes, print_json, progress_bar, results
from tbm_gsa.reading import Part
from tbm_msgs_py.importing import Description, Imported, ImportedStream, describe, import_recording
from tbm_msgs_py.importing.apart import CRASHING, import_apart

_POINT = "POINT=X,Y,Z"
_AXES = 3
_BETWEEN_COLUMNS = re.compile(r",(?![^(]*\))")  # not the commas of a MATLAB index, a(:,1)


class ImportResult(Part):
    """What `bag import --json` prints: streams by test point, and `operating_point`; what the user should look at."""

    path: str
    streams: dict[str, ImportedStream]
    warnings: tuple[str, ...]


def import_(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="CSV, TDMS, MDF 4 (.mf4), WAV or MATLAB (.mat) file; with several, columns are called FILE:COLUMN.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="New rosbag2 folder, or a bare .mcap file.")],
    mapping: Annotated[
        list[str] | None,
        typer.Option(
            "--map", help=f"Import description (YAML), or {_POINT}: columns of a point, empty if not measured."
        ),
    ] = None,
    units: Annotated[str | None, typer.Option(help=f"m/s2 or g, for every {_POINT}.")] = None,
    gravity: Annotated[str | None, typer.Option(help=f"included or removed, for every {_POINT}.")] = None,
    frame: Annotated[str | None, typer.Option(help=f"fixed or rotating, for every {_POINT}.")] = None,
    full_scale: Annotated[float | None, typer.Option(help="Value of a reading of 1; WAV: of full scale.")] = None,
    rate: Annotated[float | None, typer.Option(help="Sample rate (Hz), where no column holds the time.")] = None,
    time: Annotated[str | None, typer.Option(help="COLUMN:UNIT (s, ms, us, ns, datetime), or file.")] = None,
    start: Annotated[str | None, typer.Option(help="Moment of time 0, ISO 8601 with its zone, or file.")] = None,
    timezone: Annotated[
        str | None, typer.Option(help="Zone of times without one, such as Europe/Berlin, UTC or +01:00.")
    ] = None,
    speed: Annotated[
        str | None, typer.Option(help="Cutterhead speed, COLUMN:UNIT or =VALUE:UNIT (r/min, rad/s).")
    ] = None,
    torque: Annotated[
        str | None, typer.Option(help="Cutterhead torque, COLUMN:UNIT or =VALUE:UNIT (N.m, kN.m, MN.m).")
    ] = None,
    thrust: Annotated[str | None, typer.Option(help="Thrust, COLUMN:UNIT or =VALUE:UNIT (N, kN, MN).")] = None,
    advance: Annotated[
        str | None, typer.Option(help="Advance speed, COLUMN:UNIT or =VALUE:UNIT (mm/min, m/s).")
    ] = None,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Turn files of measurements into a recording; units and time are stated, never guessed."""
    file, mapped = _split(mapping or [])
    sensor = _stated({"units": units, "gravity": gravity, "frame": frame, "full_scale": full_scale})
    operating = _stated({"speed": speed, "torque": torque, "thrust": thrust, "advance": advance})
    changes = {
        "points": _points(mapped, sensor) or None,
        "operating_point": {key: _quantity(key, str(value)) for key, value in operating.items()} or None,
        "time": time if time in (None, "file") else _column("time", time),
        "rate": rate,
        "start": start,
        "timezone": timezone,
    }
    description = describe(file, _stated(changes))
    imported = _imported(files, description, out)
    found = ImportResult(path=str(out), streams=imported.streams, warnings=tuple(imported.warnings))
    for warning in found.warnings:
        notes.print(f"warning: {warning}", highlight=False)
    if json:
        print_json(found)
    else:
        _print_table(found)


def _imported(files: Sequence[Path], description: Description, out: Path) -> Imported:
    """Import; where the library of a format may crash, in a process of its own."""
    with progress_bar("importing") as bar:
        task = bar.add_task("", total=None)
        if any(file.suffix.lower() in CRASHING for file in files):
            return import_apart(files, description, out)
        return import_recording(files, description, out, lambda samples: bar.advance(task, samples))


def _stated(values: Mapping[str, object]) -> dict[str, object]:
    return {key: value for key, value in values.items() if value is not None}


def _split(mapping: Iterable[str]) -> tuple[str | None, list[str]]:
    """File of the description, if one is named, and the test points mapped to columns."""
    files, mapped = ([given for given in mapping if ("=" in given) == point] for point in (False, True))
    if len(files) > 1:
        raise typer.BadParameter(f"--map: {', '.join(files)}, allowed: one import description")
    return (files[0] if files else None), mapped


def _points(mapped: Iterable[str], sensor: Mapping[str, object]) -> dict[str, dict[str, object]]:
    """Test points that options map to columns, each with what other options state of its sensor."""
    points: dict[str, dict[str, object]] = {}
    for given in mapped:
        name, columns = _point(given)
        if name in points:
            raise typer.BadParameter(f"--map {given}: point {name} a second time, allowed: once")
        points[name] = {"columns": columns, **sensor}
    if sensor and not points:
        unused = ", ".join(f"--{key.replace('_', '-')}" for key in sensor)
        raise typer.BadParameter(f"{unused}: for no {_POINT}, allowed: with --map {_POINT}, or in the description")
    return points


def _point(given: str) -> tuple[str, list[str | None]]:
    name, _, columns = given.partition("=")
    axes = [column.strip() or None for column in _BETWEEN_COLUMNS.split(columns)]
    if len(axes) != _AXES:
        raise typer.BadParameter(f"--map {given}: {len(axes)} columns, allowed: {_POINT}")
    return name.strip(), axes


def _column(key: str, given: str | None) -> dict[str, str]:
    column, separator, unit = (given or "").rpartition(":")
    if not separator:
        raise typer.BadParameter(f"--{key} {given}: no unit, allowed: COLUMN:UNIT")
    return {"column": column, "unit": unit}


def _quantity(key: str, given: str) -> dict[str, str | float]:
    """Column of a quantity, or its constant value."""
    entry = _column(key, given)
    if not entry["column"].startswith("="):
        return {**entry}
    try:
        return {"value": float(entry["column"][1:]), "unit": entry["unit"]}
    except ValueError:
        raise typer.BadParameter(f"--{key} {given}: no number, allowed: COLUMN:UNIT or =VALUE:UNIT") from None


def _print_table(found: ImportResult) -> None:
    results.print(Text(found.path))
    table = narrow_table("", "stream", ">samples", ">rate (Hz)", ">jitter (%)", ">gaps", "not measured")
    for name, stream in found.streams.items():
        rate, jitter = f"{stream.rate_hz:.6g}", f"{100 * stream.jitter:.2g}"
        add_row(table, name, stream.samples, rate, jitter, stream.gaps, " ".join(stream.unmeasured))
    results.print(table)
