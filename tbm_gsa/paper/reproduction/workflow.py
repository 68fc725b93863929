"""From a machine to the result of its reproduction: campaigns, loads, runs, rows."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tbm_dynamics import Machine, load_machine
from tbm_gsa.paper.reproduction.loads import LoadEvidence, gather_loads, load_rows
from tbm_gsa.paper.reproduction.model import MeshCurves, mesh_curves, model_rows
from tbm_gsa.paper.reproduction.readings import Reading, readings
from tbm_gsa.paper.reproduction.response import ResponseEvidence, gather_response
from tbm_gsa.paper.reproduction.response_rows import response_rows
from tbm_gsa.paper.reproduction.result import (
    SOURCES,
    ReadingSummary,
    ReproducedRecording,
    ReproductionResult,
    Row,
    Sizes,
    count_verdicts,
)
from tbm_gsa.paper.reproduction.sensitivity import sensitivity_rows
from tbm_gsa.paper.reproduction.studies import Campaign, Study, fitted_study, whole_study
from tbm_gsa.paper.reproduction.surrogates import surrogate_rows
from tbm_gsa.provenance import machine_file, package_versions
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.run import FinishedStudy
from tbm_msgs_py.base.progress import Progress


class _Stopwatch:
    """Seconds by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[stage] = time.perf_counter() - start


@dataclass(frozen=True, eq=False)
class Reproduction:
    """The reproduction with what its figures are drawn from.

    Attributes
    ----------
    result : ReproductionResult
    readings : tuple of Reading
        The machine's own first; `responses` and `studies` in their order.
    mesh : MeshCurves
    loads : LoadEvidence
    responses : tuple of ResponseEvidence
    studies : tuple of Study
    """

    result: ReproductionResult
    readings: tuple[Reading, ...]
    mesh: MeshCurves
    loads: LoadEvidence
    responses: tuple[ResponseEvidence, ...]
    studies: tuple[Study, ...]


def reproduce(
    machine: str,
    folder: Path,
    bag: Path,
    *,
    seed: int = 0,
    workers: int = 2,
    sizes: Sizes | None = None,
    progress: Progress = lambda *_: None,
    report: Callable[[FinishedStudy], None] = lambda _: None,
) -> Reproduction:
    """Every table and figure of the paper, beside ours.

    Parameters
    ----------
    machine : str
        Name of a shipped machine, or path of a machine file.
    folder : Path
        Holds the campaigns; those that are there are gone on with.
    bag : Path
        Recording that Table 2 and Figure 7 are held against.
    seed : int
        Of loads, designs, fits.
    workers : int
        Processes of the campaigns.
    sizes : Sizes, optional
    progress : callable, optional
    report : callable
        Writes pages of the study of the machine's own reading, see `StudyOptions`.

    Raises
    ------
    MachineError
        No such machine, or one that cannot be built.
    StudyError
        The folder is a file or holds another study, or the machine lacks one of the inputs.
    RecordingError
        A recording that cannot be compared.
    """
    chosen, clock = sizes or Sizes(), _Stopwatch()
    if folder.exists() and not folder.is_dir():
        raise StudyError(f"{folder}: is a file, allowed: a folder, new or with an earlier reproduction")
    described = load_machine(machine)
    described.assemble()
    both = readings(described)
    studies = []
    for campaign in _campaigns(both, machine, chosen, seed):
        with clock.measure(f"campaign and surrogates, {campaign.reading.name}"):
            whole = report if campaign.reading.own and chosen.whole_study else None
            studies.append(_study(campaign, folder, workers, progress, whole))
    progress("loads", None)
    with clock.measure("loads"):
        mesh, loads = mesh_curves(described), gather_loads(described, seed, chosen.loads_s)
    responses = tuple(_responses(both, bag, seed, chosen, clock, progress))
    rows = _rows(described, mesh, loads, responses, studies)
    result = _result(rows, described, both, responses[0], seed, chosen, clock.seconds)
    return Reproduction(result, both, mesh, loads, responses, tuple(studies))


def _result(
    rows: Sequence[Row],
    machine: Machine,
    both: Sequence[Reading],
    response: ResponseEvidence,
    seed: int,
    sizes: Sizes,
    seconds: Mapping[str, float],
) -> ReproductionResult:
    compared = response.comparison.result
    return ReproductionResult(
        rows=tuple(rows),
        verdicts=count_verdicts(row for row in rows if row.reading in (None, both[0].name)),
        other_reading=count_verdicts(row for row in rows if row.reading == both[1].name),
        readings=tuple(ReadingSummary(name=one.name, title=one.title, own=one.own, fitted=one.fitted) for one in both),
        machine=machine.name,
        machine_file=machine_file(machine),
        recording=ReproducedRecording(
            path=compared.recording.path, sha256=compared.recording.sha256, synthetic=compared.synthetic
        ),
        seed=seed,
        sizes=sizes,
        versions=package_versions(),
        seconds={**seconds, "total": sum(seconds.values())},
    )


def _campaigns(both: Sequence[Reading], machine: str, sizes: Sizes, seed: int) -> list[Campaign]:
    """Campaign of each reading; what the machine lacks is refused before the first begins."""
    campaigns = [
        Campaign(reading, machine, train, sizes.test, sizes.simulation_s, seed)
        for reading, train in zip(both, (sizes.train, sizes.other_train), strict=True)
    ]
    campaigns[0].check()
    return campaigns


def _study(
    campaign: Campaign, folder: Path, workers: int, progress: Progress, report: Callable[[FinishedStudy], None] | None
) -> Study:
    """Study of a reading in its folder; with a report the whole one, else as much as the rows need."""
    name = campaign.reading.name

    def done(message: str, fraction: float | None) -> None:
        progress(f"{message}, {name}", fraction)

    if report is None:
        return fitted_study(campaign, folder / name, workers, done)
    return whole_study(campaign, folder / name, workers, done, report)


def _responses(
    both: Sequence[Reading], bag: Path, seed: int, sizes: Sizes, clock: _Stopwatch, progress: Progress
) -> Iterator[ResponseEvidence]:
    for reading in both:
        stage = f"runs, {reading.name}"
        progress(stage, None)
        with clock.measure(stage):
            found = gather_response(reading, bag, seed, sizes.run_s, sizes.model_s)
        yield found


def _rows(
    machine: Machine,
    mesh: MeshCurves,
    loads: LoadEvidence,
    responses: Sequence[ResponseEvidence],
    studies: Sequence[Study],
) -> list[Row]:
    """All rows: tables, then figures, each in order."""
    found = [*load_rows(loads), *model_rows(machine, mesh)]
    for response in responses:
        found += response_rows(response)
    for study in studies:
        found += _study_rows(study)
    return sorted(found, key=lambda row: SOURCES.index(row.source))


def _study_rows(study: Study) -> Iterator[Row]:
    """Rows that rest on a campaign; those of the other reading say on how many points, for it may have fewer."""
    failed = f", {study.failed} simulations failed" if study.failed else ""
    for row in (*surrogate_rows(study), *sensitivity_rows(study)):
        yield row if study.reading.own else row.noted(f"{study.campaign.train} points{failed}")
