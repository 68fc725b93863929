"""`tbm-monitor gsa shard` and `gsa merge`: a study in parts that need no connection to one another."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from tbm_gsa.app.cli.gsa_planning import (
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
from tbm_gsa.app.cli.output import (
    DEFAULT_MACHINE,
    JSON_OPTION,
    SEED_OPTION,
    MachineOption,
    TimeStep,
    notes,
    print_json,
    print_sentence,
    progress_bar,
)
from tbm_gsa.app.cli.workers import Workers, anonymous_main, shown_progress
from tbm_gsa.reading import Part
from tbm_gsa.sensitivity.study.campaign import run_campaign
from tbm_gsa.sensitivity.study.merging import merge_studies
from tbm_gsa.sensitivity.study.shards import Shard
from tbm_gsa.sensitivity.study.store import STORE_NAME, Store


class ShardResult(Part):
    """What `gsa shard --json` prints: simulations of the part and what became of them, those of the whole design."""

    folder: str
    shard: str
    simulations: int
    ok: int
    failed: int
    total: int
    seconds: float


def shard(
    part: Annotated[str, typer.Argument(metavar="I/N", help="Part of the design, as 2/8 for the second of eight.")],
    out: Annotated[Path, typer.Option(help="Folder of this part.")],
    samples: Samples = 200,
    test: TestSamples = 20,
    design: Design = "lhs",
    machine: MachineOption = DEFAULT_MACHINE,
    duration: Duration = 3.0,
    inputs: Inputs = None,
    outputs: Outputs = None,
    high_hz: HighHz = None,
    workers: Workers = 2,
    seed: Annotated[int, SEED_OPTION] = 0,
    time_step: TimeStep = None,
    common_loads: CommonLoads = False,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Run one of N independent parts of a study, with the options of `gsa run`; again: it goes on."""
    chosen, start = Shard.parse(part), time.perf_counter()
    sizes = samples, test
    problem, evaluate = planned_study(
        machine, duration, inputs, outputs, high_hz, design, sizes, seed, time_step, common_loads
    )
    with Store.create_or_open(out / STORE_NAME, problem) as store:
        try:
            with progress_bar() as bar, anonymous_main():
                run_campaign(store, evaluate, workers=workers, progress=shown_progress(bar), shard=chosen)
        except KeyboardInterrupt:
            notes.print("interrupted; what finished is stored, the same command goes on", highlight=False)
            raise
        counts, total = store.counts(chosen), store.counts().total
    found = ShardResult(
        folder=str(out),
        shard=str(chosen),
        simulations=counts.total,
        ok=counts.ok,
        failed=counts.failed,
        total=total,
        seconds=time.perf_counter() - start,
    )
    if json:
        print_json(found)
        return
    print_sentence(
        f"part {found.shard}: {found.ok} of {found.simulations} simulations ended well, {found.failed} failed; the "
        f"whole design has {found.total}"
    )
    notes.print("join all parts: tbm-monitor gsa merge FOLDER ... --out DIR", highlight=False)


def merge(
    parts: Annotated[list[Path], typer.Argument(metavar="FOLDER...", help="Folders of `gsa shard`.")],
    out: Annotated[Path, typer.Option(help="Folder of the whole study; what it holds already stays.")],
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Join parts of a study in one store, which `gsa report` analyses and `gsa resume` completes."""
    found = merge_studies(parts, out)
    if json:
        print_json(found)
        return
    for one in found.parts:
        print_sentence(f"{one.folder}: {one.taken} of {one.ended} simulations taken")
    print_sentence(f"{found.ok + found.failed} of {found.total} simulations, {found.failed} failed")
    if found.missing:
        notes.print(f"{found.missing} are missing; simulate them: tbm-monitor gsa resume --out {out}", highlight=False)
    else:
        notes.print(f"complete; analyse it: tbm-monitor gsa report --out {out}", highlight=False)
