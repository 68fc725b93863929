"""A whole study in one folder: campaign, analysis, result.json, and whatever report is asked for."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tbm_gsa.sensitivity.results import RESULT_NAME, StudyResult
from tbm_gsa.sensitivity.study.analysis import OutputFit, check_methods, fit_outputs
from tbm_gsa.sensitivity.study.campaign import run_campaign
from tbm_gsa.sensitivity.study.failures import checked_failures
from tbm_gsa.sensitivity.study.other_methods import OtherMethods, ask_other_methods
from tbm_gsa.sensitivity.study.problem import StudyProblem
from tbm_gsa.sensitivity.study.store import STORE_NAME, Store
from tbm_gsa.sensitivity.study.workers import Evaluate, analysis_processes
from tbm_gsa.sensitivity.surrogates import SURROGATES
from tbm_msgs_py.base.progress import Progress


@dataclass(frozen=True, eq=False)
class FinishedStudy:
    """A finished study.

    Parameters
    ----------
    folder : Path
        Holds ``store.sqlite`` and ``result.json``, and what the report adds: ``report.html`` and ``tables/*.csv``.
    result : StudyResult
        What ``result.json`` holds.
    fits : mapping of str to OutputFit
    others : mapping of str to OtherMethods
        Empty where they were not asked for.
    """

    folder: Path
    result: StudyResult
    fits: Mapping[str, OutputFit]
    others: Mapping[str, OtherMethods]


@dataclass(frozen=True)
class StudyOptions:
    """How a study is run; none of it changes what the simulations return.

    Parameters
    ----------
    methods : sequence of str
        Surrogates to choose from.
    workers : int
        Processes of campaign and analysis.
    scheduler : str, optional
        Address of a Dask scheduler whose workers simulate instead.
    progress : callable, optional
        Of campaign and analysis, see `Progress`.
    cancelled : callable
        Called during the campaign; see `run_campaign`.
    allow_failures : bool
        Analyse what is left where more simulations failed than `checked_failures` takes.
    quick : bool
        Ask no other methods.
    preview : callable
        Called with the result as soon as the surrogates have answered, before the other methods are asked.
    report : callable
        Called with the finished study, to write pages and tables into its folder.
    """

    methods: Sequence[str] = tuple(SURROGATES)
    workers: int = 2
    scheduler: str | None = None
    progress: Progress | None = None
    cancelled: Callable[[], bool] = lambda: False
    allow_failures: bool = False
    quick: bool = False
    preview: Callable[[StudyResult], None] = lambda _: None
    report: Callable[[FinishedStudy], None] = lambda _: None

    def __post_init__(self) -> None:
        check_methods(self.methods)  # before a folder is made, before hours of simulation


def run_study(
    problem: StudyProblem, evaluate: Evaluate, folder: str | Path, options: StudyOptions | None = None
) -> FinishedStudy:
    """Run a study, or go on with it where the folder holds one of the same problem.

    Parameters
    ----------
    problem : StudyProblem
    evaluate : callable
        See `run_campaign`; its settings belong into the problem.
    folder : str or Path
        Made if it does not exist.
    options : StudyOptions, optional

    Raises
    ------
    StudyError
        The folder holds another study, too many simulations failed, or too few ended well.
    StudyCancelled
        The campaign was cancelled; calling again goes on with it.
    """
    with Store.create_or_open(Path(folder) / STORE_NAME, problem) as store:
        return _finish(store, evaluate, options)


def resume_study(
    folder: str | Path,
    make_evaluate: Callable[[StudyProblem], Evaluate],
    options: StudyOptions | None = None,
    added: int | None = None,
) -> FinishedStudy:
    """Go on with the study of a folder; everything about it but the evaluation is in its store.

    Parameters
    ----------
    folder : str or Path
    make_evaluate : callable
        Returns the evaluation for the problem of the store.
    options : StudyOptions, optional
    added : int, optional
        Training points to add first, see `add_points`; every simulation there is, is kept.
    """
    with Store.open(Path(folder) / STORE_NAME) as store:
        evaluate = make_evaluate(store.problem)  # a machine that has changed is refused before anything is planned
        if added is not None:
            store.extend(added)
        return _finish(store, evaluate, options)


def report_study(folder: str | Path, options: StudyOptions | None = None) -> FinishedStudy:
    """Analyse what the store of a folder holds and write its result and report anew, without any simulation."""
    with Store.open(Path(folder) / STORE_NAME) as store:
        return _finish(store, None, options)


def _finish(store: Store, evaluate: Evaluate | None, options: StudyOptions | None) -> FinishedStudy:
    """Run what is missing if there is an evaluation, analyse, write the result beside the store."""
    chosen, start, campaign_seconds = options or StudyOptions(), time.perf_counter(), 0.0
    if evaluate is not None:
        run_campaign(
            store,
            evaluate,
            workers=chosen.workers,
            scheduler=chosen.scheduler,
            progress=chosen.progress,
            cancelled=chosen.cancelled,
        )
        campaign_seconds = time.perf_counter() - start
    seed = store.problem.seed
    checked_failures(store, chosen.allow_failures, remedy=", or --allow-failures")
    others: Mapping[str, OtherMethods] = {}
    with analysis_processes(min(chosen.workers, len(store.problem.outputs))) as processes:
        analysed = fit_outputs(store, chosen.methods, seed=seed, processes=processes, progress=chosen.progress)

        def result_so_far() -> StudyResult:
            seconds = time.perf_counter() - start
            return StudyResult.of(store, analysed, others, seconds=seconds, campaign_seconds=campaign_seconds)

        chosen.preview(result_so_far())
        if not chosen.quick:
            others = ask_other_methods(analysed.outputs, seed=seed, processes=processes, progress=chosen.progress)
    result = result_so_far()
    study = FinishedStudy(store.path.parent, result, analysed.outputs, others)
    result.write(study.folder / RESULT_NAME)
    chosen.report(study)
    return study
