"""`tbm-monitor compare`: a recording against the model."""

from __future__ import annotations

import math
import sqlite3
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from tbm_gsa.app.cli.drive_tables import print_drives
from tbm_gsa.app.cli.history_options import HISTORY_HELP
from tbm_gsa.app.cli.output import (
    DEFAULT_MACHINE,
    JSON_OPTION,
    SEED_OPTION,
    MachineOption,
    TimeStep,
    add_row,
    narrow_table,
    notes,
    print_json,
    progress_bar,
    results,
    staged_progress,
)
from tbm_gsa.app.cli.shipped import MAPPING_OPTION, RECORDING_ARGUMENT, recording_path
from tbm_gsa.comparison.bands import parse_bands
from tbm_gsa.comparison.offline import highest_hz
from tbm_gsa.comparison.results import ComparisonResult
from tbm_gsa.comparison.workflow import RecordingComparison, compare_recording
from tbm_gsa.history import (
    History,
    HistoryError,
    SourceKind,
    WindowSource,
    check_history,
    default_history,
    recording_entries,
)
from tbm_gsa.history.recorded_context import recorded_contexts
from tbm_gsa.signals.settings import Settings
from tbm_msgs_py.bags.metadata import is_synthetic
from tbm_msgs_py.base.files import check_result, write_whole
from tbm_msgs_py.recordings.recording_health import COUNTS


def compare(
    bag: Annotated[Path, RECORDING_ARGUMENT],
    machine: MachineOption = DEFAULT_MACHINE,
    mapping: Annotated[Path | None, MAPPING_OPTION] = None,
    html: Annotated[Path | None, typer.Option(help="Write a page with figures to this file.", dir_okay=False)] = None,
    model_duration: Annotated[
        float, typer.Option(help="Length of the model run at each level of operation (s), 1 to 3600.")
    ] = 60.0,
    window: Annotated[float, typer.Option(help="Length of a window (s), 0.01 to 86400.")] = 2.0,
    begin: Annotated[float, typer.Option(min=0.0, help="Begin of the stretch that is compared (s).")] = 0.0,
    end: Annotated[float | None, typer.Option(help="End of it (s); default: that of the recording.")] = None,
    bands: Annotated[
        str | None,
        typer.Option(help="Bands in Hz, as 0.5-20,60-120; default: those of the machine's loads and gear meshes."),
    ] = None,
    high_hz: Annotated[
        float | None,
        typer.Option("--high-hz", help="Upper limit of the compared band (Hz); default: 1000, or 0.4 of a lower rate."),
    ] = None,
    seed: Annotated[int, SEED_OPTION] = 0,
    time_step: TimeStep = None,
    history: Annotated[Path | None, typer.Option(help=HISTORY_HELP, dir_okay=False)] = None,
    keep: Annotated[
        bool | None,
        typer.Option(
            "--keep/--no-keep",
            help="Put the windows into the history; default: yes, unless the recording is synthetic.",
        ),
    ] = None,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Compare a recording with the model at every test point."""
    bag = recording_path(bag)
    check_result(html, "page")
    synthetic = is_synthetic(bag)
    kept = not synthetic if keep is None else keep
    settings = Settings(window_s=window, high_hz=high_hz, spectrogram=html is not None)
    if bands is not None:
        settings = replace(settings, bands=parse_bands(bands, highest_hz(settings)))
    if kept and history is not None:
        check_history(history)  # a bad one is refused before the work
    with progress_bar("comparing") as bar:
        compared = compare_recording(
            bag,
            machine,
            mapping,
            model_duration,
            seed,
            settings,
            progress=staged_progress(bar),
            span=None if begin == 0.0 and end is None else (begin, math.inf if end is None else end),
            time_step=time_step,
        )
    if html is not None:
        from tbm_gsa.app.report.compare_page import compare_page  # noqa: PLC0415 - matplotlib takes its time

        write_whole(html, compare_page(compared).encode())
    if kept:
        _keep(compared, "synthetic" if synthetic else "offline", history)
    elif keep is None:
        notes.print("not put into the history: the recording is synthetic, --keep puts it there", highlight=False)
    result = compared.result
    if json:
        print_json(result)
    else:
        print_tables(result)
    for point, reason in result.skipped.items():
        notes.print(Text(f"test point {point!r} not compared: {reason}"))
    for line in (*map(str, result.left_out), *result.doubts):
        notes.print(Text(line))
    if html is not None:
        notes.print(f"page: {html}", highlight=False)


def _keep(compared: RecordingComparison, kind: SourceKind, path: Path | None) -> None:
    """Put the windows into the history; a default one that cannot be used spoils no comparison."""
    result, recording = compared.result, compared.result.recording
    source = WindowSource(kind, recording.path, recording.sha256, result.machine, result.machine_file.sha256)
    contexts, problem = recorded_contexts(Path(recording.path))
    if problem:
        notes.print(Text(problem))
    try:
        with History(path or default_history()) as history:
            history.add(source, recording_entries(result, compared.starts_ns), contexts.at)
    except (HistoryError, sqlite3.Error) as error:
        if path is not None:
            raise
        notes.print(f"not put into the history: {error}", highlight=False)


def print_tables(result: ComparisonResult) -> None:
    """Print the axial accelerations, the levels, the drives, and the state of the recording."""
    if result.points:
        results.print(_axial_table(result))
    if len(result.dwells) > 1:
        results.print(_level_table(result))
    if result.drives is not None:
        print_drives(result.drives)
    faulty = _fault_table(result)
    if faulty.row_count:
        results.print(faulty)
    results.print()
    recording = result.recording
    truncated = ", truncated" if recording.truncated else ""
    results.print(
        f"{recording.messages} messages over {recording.duration:.3f} s, {recording.lost} lost{truncated}; "
        f"model {result.model_duration:g} s a level, seed {result.seed}",
        highlight=False,
    )
    for line in _sources(result):
        results.print(Text(line))


def _sources(result: ComparisonResult) -> list[str]:
    """Files, topics and clocks that the numbers come from."""
    machine = f"machine: {result.machine} ({result.machine_file.origin}), SHA-256 {result.machine_file.sha256[:12]}"
    own = result.operating_point.source == "machine"
    found = [f"{line}: the machine's own" if own and "operating" in line else line for line in result.sources.lines()]
    return [*found, *([f"sensors off their node: {result.off_node}"] if result.offsets else []), machine]


def _axial_table(result: ComparisonResult) -> Table:
    synthetic = " (synthetic)" if result.synthetic else ""
    title = f"axial acceleration, RMS: {result.recording.path}{synthetic} against {result.machine}"
    headings = ("test point", ">node", ">predicted, g", ">measured, g", ">error", ">95 %", ">coverage")
    table = narrow_table(title, *headings)
    for row in result.axial_rows:
        axis = result.points[row.point]["x"]
        interval = axis.intervals.relative_error
        reach = "–" if interval is None else f"{interval[0]:.0%}–{interval[1]:.0%}"
        levels = (_level(row.predicted_g), _level(row.measured_g))
        error = "–" if row.relative_error is None else f"{row.relative_error:.0%}"
        share = "–" if axis.coverage is None else f"{axis.coverage:.3%}"
        cells = (str(row.node), *levels, error, reach, share)
        add_row(table, row.point, *cells)
    return table


def _level(value: float | None) -> str:
    """Three digits of a level, however low."""
    return "–" if value is None else format(value, ".3f" if value >= 0.1 else ".3g")


def _level_table(result: ComparisonResult) -> Table:
    table = narrow_table("\nlevels of operation", ">level", ">r/min", ">kN·m", ">kN", ">held, s", "found")
    for number, level in enumerate(result.levels, start=1):
        values = (level.speed_r_min, level.torque_kn_m, level.thrust_kn, level.seconds)
        add_row(table, number, *(f"{value:.6g}" for value in values), level.note)
    for where, seconds in result.not_at_a_level.items():
        add_row(table, "–", "", "", "", f"{seconds:.6g}", f"{where}: left out")
    return table


def _fault_table(result: ComparisonResult) -> Table:
    """Points whose data have a fault, and which."""
    table = narrow_table("\nfaults of the data", "test point", "faults")
    for name, point in result.recording.points.items():
        texts = [f"gaps: {len(point.gaps)}, longest {point.longest_gap:.3f} s"] if point.gaps else []
        texts += [f"stuck along {text}" for text in point.stuck_texts]
        counts = {fault.replace("_", " "): getattr(point, fault) for fault in COUNTS}
        texts += [f"{count} {fault}" for fault, count in counts.items() if count]
        if texts:
            add_row(table, name, ", ".join(texts))
    return table
