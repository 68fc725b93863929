"""`tbm-monitor reproduce`: every table and figure of the paper beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tbm_gsa.app.cli.output import (
    DEFAULT_MACHINE,
    JSON_OPTION,
    SEED_OPTION,
    MachineOption,
    add_row,
    narrow_table,
    notes,
    print_json,
    progress_bar,
    results,
    staged_progress,
)
from tbm_gsa.app.cli.shipped import shipped_bag
from tbm_gsa.app.cli.workers import Workers, anonymous_main
from tbm_msgs_py.base.files import write_json, write_whole

if TYPE_CHECKING:
    from tbm_gsa.paper.reproduction.result import ReproductionResult, Value

DOCUMENT_NAME = "reproduction.json"
PAGE_NAME = "reproduction.html"


def reproduce(
    out: Annotated[
        Path, typer.Option(help=f"Folder: {PAGE_NAME}, {DOCUMENT_NAME}, a campaign for each reading of the dampings.")
    ] = Path("reproduction"),
    machine: MachineOption = DEFAULT_MACHINE,
    workers: Workers = 2,
    seed: Annotated[int, SEED_OPTION] = 0,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Reproduce Tables 1 to 6 and Figures 2 to 15 of the paper, each with a verdict; an interrupted run goes on."""
    # What they import takes a second, and other commands need none of it.
    from tbm_gsa.app.report.gsa_page import write_study_report  # noqa: PLC0415
    from tbm_gsa.app.report.reproduction_page import reproduction_page  # noqa: PLC0415
    from tbm_gsa.paper.reproduction.workflow import reproduce as find  # noqa: PLC0415

    with progress_bar("reproducing") as bar, anonymous_main():
        progress = staged_progress(bar)
        found = find(
            machine,
            out,
            shipped_bag(),
            seed=seed,
            workers=workers,
            report=write_study_report,
            progress=progress,
        )
        progress("page", None)
        write_whole(out / PAGE_NAME, reproduction_page(found).encode())
    write_json(out / DOCUMENT_NAME, found.result.model_dump())
    if json:
        print_json(found.result)
    else:
        _print(found.result)
    notes.print(f"page: {out / PAGE_NAME}", highlight=False)


def _print(result: ReproductionResult) -> None:
    """Print the verdicts and what differs."""
    table = narrow_table("What differs from the paper", "", "what", "paper", "ours")
    for row in result.differing:
        add_row(table, row.source, row.what, _text(row.paper), _text(row.ours))
    results.print(table)
    results.print()
    counts = ", ".join(f"{count} {name}" for name, count in result.verdicts.items())
    results.print(f"{counts}; {result.seconds['total']:.0f} s", highlight=False)
    results.print(f"loads of a campaign: {result.loads}", highlight=False)


def _text(value: Value) -> str:
    return "–" if value is None else value if isinstance(value, str) else f"{value:.4g}"
