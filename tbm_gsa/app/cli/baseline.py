"""`tbm-monitor history baseline`: what alarms are set against, listed, shown, stored, deleted."""

from __future__ import annotations

import time
from typing import Annotated, Any

import typer
from rich.table import Table
from typer.core import TyperGroup

from tbm_gsa.app.cli.output import JSON_OPTION, add_row, narrow_table, print_json, results
from tbm_gsa.app.cli.selection import File, Of, Origin, Point, Since, Until, machine_name, selection
from tbm_gsa.history import BY_ORIGIN, History, HistoryReader, default_history, make_baseline
from tbm_gsa.history.summary import baseline_document, baselines_document
from tbm_msgs_py.base.errors import InputError

Name = Annotated[str, typer.Argument(help="Name of the baseline.", show_default=False)]
Owner = Annotated[
    str | None,
    typer.Option(
        "--machine",
        metavar="<name|file>",
        help="Machine that it is of, its name or file; needed where several have one of this name.",
    ),
]


class _Verbs(TyperGroup):
    """Names the commands where something else was typed: `history baseline NAME` once stored a baseline."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command that is named."""
        if args[0] not in self.commands:
            allowed = ", ".join(self.commands)
            raise InputError(
                f"history baseline {args[0]}: allowed: {allowed}; `history baseline set NAME` stores a baseline"
            )
        return super().resolve_command(ctx, args)


app = typer.Typer(
    cls=_Verbs,
    add_completion=False,
    no_args_is_help=True,
    context_settings={"ignore_unknown_options": True},  # left to the group, which names the commands
    help="Baselines: the usual error of a machine, which alarms are set against.",
)


@app.command("list")
def list_(history: File = None, json: Annotated[bool, JSON_OPTION] = False) -> None:
    """List the baselines of a history."""
    with HistoryReader(history or default_history()) as opened:
        document = baselines_document(opened)
    if json:
        print_json(document)
    else:
        results.print(_list_table(document))


@app.command()
def show(name: Name, history: File = None, machine: Owner = None, json: Annotated[bool, JSON_OPTION] = False) -> None:
    """Show mean and scatter of the error per point and axis of a baseline."""
    with HistoryReader(history or default_history()) as opened:
        document = baseline_document(opened.baseline(name, machine_name(machine)))
    _print(document, json)


@app.command("set")
def set_(
    name: Name,
    history: File = None,
    point: Point = None,
    since: Since = None,
    until: Until = None,
    source: Origin = None,
    machine: Of = None,
    replace: Annotated[bool, typer.Option("--replace", help="Take the place of one of the same name.")] = False,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Store mean and scatter of the error per point and axis of the chosen windows; alarms are set against them."""
    with History(history or default_history(), create=False) as opened:
        chosen = selection(point, since, until, source, machine)
        opened.check(chosen)
        groups = opened.groups(BY_ORIGIN, chosen)
        made = make_baseline(name, groups, time.time_ns())
        opened.store_baseline(made, replace=replace)
    _print(baseline_document(made), json)


@app.command()
def delete(name: Name, history: File = None, machine: Owner = None, json: Annotated[bool, JSON_OPTION] = False) -> None:
    """Delete a baseline, and print what it was; its windows stay."""
    with History(history or default_history(), create=False) as opened:
        document = baseline_document(opened.delete_baseline(name, machine_name(machine)))
    _print(document, json)


def _print(document: dict[str, Any], json: bool) -> None:
    if json:
        print_json(document)
    else:
        results.print(baseline_table(document))


def baseline_table(document: dict[str, Any]) -> Table:
    """Mean and scatter per point and axis."""
    of = " ".join(filter(None, (document["source"], document["machine"])))
    title = f"baseline {document['name']} of {of}\nwindows from {document['since']} to {document['until']}"
    table = narrow_table(title, "test point", "axis", ">mean error", ">scatter", ">windows")
    for point, axes in document["points"].items():
        for axis, usual in axes.items():
            add_row(table, point, axis, percent(usual["mean"]), percent(usual["scatter"]), usual["windows"])
    return table


def _list_table(document: dict[str, Any]) -> Table:
    count = len(document["baselines"])
    headings = ("baseline", "source", "machine", ">from", ">to", ">points")
    table = narrow_table(f"{document['path']}: {count} baseline{'s' * (count != 1)}", *headings)
    for one in document["baselines"]:
        dates = (one["since"][:10], one["until"][:10])
        add_row(table, one["name"], one["source"] or "–", one["machine"], *dates, len(one["points"]))
    return table


def percent(value: float | None) -> str:
    """Write a share in percent."""
    return "–" if value is None else f"{value:.0%}"
