"""`tbm-monitor gsa`: the surrogate-based global sensitivity analysis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from tbm_dynamics import load_machine
from tbm_dynamics.indicators import INDICATORS
from tbm_gsa.cli.output import JSON_OPTION, MACHINE_OPTION, SEED_OPTION, notes, print_json, progress_bar, results
from tbm_gsa.study.campaign import Progress
from tbm_gsa.study.evaluate import MachineEvaluation
from tbm_gsa.study.inputs import PAPER_INPUTS, InputSet
from tbm_gsa.study.run import StudyOptions, StudyResult, report_study, resume_study, run_study
from tbm_gsa.study.store import Problem

app = typer.Typer(help="Surrogate-based global sensitivity analysis.", no_args_is_help=True)

Folder = Annotated[Path, typer.Option("--out", help="Folder of the study: store, result.json, report.html.")]
Methods = Annotated[
    list[str] | None, typer.Option("--method", help="Surrogate to choose from: svr, krg, rbf or prs; may be repeated.")
]
Workers = Annotated[int, typer.Option("--workers", min=1, help="Processes.")]


@app.command()
def run(
    out: Folder = Path("gsa"),
    samples: Annotated[int, typer.Option(min=10, help="Training simulations.")] = 200,
    test: Annotated[int, typer.Option(min=2, help="Test simulations.")] = 20,
    machine: Annotated[str, MACHINE_OPTION] = "dz101",
    duration: Annotated[float, typer.Option(min=0.01, max=3600.0, help="Length of a simulation (s).")] = 3.0,
    inputs: Annotated[
        Path | None, typer.Option(help="YAML file of another input set; default: the paper's Table 4.")
    ] = None,
    method: Methods = None,
    workers: Workers = 2,
    seed: Annotated[int, SEED_OPTION] = 0,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Simulate a Latin hypercube, fit surrogates, print Sobol indices; an unfinished study of the folder goes on."""
    chosen = PAPER_INPUTS if inputs is None else InputSet.from_yaml(inputs)
    load_machine(machine).assemble()  # a bad machine is refused before a folder is made
    evaluate = MachineEvaluation(machine, duration, seed)
    problem = Problem(chosen, INDICATORS, samples, test, seed, evaluate.settings)
    with _progress() as progress:
        study = run_study(problem, evaluate, out, StudyOptions(_methods(method), workers, progress))
    show(study, json)


@app.command()
def resume(
    out: Folder = Path("gsa"),
    method: Methods = None,
    workers: Workers = 2,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Go on with a study that was interrupted; nothing is simulated twice."""
    with _progress() as progress:
        options = StudyOptions(_methods(method), workers, progress)
        study = resume_study(out, lambda problem: MachineEvaluation.from_settings(problem.settings), options)
    show(study, json)


@app.command()
def report(out: Folder = Path("gsa"), method: Methods = None, json: Annotated[bool, JSON_OPTION] = False) -> None:
    """Analyse a finished store again and write its report anew."""
    show(report_study(out, _methods(method)), json)


def _methods(given: list[str] | None) -> Sequence[str]:
    """Surrogates asked for; the paper chose the support vector regression."""
    return tuple(given) if given else StudyOptions().methods


@contextmanager
def _progress() -> Iterator[Progress]:
    with progress_bar("simulations") as bar:
        task = bar.add_task("", total=None)

        def update(done: int, total: int, failed: int) -> None:
            bar.update(task, completed=done, total=total, description=f"{failed} failed" if failed else "")

        yield update


def show(study: StudyResult, json: bool) -> None:
    """Print a study as JSON or as a table."""
    if json:
        print_json(study.document)
        return
    results.print(strongest_table(study.document))
    results.print(f"{study.document['seconds']:.1f} s")
    notes.print(f"report: {study.report}", highlight=False)


def strongest_table(document: dict[str, Any], count: int = 5) -> Table:
    """Quality of the surrogate and the strongest inputs of every output."""
    table = Table(title="Strongest inputs, first Sobol index")
    for heading in ("output", "surrogate", "R² test", "R² 10-fold", f"strongest {count}"):
        table.add_column(heading)
    for name, output in document["outputs"].items():
        ranked = sorted(output["first"].items(), key=lambda item: item[1], reverse=True)[:count]
        strongest = "  ".join(f"{code} {share:.2f}" for code, share in ranked)
        table.add_row(name, output["surrogate"], f"{output['r2_test']:.3f}", f"{output['r2_cv']:.3f}", strongest)
    return table
