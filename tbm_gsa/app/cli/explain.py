"""`tbm-monitor gsa explain`: rock, machine or sensor, and which values of the inputs explain a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tbm_gsa.app.cli.output import (
    JSON_OPTION,
    SEED_OPTION,
    TimeStep,
    add_row,
    narrow_table,
    notes,
    print_json,
    print_sentence,
    progress_bar,
    results,
)
from tbm_gsa.app.cli.workers import Workers, anonymous_main, shown_progress
from tbm_gsa.comparison.results import COMPARISON, ComparisonResult
from tbm_gsa.explanation.result import PAGE_NAME, Explanation, NoChange
from tbm_gsa.reading import read_document

_SHOWN = 8


def explain(
    comparison: Annotated[Path, typer.Argument(help="What `tbm-monitor compare BAG --json` printed, as a file.")],
    out: Annotated[Path, typer.Option(help="Folder: explanation.json, explanation.html.")] = Path("explanation"),
    samples: Annotated[int, typer.Option(min=50, max=100_000, help="Steps of the joint posterior.")] = 600,
    duration: Annotated[
        float, typer.Option(min=2.0, max=3600.0, help="Length of the run that checks what was found (s).")
    ] = 6.0,
    model_error: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Relative error of a band power that the model has in any case.")
    ] = 0.02,
    workers: Workers = 2,
    seed: Annotated[int, SEED_OPTION] = 0,
    time_step: TimeStep = None,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Find what explains a recording: rock, machine (which input, its value) or sensor (which channel), or nothing."""
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
            time_step=time_step,
            model_error=model_error,
            seed=seed,
            workers=workers,
            progress=shown_progress(bar),
        )
        found = find(compared, out, options)
    page = out / PAGE_NAME
    write_explanation_page(found, page)
    if json:
        print_json(found)
    else:
        _print(found)
    notes.print(f"page: {page}", highlight=False)


def _print(found: Explanation) -> None:
    print_sentence(found.sentence())
    results.print()
    headings = ("input", "", ">probability", ">value", ">90 % interval", ">machine's")
    table = narrow_table("Inputs, each as the only change", *headings)
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
    for sentence in found.remarks():
        print_sentence(sentence)
