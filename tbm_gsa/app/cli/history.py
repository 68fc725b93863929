"""`tbm-monitor history`: the windows of all comparisons, their trends, and baselines made of them."""

from __future__ import annotations

import math
import time
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any  # click's contexts: typer may carry a click of its own

import typer
from rich.table import Table
from typer.core import TyperGroup

from tbm_gsa.app.cli.history_options import (
    File,
    Of,
    Since,
    Until,
    machine_file,
    name_or_digest,
    refuse_options,
    span_of,
)
from tbm_gsa.app.cli.output import JSON_OPTION, add_row, narrow_table, notes, print_json, print_sentence, results
from tbm_gsa.history import (
    BY_ORIGIN,
    SOURCE_KINDS,
    Baseline,
    ContextKey,
    EventSelection,
    History,
    HistoryReader,
    Selection,
    default_history,
    make_baseline,
)
from tbm_gsa.history.export import TableKind, table_kind, write_table
from tbm_gsa.history.spread import read_spread
from tbm_gsa.history.summary import (
    BaselineList,
    BaselineSummary,
    HistorySummary,
    ListedState,
    history_summary,
    spread_summary,
    why_nothing,
)
from tbm_gsa.reading import Part
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.files import check_result, write_whole

MOST_LISTED = 5_000_000  # windows, which are held in memory: a week of five points every 2 s

Point = Annotated[str | None, typer.Option(help="This test point only.")]
Origin = Annotated[
    str | None,
    typer.Option(
        "--source", help=f"{', '.join(SOURCE_KINDS)}, or a part of the recording's path or of the node's name."
    ),
]
BaselineName = Annotated[str, typer.Argument(help="Name of the baseline.", show_default=False)]
Owner = Annotated[
    str | None,
    typer.Option(
        "--machine",
        metavar="<name|file>",
        help="Machine that it is of, its name or file; needed where several have one of this name.",
    ),
]
Json = Annotated[bool, JSON_OPTION]


class _BaselineCommands(TyperGroup):
    """Refuses anything but its commands by naming them: `history baseline NAME` once stored a baseline."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Command of the arguments, and what is left of them."""
        if args[0] not in self.commands:
            allowed = ", ".join(self.commands)
            raise InputError(
                f"history baseline {args[0]}: allowed: {allowed}; `history baseline set NAME` stores a baseline"
            )
        return super().resolve_command(ctx, args)


app = typer.Typer(add_completion=False, invoke_without_command=True)
baseline_app = typer.Typer(
    cls=_BaselineCommands,
    add_completion=False,
    no_args_is_help=True,
    context_settings={"ignore_unknown_options": True},  # left to the group, which names the commands
    help="Baselines: the usual error of a machine, which alarms are set against.",
)
app.add_typer(baseline_app, name="baseline")


@app.callback()
def show(
    context: typer.Context,
    history: File = None,
    point: Point = None,
    since: Since = None,
    until: Until = None,
    source: Origin = None,
    machine: Of = None,
    by: Annotated[ContextKey | None, typer.Option(help="Tell the trends apart by this of the context, too.")] = None,
    limit: Annotated[
        int, typer.Option(min=0, max=MOST_LISTED, help="Newest entries to list in the JSON document.")
    ] = 1000,
    html: Annotated[Path | None, typer.Option(help="Write a page with trends to this file.", dir_okay=False)] = None,
    png: Annotated[Path | None, typer.Option(help="Write a picture of the trends.", dir_okay=False)] = None,
    state: Annotated[
        bool, typer.Option("--state", help="Print what the live watch said last of rock and machine.")
    ] = False,
    json: Json = False,
) -> None:
    """List the windows of all comparisons, and plot their trends."""
    if context.invoked_subcommand is not None:
        refuse_options(context, "history")
        return
    check_result(html, "page")
    check_result(png, "PNG picture")
    if html is not None and png is not None and html.resolve() == png.resolve():
        raise InputError(f"--html {html} --png {png}: one file, allowed: a file each")
    chosen = _selection(point, since, until, source, machine)
    plotted = html is not None or png is not None
    with HistoryReader(history or default_history()) as opened:
        opened.check(chosen)
        if plotted:
            shown = _plot(opened, chosen, by, html, png)
        found = shown if plotted and not json else history_summary(opened, chosen, limit, by)
    if json:
        print_json(found)
    else:
        _print(found)
        if state:
            _print_states(found)
    for file in filter(None, (html, png)):
        notes.print(f"written: {file}", highlight=False)


class ExportResult(Part):
    """What was exported: `rows` windows, one a line."""

    path: str
    format: TableKind
    rows: int


@app.command("export")
def export(
    out: Annotated[Path, typer.Argument(help="New table, .csv or .parquet.", dir_okay=False, show_default=False)],
    history: File = None,
    point: Point = None,
    since: Since = None,
    until: Until = None,
    source: Origin = None,
    machine: Of = None,
    json: Json = False,
) -> None:
    """Write windows as a table for other programs, with their context: CSV, or Parquet (extra `export`)."""
    kind = table_kind(out)
    check_result(out, kind)
    chosen = _selection(point, since, until, source, machine)
    with HistoryReader(history or default_history()) as opened:
        opened.check(chosen)
        if opened.span(chosen) is None:
            raise InputError(f"{opened.path}: {why_nothing(opened, chosen)}; nothing to export")
        rows = write_table(out, opened.all_windows(chosen))
    if json:
        print_json(ExportResult(path=str(out), format=kind, rows=rows))
    else:
        results.print(f"{out}: {rows} rows", highlight=False)


@baseline_app.command("list")
def list_baselines(history: File = None, json: Json = False) -> None:
    """List the baselines of a history."""
    with HistoryReader(history or default_history()) as opened:
        found = BaselineList.of(opened)
    if json:
        print_json(found)
        return
    count = len(found.baselines)
    headings = ("baseline", "source", "machine", ">from", ">to", ">points")
    table = narrow_table(f"{found.path}: {count} baseline{'s' * (count != 1)}", *headings)
    for one in found.baselines:
        add_row(table, one.name, one.source or "–", one.machine, one.since[:10], one.until[:10], len(one.points))
    results.print(table)


@baseline_app.command("show")
def show_baseline(name: BaselineName, history: File = None, machine: Owner = None, json: Json = False) -> None:
    """Show mean and scatter of the error per point and axis of a baseline."""
    with HistoryReader(history or default_history()) as opened:
        found = opened.baseline(name, _machine_name(machine))
    _print_baseline(found, json)


@baseline_app.command("set")
def set_baseline(
    name: BaselineName,
    history: File = None,
    point: Point = None,
    since: Since = None,
    until: Until = None,
    source: Origin = None,
    machine: Of = None,
    replace: Annotated[bool, typer.Option("--replace", help="Replace one of the same name.")] = False,
    json: Json = False,
) -> None:
    """Store mean and scatter of the error per point and axis of the chosen windows; alarms are set against them."""
    with History(history or default_history(), create=False) as opened:
        chosen = _selection(point, since, until, source, machine)
        opened.check(chosen)
        made = make_baseline(name, opened.groups(BY_ORIGIN, chosen), time.time_ns())
        opened.store_baseline(made, replace=replace)
    _print_baseline(made, json)


@baseline_app.command("delete")
def delete_baseline(name: BaselineName, history: File = None, machine: Owner = None, json: Json = False) -> None:
    """Delete a baseline, and print what it was; its windows stay."""
    with History(history or default_history(), create=False) as opened:
        deleted = opened.delete_baseline(name, _machine_name(machine))
    _print_baseline(deleted, json)


def _selection(
    point: str | None, since: str | None, until: str | None, source: str | None, machine: str | None
) -> Selection:
    """Build the selection that the options state."""
    return Selection(point, *span_of(since, until), source, name_or_digest(machine))


def _machine_name(machine: str | None) -> str | None:
    """Name of a machine that is given by its name or its file."""
    described = machine_file(machine)
    return machine if described is None else described.name


def _plot(
    history: HistoryReader, selection: Selection, by: ContextKey | None, html: Path | None, png: Path | None
) -> HistorySummary:
    """Write page and picture; what they say of the trends."""
    from tbm_gsa.app.report.history_page import history_page, history_picture  # noqa: PLC0415 - matplotlib loads slowly

    spread = read_spread(history, selection, by)
    if spread is None:
        raise InputError(f"{history.path}: no windows to plot, allowed: options that choose one at least")
    found = spread_summary(history, spread, by)
    events = history.events(EventSelection(spread.first_ns, spread.last_ns + 1))
    if html is not None:
        write_whole(html, history_page(found, spread, events).encode())
    if png is not None:
        write_whole(png, history_picture(found, spread, events))
    return found


def _print(found: HistorySummary) -> None:
    headings = ("test point", "axis", "source", *filter(None, [found.by]), ">count", ">last", ">error", ">latest")
    table = narrow_table(f"{found.path}: {found.total} entries", *headings)
    for row in found.summary:
        error = f"{_percent(row.error_mean)} ± {_percent(row.error_scatter)}"
        numbers = (row.windows, row.last[:10], error, _percent(row.error_latest))
        group = () if row.group is None else (row.group or "–",)
        add_row(table, row.point, row.axis, f"{row.source} {row.machine}", *group, *numbers)
    results.print(table)
    if found.note:
        results.print(found.note, highlight=False)
    for one in found.baselines:
        results.print()
        results.print(_baseline_table(one))


def _print_states(found: HistorySummary) -> None:
    """Print a table of every level of operation that is watched, and its alarm."""
    for level, states in groupby(found.states, key=_level):
        results.print()
        table = narrow_table(level, "part", "=name", ">value", ">90 % interval", ">probability", "since")
        texts = []
        for one in states:
            value, low, high = (_figure(number) for number in (one.value, one.low, one.high))
            since = (one.since or "")[:16]
            add_row(table, one.part, one.name, value, f"{low} to {high}", _figure(one.probability), since)
            texts += [f"{one.text}; since {since}"] if one.text else []
        results.print(table)
        for text in texts:
            print_sentence(text)


def _figure(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "–"


def _level(state: ListedState) -> str:
    point = f"{state.speed_r_min:.3g} r/min, {state.torque_kn_m:.3g} kN·m, {state.thrust_kn:.3g} kN"
    return f"{state.machine} at {point}, after {state.start[:16]} (baseline {state.baseline})"


def _print_baseline(baseline: Baseline, json: bool) -> None:
    found = BaselineSummary.of(baseline)
    if json:
        print_json(found)
    else:
        results.print(_baseline_table(found))


def _baseline_table(found: BaselineSummary) -> Table:
    of = " ".join(filter(None, (found.source, found.machine)))
    title = f"baseline {found.name} of {of}\nwindows from {found.since} to {found.until}"
    table = narrow_table(title, "test point", "axis", ">mean error", ">scatter", ">windows")
    for point, axes in found.points.items():
        for axis, usual in axes.items():
            add_row(table, point, axis, _percent(usual.mean), _percent(usual.scatter), usual.windows)
    return table


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{value:.0%}"
