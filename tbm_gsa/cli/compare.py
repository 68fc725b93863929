"""`tbm-monitor compare`: a recording against the model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from tbm_gsa.cli.output import JSON_OPTION, MACHINE_OPTION, SEED_OPTION, notes, print_json, progress_bar, results
from tbm_gsa.comparison.document import axial_rows
from tbm_gsa.comparison.offline import Settings
from tbm_gsa.comparison.workflow import compare_recording
from tbm_gsa.report.compare_page import write_page


def compare(
    bag: Annotated[Path, typer.Argument(help="Recording: a rosbag2 folder or an .mcap file.")],
    machine: Annotated[str, MACHINE_OPTION] = "dz101",
    mapping: Annotated[
        Path | None, typer.Option(help="Mapping of topics to test points; default: mapping.yaml in or beside the bag.")
    ] = None,
    html: Annotated[Path | None, typer.Option(help="Write a page with figures to this file.", dir_okay=False)] = None,
    model_duration: Annotated[float, typer.Option(help="Length of the model run (s).")] = 60.0,
    window: Annotated[float, typer.Option(help="Length of a window (s).")] = 2.0,
    seed: Annotated[int, SEED_OPTION] = 0,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Compare a recording with the model at every test point."""
    if html is not None and not html.parent.is_dir():
        raise ValueError(f"{html}: no folder {html.parent}, allowed: a file in a folder that is there")
    settings = Settings(window_s=window)
    with progress_bar("running the model") as bar:
        task = bar.add_task("", total=1.0)
        result = compare_recording(
            bag,
            machine,
            mapping,
            model_duration,
            seed,
            settings,
            progress=lambda share: bar.update(task, completed=share),
        )
    if html is not None:
        write_page(result, html)
    if json:
        print_json(result.document)
    else:
        _print_table(result.document)
    for point, reason in result.document["skipped"].items():
        notes.print(f"test point {point!r} not compared: {reason}", markup=False, highlight=False)
    if html is not None:
        notes.print(f"page: {html}", markup=False, highlight=False)


def _print_table(document: dict[str, Any]) -> None:
    """Print the axial accelerations as the paper's Table 2 has them, and the state of the recording."""
    recording = document["recording"]
    synthetic = " (synthetic)" if document.get("synthetic") else ""
    table = Table(title=Text(f"axial acceleration, RMS: {recording['path']}{synthetic} against {document['machine']}"))
    for heading in ("test point", "node", "predicted, g", "measured, g", "relative error", "coverage"):
        table.add_column(heading, justify="left" if heading == "test point" else "right")
    for row in axial_rows(document):
        error = "–" if row.relative_error is None else f"{row.relative_error:.0%}"
        coverage = f"{document['points'][row.point]['x']['coverage']:.1%}"
        cells = (str(row.node), f"{row.predicted_g:.3f}", f"{row.measured_g:.3f}", error, coverage)
        table.add_row(Text(row.point), *cells)
    results.print(table)
    truncated = ", truncated" if recording["truncated"] else ""
    results.print(
        f"{recording['messages']} messages over {recording['duration']:.1f} s, {recording['lost']} lost{truncated}; "
        f"model {document['model_duration']:g} s, seed {document['seed']}",
        highlight=False,
    )
