"""`tbm-monitor history`: the windows of all comparisons, their trends, and baselines made of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from tbm_gsa.app.cli import baseline
from tbm_gsa.app.cli.baseline import baseline_table, percent
from tbm_gsa.app.cli.output import JSON_OPTION, add_row, named, narrow_table, notes, print_json, results
from tbm_gsa.app.cli.selection import File, Of, Origin, Point, Since, Until, selection
from tbm_gsa.history import Baseline, HistoryReader, Selection, Window, default_history
from tbm_gsa.history.summary import history_document
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.files import check_result, write_whole

app = typer.Typer(add_completion=False, invoke_without_command=True)
app.add_typer(baseline.app, name="baseline")

MOST_PLOTTED = 5_000_000  # windows, which are held in memory: a week of five points every 2 s


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
        _refuse_options(context)
        return
    check_result(html, "page")
    check_result(png, "PNG picture")
    chosen = selection(point, since, until, source, machine)
    plotted = html is not None or png is not None
    with HistoryReader(history or default_history()) as opened:
        opened.check(chosen)
        document = history_document(opened, chosen, limit)
        windows, baselines = _to_plot(opened, chosen) if plotted else ([], [])
    if plotted:
        _plot(windows, baselines, opened.path, html, png)
    if json:
        print_json(document)
    else:
        _print_tables(document)
    for file in filter(None, (html, png)):
        notes.print(f"written: {file}", highlight=False)


def _refuse_options(context: typer.Context) -> None:
    """Refuse options of the list before another command, which would not see them."""
    for name in context.params:
        if named(context, name):
            raise InputError(f"history --{name} … {context.invoked_subcommand}: allowed: options behind the command")


def _to_plot(history: HistoryReader, selection: Selection) -> tuple[list[Window], list[Baseline]]:
    """Windows, and the baselines of their machines."""
    count = history.count(selection)
    if not 1 <= count <= MOST_PLOTTED:
        number = count or "no"
        raise InputError(f"{history.path}: {number} windows to plot, allowed: options that choose 1 to {MOST_PLOTTED}")
    windows = history.windows(selection)
    machines = {window.source.machine for window in windows}
    return windows, [one for one in history.baselines() if one.machine in machines]


def _plot(windows: list[Window], baselines: list[Baseline], path: Path, html: Path | None, png: Path | None) -> None:
    from tbm_gsa.app.report.history_page import history_page, history_picture  # noqa: PLC0415 - matplotlib takes its time

    if html is not None:
        write_whole(html, history_page(path, windows, baselines).encode())
    if png is not None:
        write_whole(png, history_picture(windows, baselines))


def _print_tables(document: dict[str, Any]) -> None:
    headings = ("test point", "axis", "source", ">count", ">last", ">error", ">latest")
    table = narrow_table(f"{document['path']}: {document['total']} entries", *headings)
    for row in document["summary"]:
        texts = (row["point"], row["axis"], f"{row['source']} {row['machine']}")
        error = f"{percent(row['error_mean'])} ± {percent(row['error_scatter'])}"
        add_row(table, *texts, row["windows"], row["last"][:10], error, percent(row["error_latest"]))
    results.print(table)
    for one in document["baselines"]:
        results.print()
        results.print(baseline_table(one))
