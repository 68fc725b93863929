"""The campaign of a reading: the paper's design, its three surrogates, their indices."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from tbm_dynamics.indicators import INDICATORS
from tbm_gsa.paper.published import MEASURED_POINTS, METHODS, SHOWN_WITHOUT_STATEMENT, TRENDS
from tbm_gsa.paper.reproduction.readings import Reading
from tbm_gsa.sensitivity.study.analysis import Analysed, OutputFit, fit_outputs
from tbm_gsa.sensitivity.study.campaign import run_campaign
from tbm_gsa.sensitivity.study.curves import Curve, response_curve
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_gsa.sensitivity.study.failures import checked_failures
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS
from tbm_gsa.sensitivity.study.machine_inputs import check_ends
from tbm_gsa.sensitivity.study.problem import StudyProblem
from tbm_gsa.sensitivity.study.run import FinishedStudy, StudyOptions, run_study
from tbm_gsa.sensitivity.study.store import STORE_NAME, Store
from tbm_gsa.sensitivity.study.workers import analysis_processes
from tbm_msgs_py.base.progress import Progress


@dataclass(frozen=True)
class Campaign:
    """What is simulated for a reading.

    Attributes
    ----------
    reading : Reading
    origin : str
        What the machine was loaded from.
    train, test : int
    simulation_s : float
    seed : int
    """

    reading: Reading
    origin: str
    train: int
    test: int
    simulation_s: float
    seed: int

    @property
    def evaluation(self) -> MachineEvaluation:
        """The simulation of a sample; of the machine's own reading `gsa resume` finds it too."""
        name = self.origin if self.reading.own else f"{self.origin} (damping: {self.reading.name})"
        text = self.reading.machine.description.model_dump_json()
        machine = self.reading.machine
        step, settling = machine.step(), machine.settling()
        return MachineEvaluation(name, text, self.simulation_s, self.seed, time_step=step, settling=settling)

    @property
    def problem(self) -> StudyProblem:
        """What its store answers."""
        return StudyProblem(PAPER_INPUTS, INDICATORS, self.train, self.test, self.seed, self.evaluation.settings)

    def check(self) -> None:
        """Raise a StudyError where the machine does not have the paper's inputs, or the test points it measured at."""
        points = self.reading.machine.description.test_points
        try:
            if lacking := [point for point in MEASURED_POINTS if point not in points]:
                raise StudyError(f"no test point {', '.join(lacking)}")
            check_ends(self.reading.machine, PAPER_INPUTS.ends)
        except StudyError as error:
            raise StudyError(
                f"{self.origin}: cannot be held against the paper's machine: {error}; allowed: dz101 or one like it "
                "(gsa run studies any machine)"
            ) from None


@dataclass(frozen=True, eq=False)
class Study:
    """A finished campaign with its fits.

    Attributes
    ----------
    campaign : Campaign
    outputs : mapping of str to OutputFit
    failed : int
        Simulations that failed.
    sampling_gap : float or None
        Largest distance of first indices by the largest sampling from those in `outputs`; None without a sampling.
    """

    campaign: Campaign
    outputs: Mapping[str, OutputFit]
    failed: int
    sampling_gap: float | None

    @property
    def reading(self) -> Reading:
        """Reading of the dampings."""
        return self.campaign.reading

    @cached_property
    def curves(self) -> Mapping[tuple[str, str], Curve]:
        """Curves of Figures 12 and 15 by output and input, in the paper's order."""
        pairs = [(name, code) for name, codes in TRENDS.items() for code in codes] + list(SHOWN_WITHOUT_STATEMENT)
        return {
            (name, code): response_curve(self.outputs[name].best.model, PAPER_INPUTS, PAPER_INPUTS.codes.index(code))
            for name, code in pairs
        }


def whole_study(
    campaign: Campaign, folder: Path, workers: int, progress: Progress, report: Callable[[FinishedStudy], None]
) -> Study:
    """Run or go on with a study, with its own result.json and report."""
    options = StudyOptions(methods=METHODS, workers=workers, progress=progress, report=report)
    found = run_study(campaign.problem, campaign.evaluation, folder, options)
    fits = _complete(Analysed(found.fits, found.result.skipped))
    return Study(campaign, fits, found.result.samples.failed, _sampling_gap(found))


def fitted_study(campaign: Campaign, folder: Path, workers: int, progress: Progress) -> Study:
    """Run or go on with a campaign, and fit and rank only."""
    with Store.create_or_open(folder / STORE_NAME, campaign.problem) as store:
        run_campaign(store, campaign.evaluation, workers=workers, progress=progress)
        checked_failures(store)
        with analysis_processes(workers) as processes:
            found = fit_outputs(store, METHODS, seed=campaign.seed, processes=processes, progress=progress)
        return Study(campaign, _complete(found), store.counts().failed, None)


def _complete(found: Analysed) -> Mapping[str, OutputFit]:
    """All outputs: the paper has a figure of each."""
    for name, reason in found.skipped.items():
        raise StudyError(f"output {name}: {reason}")
    return found.outputs


def _sampling_gap(study: FinishedStudy) -> float:
    gaps = []
    for name, other in study.others.items():
        largest, found = other.convergence[-1].indices, study.fits[name].indices
        gaps.append(float(np.abs(largest.first - found.first[list(other.places)]).max()))
    return max(gaps)
