"""`tbm-monitor history`: the windows of all comparisons, their trends, and baselines made of them."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from tbm_gsa.cli.output import JSON_OPTION, notes, print_json, results
from tbm_gsa.errors import InputError
from tbm_gsa.files import check_folder, write_whole
from tbm_gsa.history import BY_MACHINE, History, Selection, default_history, make_baseline
from tbm_gsa.history.summary import baseline_document, history_document

app = typer.Typer(add_completion=False, invoke_without_command=True)

HISTORY_HELP = "History file; default: $TBM_HISTORY, else tbm_monitor/history.sqlite in the user's data folder."
MOST_PLOTTED = 5_000_000  # windows, which are held in memory: a week of five points every 2 s
_UNITS = {"s": 1, "m": 60, "h": 3600, "d": 86400}

File = Annotated[Path | None, typer.Option("--history", help=HISTORY_HELP, dir_okay=False)]
Point = Annotated[str | None, typer.Option(help="This test point only.")]
Since = Annotated[
    str | None, typer.Option(help="From this time on: ISO 8601 (UTC unless it says), or 30m, 12h, 7d before now.")
]
Until = Annotated[str | None, typer.Option(help="Before this time, written like --since.")]
Origin = Annotated[str | None, typer.Option("--source", help="live, offline, or a part of the recording's path.")]
Of = Annotated[str | None, typer.Option("--machine", help="Windows of this machine only, by its name.")]


@dataclass(frozen=True)
class _Chosen:
    """What the options of the list say; the baseline command takes its own."""

    file: Path
    selection: Selection


@app.callback()
def show(
    context: typer.Context,
    history: File = None,
    point: Point = None,
    since: Since = None,
    until: Until = None,
    source: Origin = None,
    machine: Of = None,
    limit: Annotated[int, typer.Option(min=0, help="Newest entries to list in the JSON document.")] = 1000,
    html: Annotated[Path | None, typer.Option(help="Write a page with trends to this file.", dir_okay=False)] = None,
    png: Annotated[Path | None, typer.Option(help="Write a picture of the trends.", dir_okay=False)] = None,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """List the windows of all comparisons, and plot their trends."""
    if context.invoked_subcommand is not None:
        return
    for file in (html, png):
        check_folder(file)
    selection = _selection(point, since, until, source, machine)
    with History(history or default_history(), create=False) as opened:
        document = history_document(opened, selection, limit)
        if html is not None or png is not None:
            _plot(opened, selection, html, png)
    if json:
        print_json(document)
    else:
        _print_tables(document)
    for file in filter(None, (html, png)):
        notes.print(f"written: {file}", markup=False, highlight=False)


@app.command()
def baseline(
    name: Annotated[
        str, typer.Argument(help="Name of the baseline; one of the same machine is replaced.")
    ] = "commissioning",
    history: File = None,
    point: Point = None,
    since: Since = None,
    until: Until = None,
    source: Origin = None,
    machine: Of = None,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Store mean and scatter of the error per point and axis of the chosen windows; alarms are set against them."""
    with History(history or default_history(), create=False) as opened:
        groups = opened.groups(BY_MACHINE, _selection(point, since, until, source, machine))
        made = make_baseline(name, groups, time.time_ns())
        opened.store_baseline(made)
    document = baseline_document(made)
    if json:
        print_json(document)
    else:
        results.print(_baseline_table(document))


def _selection(
    point: str | None, since: str | None, until: str | None, source: str | None, machine: str | None
) -> Selection:
    return Selection(point, _stamp("--since", since), _stamp("--until", until), source, machine)


def _stamp(option: str, text: str | None) -> int | None:
    """Time in ns since the epoch."""
    if text is None:
        return None
    ago = re.fullmatch(r"(\d{1,6})([smhd])", text)
    if ago:
        return time.time_ns() - int(ago[1]) * _UNITS[ago[2]] * 1_000_000_000
    try:
        moment = datetime.fromisoformat(text)
        return round((moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp() * 1e9)
    except (ValueError, OverflowError):
        raise InputError(f"{option} {text}: allowed: ISO 8601 such as 2026-01-31T12:00, or 30m, 12h, 7d") from None


def _plot(history: History, selection: Selection, html: Path | None, png: Path | None) -> None:
    from tbm_gsa.report.history_page import history_page, history_picture  # noqa: PLC0415 - matplotlib takes its time

    count = history.count(selection)
    if not 1 <= count <= MOST_PLOTTED:
        number = count or "no"
        raise InputError(f"{history.path}: {number} windows to plot, allowed: options that choose 1 to {MOST_PLOTTED}")
    windows = history.windows(selection)
    machines = {window.source.machine for window in windows}
    baselines = [one for one in history.baselines() if one.machine in machines]
    if html is not None:
        write_whole(html, history_page(history.path, windows, baselines).encode())
    if png is not None:
        write_whole(png, history_picture(windows, baselines))


def _print_tables(document: dict[str, Any]) -> None:
    table = Table(title=Text(f"{document['path']}: {document['total']} entries"))
    for heading in ("test point", "axis", "source", "count", "last", "error", "latest"):
        right = heading in ("count", "error", "latest")
        table.add_column(heading, justify="right" if right else "left", no_wrap=heading in ("source", "last"))
    for row in document["summary"]:
        texts = [Text(text) for text in (row["point"], row["axis"], f"{row['source']} {row['machine']}")]
        error = f"{_percent(row['error_mean'])} ± {_percent(row['error_scatter'])}"
        table.add_row(*texts, str(row["windows"]), row["last"][:10], error, _percent(row["error_latest"]))
    results.print(table)
    for one in document["baselines"]:
        results.print(_baseline_table(one))


def _baseline_table(document: dict[str, Any]) -> Table:
    table = Table(
        title=Text(f"baseline {document['name']} of {document['machine']}: {document['since']} to {document['until']}")
    )
    for heading in ("test point", "axis", "mean error", "scatter", "windows"):
        table.add_column(heading, justify="left" if heading in ("test point", "axis") else "right")
    for point, axes in document["points"].items():
        for axis, usual in axes.items():
            table.add_row(Text(point), axis, _percent(usual["mean"]), _percent(usual["scatter"]), str(usual["windows"]))
    return table


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{value:.0%}"
