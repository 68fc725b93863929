"""From a finished store to surrogates, their quality and the Sobol indices of every output."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from tbm_gsa.sensitivity.results import STRONGEST, is_determined
from tbm_gsa.sensitivity.sobol.indices import SobolIndices
from tbm_gsa.sensitivity.sobol.of_surrogate import sobol_of_surrogate
from tbm_gsa.sensitivity.study.candidates import Candidate, Data, best_by_method, best_of, fit_candidates, nested_r2
from tbm_gsa.sensitivity.study.curves import Curve, response_curve
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_gsa.sensitivity.study.outputs import spectrum_bands
from tbm_gsa.sensitivity.study.spectra import SpectrumAnalysis, analyse_spectra
from tbm_gsa.sensitivity.study.store import Store
from tbm_gsa.sensitivity.study.workers import WorkerPool, as_ended
from tbm_gsa.sensitivity.surrogates import SURROGATES
from tbm_gsa.sensitivity.surrogates.realisations import ChanceShare
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.progress import Progress


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
        Of the chosen surrogate; intervals by the jackknife over its folds.
    groups : SobolIndices or None
        Of the groups of inputs, in the order of `InputSet.groups`; None where there are none.
    curves : tuple of Curve
        Along the inputs with the largest total indices, largest first.
    """

    name: str
    candidates: Mapping[str, Candidate]
    chosen: str
    nested_r2: float
    indices: SobolIndices
    groups: SobolIndices | None
    curves: tuple[Curve, ...]

    @property
    def determined(self) -> bool:
        """Whether the chosen surrogate follows the output, so that its indices say something of it."""
        return is_determined(self.best.r2_cv)

    @property
    def chance(self) -> ChanceShare | None:
        """Share of chance in the output; None where all simulations share one realisation of the loads."""
        samples, held_out = self.best.model.samples, self.best.validation
        if samples.effects is None:
            return None
        missed = samples.transformed_of(held_out.actual) - samples.transformed_of(held_out.predicted)
        return samples.effects.share(float(np.var(samples.transformed)), float(np.mean(missed**2)))

    @property
    def best(self) -> Candidate:
        """The chosen surrogate."""
        return self.candidates[self.chosen]


@dataclass(frozen=True, eq=False)
class _Task:
    """One output to analyse."""

    name: str
    data: Data
    inputs: InputSet
    methods: tuple[str, ...]
    seed: int


@dataclass(frozen=True, eq=False)
class Analysed:
    """What was found about the outputs of a store.

    Parameters
    ----------
    outputs : mapping of str to OutputFit
        In the order of the store's outputs.
    skipped : mapping of str to str
        Why there is nothing to say of an output: it is constant, say.
    spectra : mapping of str to SpectrumAnalysis
        Of whole spectra, whose bands are not among the outputs.
    """

    outputs: Mapping[str, OutputFit]
    skipped: Mapping[str, str]
    spectra: Mapping[str, SpectrumAnalysis] = field(default_factory=dict)


@dataclass(frozen=True)
class _Skipped:
    """An output without a surrogate."""

    name: str
    reason: str


def fit_outputs(
    store: Store,
    methods: Sequence[str] = tuple(SURROGATES),
    *,
    seed: int = 0,
    processes: WorkerPool | None = None,
    progress: Progress | None = None,
) -> Analysed:
    """Fit surrogates to the simulations of a store that ended well, and find the indices of the best of them.

    Whole spectra are analysed by themselves, see `tbm_gsa.sensitivity.study.spectra`.

    Parameters
    ----------
    store : Store
    methods : sequence of str
        Surrogates to choose from, by R² of a ten-fold cross validation; see `fit_surrogate`.
    seed : int
        Of fits, cross validations and samplings.
    processes : WorkerPool, optional
        Processes that share the outputs, see `analysis_processes`. The result does not depend on them.
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
    check_methods(methods)
    inputs, bands = store.problem.inputs, spectrum_bands(store.problem.outputs)
    (X, Y), (X_test, Y_test) = store.results("train"), store.results("test")
    unit, test_unit = inputs.to_unit(X), inputs.to_unit(X_test)
    labels = store.realisations("train"), store.realisations("test")
    tasks = [
        _Task(name, Data(unit, Y[:, column], test_unit, Y_test[:, column], *labels), inputs, tuple(methods), seed)
        for column, name in enumerate(store.problem.outputs)
        if not any(name in names for names in bands.values())
    ]
    names = [task.name for task in tasks]
    done: dict[str, OutputFit | _Skipped] = {}
    report = progress or (lambda *_: None)
    if names:
        report(f"analysis 0 of {len(names)} outputs", 0.0)
    for one in as_ended(_fit_output, tasks, processes):
        done[one.name] = one
        report(f"analysis {len(done)} of {len(names)} outputs", len(done) / len(names))
    found = {name: one for name in names if isinstance(one := done[name], OutputFit)}
    skipped = {name: one.reason for name in names if isinstance(one := done[name], _Skipped)}
    spectra, lost = analyse_spectra(store, seed=seed, progress=progress)
    if not found and not spectra:
        name, reason = next(iter((skipped | lost).items()))
        raise StudyError(f"output {name}: {reason}")
    return Analysed(found, skipped | lost, spectra)


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


def _fit_output(task: _Task) -> OutputFit | _Skipped:
    """Fit one output."""
    try:
        candidates = fit_candidates(task.methods, task.data, task.seed)
    except InputError as error:
        return _Skipped(task.name, str(error))
    best = best_of(candidates)
    indices = sobol_of_surrogate(best.model, best.validation, seed=task.seed)
    return OutputFit(
        name=task.name,
        candidates=best_by_method(candidates),
        chosen=best.model.method,
        nested_r2=nested_r2(candidates),
        indices=indices,
        groups=_group_indices(best, task),
        curves=tuple(response_curve(best.model, task.inputs, k) for k in strongest(indices)),
    )


def _group_indices(best: Candidate, task: _Task) -> SobolIndices | None:
    """Find indices of the groups of inputs, if there are any."""
    codes = task.inputs.codes
    groups = [[codes.index(code) for code in members] for members in task.inputs.groups.values()]
    return sobol_of_surrogate(best.model, best.validation, groups=groups, seed=task.seed) if groups else None
