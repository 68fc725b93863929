"""`tbm-monitor gsa explain`: which values of the inputs explain a recording."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

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
from tbm_gsa.explanation.forms import COMPARISON, ComparisonForm
from tbm_gsa.explanation.verdict import verdict
from tbm_gsa.reading import read_document

_SHOWN = 8


def explain(
    comparison: Annotated[Path, typer.Argument(help="What `tbm-monitor compare BAG --json` printed, as a file.")],
    out: Annotated[Path, typer.Option(help="Folder: store, explanation.json, explanation.html.")] = Path("explanation"),
    samples: Annotated[int, typer.Option(min=50, help="Simulations.")] = 200,
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

    document = read_document(comparison, ComparisonForm, COMPARISON)
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
        found = find(document, out, options)
    page = out / "explanation.html"
    write_explanation_page(found, page)
    if json:
        print_json(found)
    else:
        _print(found)
    notes.print(f"page: {page}", highlight=False)


def _print(document: dict[str, Any]) -> None:
    headings = ("input", "", ">probability", ">value", ">90 % interval", ">machine's")
    table = narrow_table("What explains the recording, taken as the only change", *headings)
    for row in document["causes"][:_SHOWN]:
        if row["input"] is None:
            add_row(table, "–", row["name"], f"{row['probability']:.3f}")
            continue
        low, high = row["interval"]
        unit = f" {row['unit']}" if row["unit"] else ""
        add_row(
            table,
            row["input"],
            row["name"],
            f"{row['probability']:.3f}",
            f"{row['value']:.3g}{unit}",
            f"{low:.3g} to {high:.3g}",
            f"{row['machine_value']:.3g}",
        )
    results.print(table)
    results.print()
    off = {name: math.exp(value) for name, value in document["misfit"].items()}
    print_sentence(
        f"{len(document['statistics'])} statistics: the model is off by a factor of {off['model']:.3g} (RMS), with the "
        f"first input changed by {off['predicted']:.3g} as predicted and {off['checked']:.3g} in a run of its own"
    )
    print_sentence(verdict(document))
