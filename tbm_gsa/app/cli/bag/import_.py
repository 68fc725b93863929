"""`tbm-monitor bag import`: measurements of other systems into a recording."""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text

from tbm_gsa.app.cli.output import JSON_OPTION, add_row, narrow_table, notes, print_json, progress_bar, results
from tbm_msgs_py.importing import Imported, describe, import_recording
from tbm_msgs_py.importing.apart import CRASHING, import_apart

_POINT = "POINT=X,Y,Z"
_AXES = 3
_BETWEEN_COLUMNS = re.compile(r",(?![^(]*\))")  # not the commas of a MATLAB index, a(:,1)


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
    described = [given for given in mapping or [] if "=" not in given]
    if len(described) > 1:
        raise typer.BadParameter(f"--map: {', '.join(described)}, allowed: one import description")
    sensor = {"units": units, "gravity": gravity, "frame": frame, "full_scale": full_scale}
    points = {}
    for given in mapping or []:
        if "=" in given:
            name, columns = _point(given)
            if name in points:
                raise typer.BadParameter(f"--map {given}: point {name} a second time, allowed: once")
            points[name] = {"columns": columns, **_stated(sensor)}
    if not points and _stated(sensor):
        unused = ", ".join(f"--{key.replace('_', '-')}" for key in _stated(sensor))
        raise typer.BadParameter(f"{unused}: for no {_POINT}, allowed: with --map {_POINT}, or in the description")
    operating = {"speed": speed, "torque": torque, "thrust": thrust, "advance": advance}
    changes = {
        "points": points or None,
        "operating_point": {key: _quantity(key, value) for key, value in _stated(operating).items()} or None,
        "time": time if time in (None, "file") else _column("time", time),
        "rate": rate,
        "start": start,
        "timezone": timezone,
    }
    description = describe(described[0] if described else None, _stated(changes))
    with progress_bar("importing") as bar:
        task = bar.add_task("", total=None)
        if any(file.suffix.lower() in CRASHING for file in files):
            imported = import_apart(files, description, out)
        else:
            imported = import_recording(files, description, out, lambda samples: bar.advance(task, samples))
    for warning in imported.warnings:
        notes.print(f"warning: {warning}", highlight=False)
    document = import_document(out, imported)
    if json:
        print_json(document)
    else:
        _print_table(document)


def import_document(out: Path, imported: Imported) -> dict[str, Any]:
    """Gather what `bag import --json` prints.

    Returns
    -------
    dict
        ``path``, ``streams{point or operating_point: {topic, samples, rate_hz, jitter, gaps, restarts, unmeasured}}``
        and ``warnings``.
    """
    streams = {name: asdict(stream) for name, stream in imported.streams.items()}
    return {"path": str(out), "streams": streams, "warnings": imported.warnings}


def _stated(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}


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


def _print_table(document: dict[str, Any]) -> None:
    results.print(Text(document["path"]))
    table = narrow_table("", "stream", ">samples", ">rate (Hz)", ">jitter (%)", ">gaps", "not measured")
    for name, stream in document["streams"].items():
        rate, jitter = f"{stream['rate_hz']:.6g}", f"{100 * stream['jitter']:.2g}"
        unmeasured = " ".join(stream["unmeasured"])
        add_row(table, name, stream["samples"], rate, jitter, stream["gaps"], unmeasured)
    results.print(table)
