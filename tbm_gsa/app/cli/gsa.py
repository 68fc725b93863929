"""`tbm-monitor gsa`: the surrogate-based global sensitivity analysis."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from tbm_gsa.app.cli.explain import explain
from tbm_gsa.app.cli.gsa_planning import (
    MOST_SAMPLES,
    CommonLoads,
    Design,
    Duration,
    HighHz,
    Inputs,
    Outputs,
    Samples,
    TestSamples,
    planned_study,
)
from tbm_gsa.app.cli.gsa_shards import merge, shard
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
    print_sentence,
    progress_bar,
    ranked_inputs,
    results,
)
from tbm_gsa.app.cli.workers import Scheduler, Workers, anonymous_main, shown_progress
from tbm_gsa.sensitivity.results import NOT_DETERMINED, REPORT_NAME, STRONGEST, StudyResult
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_gsa.sensitivity.study.failures import REFUSED
from tbm_gsa.sensitivity.study.problem import StudyProblem

if TYPE_CHECKING:
    from tbm_gsa.sensitivity.study.run import FinishedStudy, StudyOptions

app = typer.Typer(add_completion=False, no_args_is_help=True)

Folder = Annotated[Path, typer.Option("--out", help="Folder of the study: store, result.json, report.html.")]
Methods = Annotated[
    list[str] | None,
    typer.Option("--method", help="Surrogate to choose from: svr, krg, rbf or prs; may be repeated; default: all."),
]
AllowFailures = Annotated[
    bool,
    typer.Option(
        "--allow-failures", help=f"Analyse what is left where more than {REFUSED:.0%} of the simulations failed."
    ),
]
Quick = Annotated[
    bool,
    typer.Option(
        "--quick", help="Indices of the best surrogates only: no second order, convergence, paths, Morris, FAST."
    ),
]


@app.command()
def run(
    out: Folder = Path("gsa"),
    samples: Samples = 200,
    test: TestSamples = 20,
    design: Design = "lhs",
    machine: MachineOption = DEFAULT_MACHINE,
    duration: Duration = 3.0,
    inputs: Inputs = None,
    outputs: Outputs = None,
    high_hz: HighHz = None,
    method: Methods = None,
    allow_failures: AllowFailures = False,
    quick: Quick = False,
    workers: Workers = 2,
    scheduler: Scheduler = None,
    seed: Annotated[int, SEED_OPTION] = 0,
    time_step: TimeStep = None,
    common_loads: CommonLoads = False,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Simulate a design, fit surrogates, print Sobol indices; an unfinished study of the folder goes on."""
    from tbm_gsa.sensitivity.study.run import run_study  # noqa: PLC0415 - what analyses and draws takes a second to import

    sizes = samples, test
    problem, evaluate = planned_study(
        machine, duration, inputs, outputs, high_hz, design, sizes, seed, time_step, common_loads
    )
    with _running(out, method, allow_failures, quick, json, workers, scheduler) as options:
        study = run_study(problem, evaluate, out, options)
    show(study, json)


@app.command()
def resume(
    out: Folder = Path("gsa"),
    method: Methods = None,
    allow_failures: AllowFailures = False,
    quick: Quick = False,
    workers: Workers = 2,
    scheduler: Scheduler = None,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Go on with a study that was interrupted; nothing is simulated twice."""
    from tbm_gsa.sensitivity.study.run import resume_study  # noqa: PLC0415

    with _running(out, method, allow_failures, quick, json, workers, scheduler) as options:
        study = resume_study(out, _evaluation, options)
    show(study, json)


@app.command()
def extend(
    samples: Annotated[int, typer.Option(min=1, max=MOST_SAMPLES, help="Training simulations to add.")],
    out: Folder = Path("gsa"),
    method: Methods = None,
    allow_failures: AllowFailures = False,
    quick: Quick = False,
    workers: Workers = 2,
    scheduler: Scheduler = None,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Add training points to a study; its simulations are kept, the new points fill the gaps between them."""
    from tbm_gsa.sensitivity.study.run import resume_study  # noqa: PLC0415

    with _running(out, method, allow_failures, quick, json, workers, scheduler) as options:
        study = resume_study(out, _evaluation, options, added=samples)
    show(study, json)


@app.command()
def report(
    out: Folder = Path("gsa"),
    method: Methods = None,
    allow_failures: AllowFailures = False,
    quick: Quick = False,
    workers: Workers = 2,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Analyse a finished store again and write its report anew."""
    from tbm_gsa.sensitivity.study.run import report_study  # noqa: PLC0415

    with _running(out, method, allow_failures, quick, json, workers) as options:
        study = report_study(out, options)
    show(study, json)


for _command in (shard, merge, explain):
    app.command()(_command)


def _evaluation(problem: StudyProblem) -> MachineEvaluation:
    """Make the evaluation of a store that is gone on with."""
    return MachineEvaluation.from_settings(problem.settings, problem.outputs)


@contextmanager
def _running(
    out: Path,
    method: list[str] | None,
    allow_failures: bool,
    quick: bool,
    json: bool,
    workers: int,
    scheduler: str | None = None,
) -> Iterator[StudyOptions]:
    """Options of a study under way, with its progress, of all surrogates if none is named; after Ctrl-C, a hint."""
    from tbm_gsa.app.report.gsa_page import write_study_report  # noqa: PLC0415
    from tbm_gsa.sensitivity.study.run import StudyOptions  # noqa: PLC0415

    methods = tuple(method) if method else StudyOptions.methods

    def preview(result: StudyResult) -> None:
        bar.stop()  # its picture, or the table would be printed into it
        show_indices(result)
        bar.start()

    try:
        with progress_bar() as bar, anonymous_main():
            yield StudyOptions(
                methods,
                workers,
                scheduler,
                progress=shown_progress(bar),
                allow_failures=allow_failures,
                quick=quick,
                preview=(lambda _: None) if json else preview,
                report=write_study_report,
            )
    except KeyboardInterrupt:
        notes.print(f"interrupted; what finished is stored: tbm-monitor gsa resume --out {out}", highlight=False)
        raise


def show(study: FinishedStudy, json: bool) -> None:
    """Print a study as JSON, or where its report is: its table is on the terminal already."""
    if json:
        print_json(study.result)
        return
    results.print(f"{study.result.seconds:.1f} s")
    notes.print(f"report: {study.folder / REPORT_NAME}", highlight=False)


def show_indices(result: StudyResult) -> None:
    """Print the strongest inputs, what is in doubt above them."""
    for doubt in result.doubts():
        print_sentence(doubt)
    results.print(strongest_table(result))
    for name, spectrum in result.spectra.items():
        print_sentence(f"{name}: {spectrum.text()}; left out: {'; '.join(spectrum.left_out)}")
    if chance := {name: output.seed.total for name, output in result.outputs.items() if output.seed is not None}:
        largest = sorted(chance, key=chance.__getitem__, reverse=True)[:STRONGEST]
        shares = ", ".join(f"{name} {chance[name]:.2f}" for name in largest)
        print_sentence(f"share of chance ({result.realisations} realisations of the loads), ST at most: {shares}")


def strongest_table(result: StudyResult, count: int = STRONGEST) -> Table:
    """Quality of the surrogate and the strongest inputs of every output, of spectra over all bands together."""
    headings = ("=output", "surrogate", ">R² test", ">R² cv", f"strongest {count}")
    table = narrow_table("Strongest inputs, first-order index S1", *headings)
    for name, output in result.judged().items():
        ranked = sorted(output.first.items(), key=lambda item: item[1], reverse=True)[:count]
        shown = ranked_inputs(ranked) if output.determined else NOT_DETERMINED
        quality = ("–" if r2 is None else f"{r2:.3f}" for r2 in (output.r2_test, output.r2_cv))
        add_row(table, name, output.surrogate, *quality, shown)
    return table
