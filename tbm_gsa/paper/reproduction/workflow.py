"""From a machine to every row of the reproduction: campaigns, loads, runs, rows, document."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tbm_dynamics import Machine, load_machine
from tbm_gsa.paper.reproduction.document import reproduction_document
from tbm_gsa.paper.reproduction.loads import SECONDS, LoadEvidence, gather_loads, load_rows
from tbm_gsa.paper.reproduction.model import MeshCurves, mesh_curves, model_rows
from tbm_gsa.paper.reproduction.readings import Reading, readings
from tbm_gsa.paper.reproduction.response import MODEL_S, RUN_S, ResponseEvidence, gather_response
from tbm_gsa.paper.reproduction.response_rows import response_rows
from tbm_gsa.paper.reproduction.row import SOURCES, Row
from tbm_gsa.paper.reproduction.sensitivity import SensitivityEvidence, gather_sensitivity, sensitivity_rows
from tbm_gsa.paper.reproduction.studies import Campaign, fitted_study, whole_study
from tbm_gsa.paper.reproduction.surrogates import surrogate_rows
from tbm_gsa.paper.surrogates import TEST, TRAIN
from tbm_gsa.sensitivity.study.campaign import Progress
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.run import FinishedStudy


@dataclass(frozen=True)
class Sizes:
    """How much is simulated; the defaults are the paper's numbers and what shows its lines.

    Attributes
    ----------
    train, test : int
        Simulations of each campaign.
    other_train : int
        Instead of `train` under the other reading: light damping lets teeth part, and a run takes four times as long.
    simulation_s : float
        Length of each.
    run_s, model_s, loads_s : float
        Of the response run, of the run beside the recording, of the loads.
    whole_study : bool
        Whether the machine's own reading gets the whole study: sampling, screening and a report of its own.
    """

    train: int = TRAIN
    test: int = TEST
    other_train: int = TRAIN // 2
    simulation_s: float = 3.0
    run_s: float = RUN_S
    model_s: float = MODEL_S
    loads_s: float = SECONDS
    whole_study: bool = True


@dataclass(frozen=True, eq=False)
class Reproduction:
    """The reproduction with what its figures are drawn from.

    Attributes
    ----------
    document : dict
        See `reproduction_document`.
    rows : tuple of Row
    readings : tuple of Reading
        The machine's own first; `responses` and `sensitivities` in their order.
    mesh : MeshCurves
    loads : LoadEvidence
    responses : tuple of ResponseEvidence
    sensitivities : tuple of SensitivityEvidence
    """

    document: dict[str, Any]
    rows: tuple[Row, ...]
    readings: tuple[Reading, ...]
    mesh: MeshCurves
    loads: LoadEvidence
    responses: tuple[ResponseEvidence, ...]
    sensitivities: tuple[SensitivityEvidence, ...]


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
    """Produce every table and figure of the paper.

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
    chosen, clock = sizes or Sizes(), _Clock()
    if folder.exists() and not folder.is_dir():
        raise StudyError(f"{folder}: is a file, allowed: a folder, new or with an earlier reproduction")
    described = load_machine(machine)
    described.assemble()
    both = readings(described)
    points = (chosen.train, chosen.other_train)
    campaigns = [
        Campaign(reading, machine, train, chosen.test, chosen.simulation_s, seed)
        for reading, train in zip(both, points, strict=True)
    ]
    campaigns[0].check()
    studies = []
    for campaign in campaigns:
        with clock.measure(f"campaign and surrogates, {campaign.reading.name}"):
            place, told = folder / campaign.reading.name, _simulations(campaign.reading.name, progress)
            if campaign.reading.own and chosen.whole_study:
                study = whole_study(campaign, place, workers, told, report)
            else:
                study = fitted_study(campaign, place, workers, told)
            studies.append(gather_sensitivity(campaign.reading, study))
    progress("loads", None)
    with clock.measure("loads"):
        mesh, loads = mesh_curves(described), gather_loads(described, seed, chosen.loads_s)
    responses = []
    for reading in both:
        progress(f"runs, {reading.name}", None)
        with clock.measure(f"runs, {reading.name}"):
            responses.append(gather_response(reading, bag, seed, chosen.run_s, chosen.model_s))
    rows = tuple(_rows(described, mesh, loads, responses, studies))
    document = reproduction_document(rows, described, both, responses, seed, asdict(chosen), clock.seconds)
    return Reproduction(document, rows, both, mesh, loads, tuple(responses), tuple(studies))


def _simulations(name: str, progress: Progress) -> Progress:
    """Progress of the campaign of a reading."""
    return lambda message, fraction: progress(f"{message}, {name}", fraction)


def _rows(
    machine: Machine,
    mesh: MeshCurves,
    loads: LoadEvidence,
    responses: Sequence[ResponseEvidence],
    studies: Sequence[SensitivityEvidence],
) -> list[Row]:
    """All rows: tables, then figures, each in order."""
    found = [*load_rows(loads), *model_rows(machine, mesh)]
    for response in responses:
        found += response_rows(response)
    for study in studies:
        found += _study_rows(study)
    return sorted(found, key=lambda row: SOURCES.index(row.source))


def _study_rows(evidence: SensitivityEvidence) -> Iterator[Row]:
    """Rows that rest on a campaign; those of the other reading say on how many points, for it may have fewer."""
    study = evidence.study
    failed = f", {study.failed} simulations failed" if study.failed else ""
    for row in (*surrogate_rows(evidence.reading, study), *sensitivity_rows(evidence)):
        yield row if evidence.reading.own else row.noted(f"{study.train} points{failed}")


class _Clock:
    """Seconds by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[stage] = time.perf_counter() - start
