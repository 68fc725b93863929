"""From a finished store to surrogates, their quality and the Sobol indices of every output."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import numpy as np

from tbm_gsa.sensitivity.results import STRONGEST, is_determined
from tbm_gsa.sensitivity.screening import ElementaryEffects, fast_indices, morris_effects
from tbm_gsa.sensitivity.sobol.indices import SobolIndices, of_a_constant
from tbm_gsa.sensitivity.sobol.monte_carlo import ConvergenceStep, convergence_sizes, sobol_convergence
from tbm_gsa.sensitivity.sobol.of_surrogate import is_constant, sobol_of_surrogate
from tbm_gsa.sensitivity.sobol.paths import PathIndices, sobol_of_paths
from tbm_gsa.sensitivity.study.candidates import Candidate, Data, best_by_method, best_of, fit_candidates, nested_r2
from tbm_gsa.sensitivity.study.curves import Curve, response_curve
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_gsa.sensitivity.study.outputs import spectrum_bands
from tbm_gsa.sensitivity.study.spectra import SpectrumAnalysis, analyse_spectra
from tbm_gsa.sensitivity.study.store import Store
from tbm_gsa.sensitivity.study.workers import local_processes
from tbm_gsa.sensitivity.surrogates import SURROGATES
from tbm_gsa.sensitivity.surrogates.krg import Kriging
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.progress import Progress


@dataclass(frozen=True, eq=False)
class MethodComparison:
    """What other ways of asking say about an output.

    Parameters
    ----------
    surrogates : mapping of str to SobolIndices
        Of every method's surrogate: how far the indices depend on which one is chosen.
    convergence : tuple of ConvergenceStep
        Saltelli sampling of the chosen surrogate with more and more samples.
    places : tuple of int
        Inputs the convergence was followed for: the strongest, strongest first.
    fast : SobolIndices
        Of the chosen surrogate.
    morris : ElementaryEffects
        Of the chosen surrogate.
    """

    surrogates: Mapping[str, SobolIndices]
    convergence: tuple[ConvergenceStep, ...]
    places: tuple[int, ...]
    fast: SobolIndices
    morris: ElementaryEffects


@dataclass(frozen=True, eq=False)
class OutputFit:
    """The surrogates of one output and the indices of the chosen one.

    Parameters
    ----------
    name : str
    candidates : mapping of str to Candidate
        By method, all that were asked for, each with the transformation that suits it.
    chosen : str
        The method with the highest R² in cross validation.
    nested_r2 : float
        R² of the choice itself, see `tbm_gsa.sensitivity.study.candidates.nested_r2`.
    indices : SobolIndices
        Of the chosen surrogate, with second order; intervals by the jackknife over its folds.
    curves : tuple of Curve
        Along the inputs with the largest total indices, largest first.
    """

    name: str
    candidates: Mapping[str, Candidate]
    chosen: str
    nested_r2: float
    indices: SobolIndices
    curves: tuple[Curve, ...]

    @property
    def determined(self) -> bool:
        """Whether the chosen surrogate follows the output, so that its indices say something of it."""
        return is_determined(self.best.r2_cv)

    @property
    def best(self) -> Candidate:
        """The chosen surrogate."""
        return self.candidates[self.chosen]


@dataclass(frozen=True, eq=False)
class OutputAnalysis(OutputFit):
    """Everything found about one output.

    Parameters
    ----------
    groups : SobolIndices or None
        Of the groups of inputs, in the order of `InputSet.groups`; None where there are none.
    paths : PathIndices or None
        Over conditional paths of the Kriging surrogate; None where it was not asked for.
    comparison : MethodComparison
    """

    groups: SobolIndices | None
    paths: PathIndices | None
    comparison: MethodComparison


@dataclass(frozen=True, eq=False)
class _Task:
    """One output to analyse."""

    name: str
    data: Data
    inputs: InputSet
    methods: tuple[str, ...]
    seed: int


Found = TypeVar("Found", bound=OutputFit)
Worked = TypeVar("Worked")


@dataclass(frozen=True, eq=False)
class Analysed(Generic[Found]):
    """What was found about the outputs of a store.

    Parameters
    ----------
    outputs : mapping of str to OutputFit or OutputAnalysis
        In the order of the store's outputs.
    skipped : mapping of str to str
        Why there is nothing to say of an output: it is constant, say.
    spectra : mapping of str to SpectrumAnalysis
        Of whole spectra, whose bands are not among the outputs.
    """

    outputs: Mapping[str, Found]
    skipped: Mapping[str, str]
    spectra: Mapping[str, SpectrumAnalysis] = field(default_factory=dict)

    def checked(self) -> "Analysed[Found]":
        """Return it, or raise a StudyError that names the first output, where there is nothing to say of any."""
        if self.skipped and not self.outputs and not self.spectra:
            name, reason = next(iter(self.skipped.items()))
            raise StudyError(f"output {name}: {reason}")
        return self


@dataclass(frozen=True)
class _Skipped:
    """An output without a surrogate."""

    name: str
    reason: str


def analyse(
    store: Store,
    methods: Sequence[str] = tuple(SURROGATES),
    *,
    seed: int = 0,
    workers: int = 2,
    progress: Progress | None = None,
) -> Analysed[OutputAnalysis]:
    """Analyse the simulations of a store that ended well.

    Parameters
    ----------
    store : Store
    methods : sequence of str
        Surrogates to choose from, by R² of a ten-fold cross validation; see `fit_surrogate`.
    seed : int
        Of fits, cross validations and samplings.
    workers : int
        Processes that share the outputs. The result does not depend on it.
    progress : callable, optional
        Called at the start and after every output, see `Progress`.

    Returns
    -------
    Analysed

    Raises
    ------
    StudyError
        No output has a surrogate: too few simulations, or all are constant; the message names the first.
    """
    analysed = _by_output(_analyse_output, store, methods, seed, workers, progress)
    spectra, skipped = analyse_spectra(store, seed=seed, progress=progress)
    return replace(analysed, spectra=spectra, skipped={**analysed.skipped, **skipped}).checked()


def fit_outputs(
    store: Store,
    methods: Sequence[str] = tuple(SURROGATES),
    *,
    seed: int = 0,
    workers: int = 2,
    progress: Progress | None = None,
) -> Analysed[OutputFit]:
    """Do the first part of `analyse`, which takes a third of its time: the same numbers, and no other way of asking."""
    return _by_output(_fit_output, store, methods, seed, workers, progress).checked()


def _by_output(
    work: Callable[[_Task], Found | _Skipped],
    store: Store,
    methods: Sequence[str],
    seed: int,
    workers: int,
    progress: Progress | None,
) -> Analysed[Found]:
    """Do what there is to do for every output of a store but the bands of spectra."""
    check_methods(methods)
    inputs, bands = store.problem.inputs, spectrum_bands(store.problem.outputs)
    (X, Y), (X_test, Y_test) = store.results("train"), store.results("test")
    unit, test_unit = inputs.to_unit(X), inputs.to_unit(X_test)
    tasks = [
        _Task(name, Data(unit, Y[:, column], test_unit, Y_test[:, column]), inputs, tuple(methods), seed)
        for column, name in enumerate(store.problem.outputs)
        if not any(name in names for names in bands.values())
    ]
    names = [task.name for task in tasks]
    done: dict[str, Found | _Skipped] = {}
    report = progress or (lambda *_: None)
    if names:
        report(f"analysis 0 of {len(names)} outputs", 0.0)
    for one in _run(work, tasks, min(workers, len(tasks))):
        done[one.name] = one
        report(f"analysis {len(done)} of {len(names)} outputs", len(done) / len(names))
    found, skipped = {}, {}
    for one in map(done.__getitem__, names):
        if isinstance(one, _Skipped):
            skipped[one.name] = one.reason
        else:
            found[one.name] = one
    return Analysed(found, skipped)


def check_methods(methods: Sequence[str]) -> None:
    """Raise a `StudyError` unless there is at least one method and all are known."""
    unknown = [method for method in methods if method not in SURROGATES]
    if unknown or not methods:
        raise StudyError(f"surrogates: {', '.join(unknown) or 'none'}, allowed: one or more of {', '.join(SURROGATES)}")
    for method in methods:
        if methods.count(method) > 1:
            raise StudyError(f"surrogate {method}: given twice, allowed: once")


def strongest(indices: SobolIndices, count: int = STRONGEST) -> list[int]:
    """Positions of the inputs with the largest total indices, largest first."""
    return [int(k) for k in np.argsort(-indices.total, kind="stable")[:count]]


def _run(work: Callable[[_Task], Worked], tasks: Sequence[_Task], workers: int) -> Iterator[Worked]:
    """Work on outputs, here or in processes, as they get done; of several that fail the first in order is raised."""
    if workers < 2:
        yield from map(work, tasks)
        return
    waiting = deque(enumerate(tasks))
    running: dict[Future[Worked], int] = {}
    failed: dict[int, BaseException] = {}
    with local_processes(workers) as processes:
        while running or (waiting and not failed):
            while waiting and not failed and len(running) < processes.slots:
                place, task = waiting.popleft()
                running[processes.executor.submit(work, task)] = place
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                place, error = running.pop(future), future.exception()
                if error is not None:
                    failed[place] = error
                else:
                    yield future.result()
        if failed:
            raise failed[min(failed)]


def _fit_output(task: _Task) -> OutputFit | _Skipped:
    """Fit one output."""
    try:
        candidates = fit_candidates(task.methods, task.data, task.seed)
    except InputError as error:
        return _Skipped(task.name, str(error))
    best = best_of(candidates)
    indices = sobol_of_surrogate(best.model, best.validation, second=True, seed=task.seed)
    return OutputFit(
        name=task.name,
        candidates=best_by_method(candidates),
        chosen=best.model.method,
        nested_r2=nested_r2(candidates),
        indices=indices,
        curves=tuple(response_curve(best.model, task.inputs, k) for k in strongest(indices)),
    )


def _analyse_output(task: _Task) -> OutputAnalysis | _Skipped:
    """Analyse one output."""
    fit = _fit_output(task)
    if isinstance(fit, _Skipped):
        return fit
    return OutputAnalysis(
        **vars(fit),
        groups=_group_indices(fit.best, task),
        paths=_path_indices(fit.candidates, task.seed),
        comparison=_comparison(fit, task.seed),
    )


def _group_indices(best: Candidate, task: _Task) -> SobolIndices | None:
    """Find indices of the groups of inputs, if there are any."""
    codes = task.inputs.codes
    groups = [[codes.index(code) for code in members] for members in task.inputs.groups.values()]
    return sobol_of_surrogate(best.model, best.validation, groups=groups, seed=task.seed) if groups else None


def _path_indices(candidates: Mapping[str, Candidate], seed: int) -> PathIndices | None:
    """Find indices over conditional paths of the Kriging surrogate, if there is one."""
    if Kriging.method not in candidates:
        return None
    model = candidates[Kriging.method].model
    assert isinstance(model, Kriging)  # noqa: S101 - for the type checker
    return None if is_constant(model) else sobol_of_paths(model, seed=seed)


def _comparison(fit: OutputFit, seed: int) -> MethodComparison:
    """Apply the other methods; the chosen surrogate's indices are there already."""
    best, indices = fit.best, fit.indices
    predict, bounds = best.model.predict, best.model.bounds
    places, still = tuple(strongest(indices)), is_constant(best.model)
    if still:
        nothing = of_a_constant(len(places), indices.mean)
        steps = tuple(ConvergenceStep(asked, size, nothing) for size, asked in convergence_sizes().items())
    else:
        steps = sobol_convergence(predict, bounds, seed=seed, groups=[(k,) for k in places])
    return MethodComparison(
        surrogates={
            method: indices if candidate is best else sobol_of_surrogate(candidate.model, seed=seed)
            for method, candidate in fit.candidates.items()
        },
        convergence=steps,
        places=places,
        fast=of_a_constant(len(bounds), indices.mean) if still else fast_indices(predict, bounds, seed=seed),
        morris=morris_effects(predict, bounds, seed=seed),
    )
