"""`tbm-monitor events`: what happened at the machine, and that somebody has seen it."""

from __future__ import annotations

import time
from typing import Annotated, Literal

import typer

from tbm_gsa.app.cli.history_options import File, Of, Since, Until, name_or_digest, refuse_options, span_of
from tbm_gsa.app.cli.output import JSON_OPTION, add_row, narrow_table, print_json, print_sentence, results
from tbm_gsa.history import EventKind, EventSelection, History, HistoryReader, default_history
from tbm_gsa.history.event_list import NEWEST, EventList, ListedEvent

MOST_LISTED = 1_000_000

Json = Annotated[bool, JSON_OPTION]
app = typer.Typer(add_completion=False, invoke_without_command=True)


@app.callback()
def show(
    context: typer.Context,
    history: File = None,
    since: Since = None,
    until: Until = None,
    kind: Annotated[EventKind | None, typer.Option(help="Events of this kind only.")] = None,
    point: Annotated[str | None, typer.Option(help="Events at this test point only.")] = None,
    machine: Of = None,
    source: Annotated[
        Literal["live", "replay"] | None, typer.Option(help="Events of the machine, or of recordings that were played.")
    ] = None,
    standing: Annotated[bool, typer.Option("--standing", help="Only events that have not ended.")] = False,
    unseen: Annotated[bool, typer.Option("--open", help="Only events that nobody has acknowledged.")] = False,
    limit: Annotated[int, typer.Option(min=1, max=MOST_LISTED, help="Newest events to list.")] = NEWEST,
    json: Json = False,
) -> None:
    """List alarms, changes of the rock and faults of sensors, the newest last."""
    if context.invoked_subcommand is not None:
        refuse_options(context, "events")
        return
    span, of = span_of(since, until), name_or_digest(machine)
    with HistoryReader(history or default_history()) as opened:
        found = EventList.of(
            opened, EventSelection(*span, kind, point, of, source=source, standing=standing, open=unseen), limit
        )
    if json:
        print_json(found)
        return
    count = len(found.events)
    title = f"{found.path}: {count} event{'s' * (count != 1)}"
    table = narrow_table(title, ">id", "begin", ">end", "kind", "test point", "seen by")
    for one in found.events:
        add_row(
            table,
            one.id,
            one.begin[:19],
            one.end[:19] if one.end else "stands",
            one.kind,
            one.point or "–",
            one.acknowledged_by or "–",
        )
    results.print(table)
    for one in found.events:
        _print_text(one)


@app.command("ack")
def acknowledge(
    numbers: Annotated[list[int], typer.Argument(metavar="ID…", help="Numbers of the events.", show_default=False)],
    by: Annotated[str, typer.Option(help="Who has seen them.")],
    comment: Annotated[str, typer.Option(help="What was found or done.")] = "",
    history: File = None,
    replace: Annotated[bool, typer.Option("--replace", help="Also events that are acknowledged.")] = False,
    json: Json = False,
) -> None:
    """Acknowledge events: by whom, when, and what was found or done."""
    with History(history or default_history(), create=False) as opened:
        seen = opened.acknowledge(numbers, by, comment, time.time_ns(), replace=replace)
        found = EventList(path=str(opened.path), events=tuple(map(ListedEvent.of, seen)))
    if json:
        print_json(found)
        return
    for one in found.events:
        _print_text(one)


def _print_text(event: ListedEvent) -> None:
    seen = f"; seen by {event.acknowledged_by}: {event.comment}" if event.acknowledged_by else ""
    print_sentence(f"{event.id}: {event.text}{seen}")
    if event.snapshot:
        results.print(f"   {event.snapshot}", highlight=False)
