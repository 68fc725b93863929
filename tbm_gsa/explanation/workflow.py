"""From a comparison to its explanation: campaign, surrogates, causes, and the check by the model."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from tbm_dynamics import Machine, load_machine
from tbm_gsa.comparison.results import ComparisonResult
from tbm_gsa.explanation.causes import Cause, CauseRanking, Misfit, first_input, statistics_of, with_input
from tbm_gsa.explanation.indicator_change import IndicatorChange, Lengths
from tbm_gsa.explanation.joint import JointPosterior, joint_posterior
from tbm_gsa.explanation.observed import Observed, observed
from tbm_gsa.explanation.ranges import explaining_inputs
from tbm_gsa.explanation.result import (
    RESULT_NAME,
    ComparedStatistic,
    Explanation,
    ExplanationSettings,
    InputCause,
    Joint,
    JointInput,
    Misfits,
    NoChange,
    explains,
)
from tbm_gsa.provenance import machine_sha256, package_versions
from tbm_gsa.reading import RecordingFile
from tbm_gsa.sensitivity.study.campaign import Progress, run_campaign
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_gsa.sensitivity.study.failures import Failures, checked_failures
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_gsa.sensitivity.study.problem import Problem
from tbm_gsa.sensitivity.study.store import Store
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.files import write_json

STORE_NAME: Final = "explanation.sqlite"


@dataclass(frozen=True)
class ExplainOptions:
    """How an explanation is looked for.

    Parameters
    ----------
    samples : int
        Simulations of the campaign.
    duration : float
        Length of each, s.
    seeds : int
        Runs that differ in the loads only: how far their randomness moves the statistics.
    model_error : float
        Standard deviation of the logarithm of a statistic that the model is wrong by in any case.
    seed : int
    workers : int
    scheduler : str, optional
        As those of a study.
    progress : callable, optional
    """

    samples: int = 200
    duration: float = 6.0
    seeds: int = 12
    model_error: float = 0.05
    seed: int = 0
    workers: int = 2
    scheduler: str | None = None
    progress: Progress | None = None


def explain(comparison: ComparisonResult, folder: str | Path, options: ExplainOptions | None = None) -> Explanation:
    """Find the inputs that explain a recording; the campaign in the folder is gone on with.

    Parameters
    ----------
    comparison : ComparisonResult
    folder : str or Path
        Gets ``explanation.sqlite`` and ``explanation.json``.
    options : ExplainOptions, optional

    Raises
    ------
    StudyError
        A machine file that has changed since the comparison, or too few statistics or simulations that ended well.
    """
    chosen, start = options or ExplainOptions(), time.perf_counter()
    facts, machine = observed(comparison), compared_machine(comparison)
    inputs = explaining_inputs(machine)
    names = tuple(statistic.name for statistic in facts.statistics)
    evaluate = MachineEvaluation(
        machine.origin, machine.description.model_dump_json(), chosen.duration, chosen.seed, names, facts.high_hz
    )
    found = _find(evaluate, inputs, facts, comparison, Path(folder), chosen)
    off = Misfits(**{name: found.deviations(left) for name, left in found.left().items()})
    result = Explanation(
        recording=RecordingFile(path=comparison.recording.path, sha256=comparison.recording.sha256),
        machine=comparison.machine,
        machine_file=comparison.machine_file,
        operating_point=comparison.operating_point,
        causes=tuple(map(found.cause, found.causes)),
        joint=found.joint(),
        statistics=found.statistics(),
        misfit=Misfits(**{name: float(np.sqrt(np.mean(left**2))) for name, left in found.left().items()}),
        standardised_misfit=off,
        explained=explains(off.model if found.causes[0].place < 0 else off.checked),
        failure_summary=found.failures,
        settings=_settings(evaluate, chosen),
        seconds=time.perf_counter() - start,
        versions=package_versions(),
    )
    write_json(Path(folder) / RESULT_NAME, result.model_dump())
    return result


def compared_machine(comparison: ComparisonResult) -> Machine:
    """Machine of a comparison, at the level of operation that was held longest."""
    origin, level = comparison.machine_file.origin, comparison.operating_point
    machine = load_machine(origin)
    if machine_sha256(machine) != comparison.machine_file.sha256:
        raise StudyError(f"machine {origin} has changed since the comparison: compare again")
    machine = machine.with_offsets(comparison.offsets)
    if level.source == "machine":
        return machine
    return machine.with_inputs(x1=level.speed_r_min, x2=level.torque_kn_m, x3=level.thrust_kn)


def _find(
    evaluate: MachineEvaluation,
    inputs: InputSet,
    facts: Observed,
    comparison: ComparisonResult,
    folder: Path,
    options: ExplainOptions,
) -> _Findings:
    """Run the campaign, rank the causes, and check the first one by the model."""
    unit, values, failures = _campaign(folder, inputs, evaluate, options)
    nominal = inputs.to_unit([[item.initial for item in inputs.inputs]])[0]
    change = IndicatorChange.fit(unit, values, nominal, options.seed)
    lengths = Lengths(options.duration, comparison.recording.duration, comparison.model_duration)
    seeds = range(options.seed + 1, options.seed + 1 + options.seeds)
    misfit, causes = CauseRanking(evaluate, inputs, facts, lengths, seeds, options.model_error).causes(change, nominal)
    posterior = joint_posterior(change, nominal, misfit, options.seed)
    point = with_input(nominal, first_input(causes))
    longer = replace(evaluate, duration=comparison.model_duration, seed=comparison.seed)
    checked = statistics_of(longer, inputs.sample(inputs.from_unit(point[None])[0]))
    return _Findings(facts, inputs, change, misfit, causes, posterior, change(point[None])[0], checked, failures)


def _settings(evaluate: MachineEvaluation, options: ExplainOptions) -> ExplanationSettings:
    own = {name: getattr(options, name) for name in ("samples", "seeds", "model_error", "seed")}
    return ExplanationSettings.model_validate(evaluate.settings | own)


def _campaign(
    folder: Path, inputs: InputSet, evaluate: MachineEvaluation, options: ExplainOptions
) -> tuple[Array, Array, Failures | None]:
    """Points (n, d) of the unit cube and statistics (n, k) of the simulations that ended well; those that failed."""
    problem = Problem(inputs, evaluate.outputs, options.samples, 0, options.seed, evaluate.settings)
    with Store.create_or_open(folder / STORE_NAME, problem) as store:
        run_campaign(store, evaluate, workers=options.workers, scheduler=options.scheduler, progress=options.progress)
        failures = checked_failures(store)
        points, values = store.results("train")
    return inputs.to_unit(points), values, failures


@dataclass(frozen=True, eq=False)
class _Findings:
    """What an explanation found, on the unit cube, and its parts in units.

    Attributes
    ----------
    facts : Observed
    inputs : InputSet
    change : IndicatorChange
    misfit : Misfit
    causes : list of Cause
        The most probable first.
    posterior : JointPosterior
    predicted : ndarray, shape (k,)
        Changes of the logarithms at the median of the first cause that is an input, by the surrogates.
    checked : ndarray, shape (k,)
        Statistics that the model itself gives there, m/s².
    failures : Failures or None
        Of the campaign.
    """

    facts: Observed
    inputs: InputSet
    change: IndicatorChange
    misfit: Misfit
    causes: list[Cause]
    posterior: JointPosterior
    predicted: Array
    checked: Array
    failures: Failures | None

    def cause(self, cause: Cause) -> InputCause | NoChange:
        """Convert a cause to units."""
        if cause.place < 0:
            return NoChange(probability=cause.probability, log_evidence=cause.log_evidence)
        item = self.inputs.inputs[cause.place]
        value, low, high = item.distribution.from_unit(cause.quantiles).tolist()
        return InputCause(
            **{key: getattr(item, key) for key in ("name", "symbol", "unit", "kind")},
            input=item.code,
            probability=cause.probability,
            log_evidence=cause.log_evidence,
            value=value,
            interval=(low, high),
            machine_value=item.initial,
        )

    def joint(self) -> Joint:
        """Convert the joint posterior to units."""
        low, middle, high = np.quantile(self.posterior.samples, (0.05, 0.5, 0.95), axis=0)
        found = {}
        for place, item in enumerate(self.inputs.inputs):
            ends = item.distribution.from_unit([low[place], middle[place], high[place]]).tolist()
            found[item.code] = JointInput(
                value=ends[1],
                interval=(ends[0], ends[2]),
                machine_value=item.initial,
                learnt=float(1.0 - (high[place] - low[place]) / 0.9),
                lower=item.lower,
                upper=item.upper,
                distribution=item.distribution.name,
            )
        left = self.misfit.observed - self.change(self.posterior.best[None])[0]
        return Joint(
            inputs=found,
            accepted=self.posterior.accepted,
            effective_samples=self.posterior.effective,
            standardised_misfit=self.deviations(left),
        )

    def statistics(self) -> tuple[ComparedStatistic, ...]:
        """Statistics of field and model, before and after the first input is changed."""
        return tuple(
            ComparedStatistic(
                name=fact.name,
                field=fact.field,
                model=fact.model,
                predicted=float(fact.model * np.exp(self.predicted[place])),
                checked=float(self.checked[place]),
                deviation=float(np.sqrt(self.misfit.covariance[place, place])),
                r2_cv=float(self.change.r2[place]),
            )
            for place, fact in enumerate(self.facts.statistics)
        )

    def left(self) -> dict[str, Array]:
        """Logarithms (k,) of field over model: as compared, as predicted and as checked."""
        logs, models = self.misfit.observed, np.array([fact.model for fact in self.facts.statistics])
        return {"model": logs, "predicted": logs - self.predicted, "checked": logs - np.log(self.checked / models)}

    def deviations(self, left: Array) -> float:
        """Root mean square of logarithms (k,) in their standard deviations."""
        return float(np.sqrt(np.mean(left**2 / np.diag(self.misfit.covariance))))
