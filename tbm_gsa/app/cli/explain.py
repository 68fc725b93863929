"""`tbm-monitor gsa explain`: which values of the inputs explain a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tbm_gsa.app.cli.output import (
    JSON_OPTION,
    SEED_OPTION,
    add_row,
    narrow_table,
    notes,
    print_json,
    print_sentence,
    progress_bar,
    results,
)
from tbm_gsa.app.cli.workers import Scheduler, Workers, anonymous_main, shown_progress
from tbm_gsa.comparison.results import COMPARISON, ComparisonResult
from tbm_gsa.explanation.result import Explanation, NoChange
from tbm_gsa.reading import read_document

_SHOWN = 8


def explain(
    comparison: Annotated[Path, typer.Argument(help="What `tbm-monitor compare BAG --json` printed, as a file.")],
    out: Annotated[Path, typer.Option(help="Folder: store, explanation.json, explanation.html.")] = Path("explanation"),
    samples: Annotated[int, typer.Option(min=50, max=1_000_000, help="Simulations.")] = 200,
    duration: Annotated[float, typer.Option(min=2.0, max=3600.0, help="Length of a simulation (s).")] = 6.0,
    model_error: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Relative error of a statistic that the model has in any case.")
    ] = 0.05,
    workers: Workers = 2,
    scheduler: Scheduler = None,
    seed: Annotated[int, SEED_OPTION] = 0,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Find the inputs that explain why a recording and the model part; an unfinished campaign of the folder goes on."""
    # What they import takes a second, and other commands need none of it.
    from tbm_gsa.app.report.explanation_page import write_explanation_page  # noqa: PLC0415
    from tbm_gsa.explanation.workflow import ExplainOptions  # noqa: PLC0415
    from tbm_gsa.explanation.workflow import explain as find  # noqa: PLC0415

    compared = read_document(comparison, ComparisonResult, COMPARISON)
    out.mkdir(parents=True, exist_ok=True)
    with progress_bar() as bar, anonymous_main():
        options = ExplainOptions(
            samples=samples,
            duration=duration,
            model_error=model_error,
            seed=seed,
            workers=workers,
            scheduler=scheduler,
            progress=shown_progress(bar),
        )
        found = find(compared, out, options)
    page = out / "explanation.html"
    write_explanation_page(found, page)
    if json:
        print_json(found)
    else:
        _print(found)
    notes.print(f"page: {page}", highlight=False)


def _print(found: Explanation) -> None:
    if found.failure_summary is not None:
        print_sentence(f"{found.failure_summary.text()}; they are left out")
    headings = ("input", "", ">probability", ">value", ">90 % interval", ">machine's")
    table = narrow_table("Causes, each taken as the only change", *headings)
    for cause in found.causes[:_SHOWN]:
        probability = f"{cause.probability:.3f}"
        if isinstance(cause, NoChange):
            add_row(table, "–", cause.name, probability)
            continue
        value, (low, high) = f"{cause.value:.3g} {cause.unit}".rstrip(), cause.interval
        interval = f"{low:.3g} to {high:.3g}"
        add_row(table, cause.input, cause.name, probability, value, interval, f"{cause.machine_value:.3g}")
    results.print(table)
    results.print()
    off = found.off_by()
    print_sentence(
        f"{len(found.statistics)} statistics: the model is off by a factor of {off.model:.3g} (RMS), with the first "
        f"input changed by {off.predicted:.3g} as predicted and {off.checked:.3g} in a run of its own"
    )
    print_sentence(found.verdict())
