"""From the document of a comparison to an explanation: campaign, surrogates, causes, and the check by the model."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from tbm_dynamics import Machine, load_machine
from tbm_gsa.explanation.document import Explained, explanation_document
from tbm_gsa.explanation.joint import joint_posterior
from tbm_gsa.explanation.judgement import Judge, first_input, statistics_of
from tbm_gsa.explanation.observed import observed
from tbm_gsa.explanation.ranges import explaining_inputs
from tbm_gsa.explanation.shifts import Lengths, Shifts
from tbm_gsa.provenance import machine_sha256
from tbm_gsa.sensitivity.study.campaign import Progress, run_campaign
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_gsa.sensitivity.study.problem import Problem
from tbm_gsa.sensitivity.study.store import Store
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.files import write_json

STORE_NAME: Final = "explanation.sqlite"
RESULT_NAME: Final = "explanation.json"


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
        Runs that differ in the loads only: how far chance moves the statistics.
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


def explain(comparison: Mapping[str, Any], folder: str | Path, options: ExplainOptions | None = None) -> dict[str, Any]:
    """Look for the inputs that explain a recording; the campaign in the folder is gone on with.

    Parameters
    ----------
    comparison : mapping
        Document of `tbm-monitor compare --json`.
    folder : str or Path
        Gets ``explanation.sqlite`` and ``explanation.json``.
    options : ExplainOptions, optional

    Returns
    -------
    dict
        See `explanation_document`.

    Raises
    ------
    StudyError
        No document of a comparison, a machine file that has changed since, or too few simulations that ended well.
    """
    chosen, start = options or ExplainOptions(), time.perf_counter()
    facts = observed(comparison)
    machine = compared_machine(comparison)
    inputs = explaining_inputs(machine)
    names = tuple(statistic.name for statistic in facts.statistics)
    evaluate = MachineEvaluation(
        machine.origin, machine.description.model_dump_json(), chosen.duration, chosen.seed, names, facts.high_hz
    )
    unit, values = _campaign(Path(folder), inputs, evaluate, chosen)
    nominal = inputs.to_unit([[item.initial for item in inputs.inputs]])[0]
    shifts = Shifts.fit(unit, values, nominal, chosen.seed)
    seeds = range(chosen.seed + 1, chosen.seed + 1 + chosen.seeds)
    judge = Judge(evaluate, inputs, facts, _lengths(comparison, chosen), seeds, chosen.model_error)
    misfit, causes = judge.causes(shifts, nominal)
    best = first_input(causes)
    point = nominal.copy()
    point[best.place] = best.quantiles[0]
    joint = joint_posterior(shifts, nominal, misfit, chosen.seed)
    sample = inputs.sample(inputs.from_unit(point[None])[0])
    longer = replace(evaluate, duration=float(comparison["model_duration"]), seed=int(comparison["seed"]))
    explained = Explained(
        facts,
        inputs,
        nominal,
        shifts,
        misfit,
        tuple(causes),
        joint,
        shifts(point[None])[0],
        statistics_of(longer, sample),
    )
    document = explanation_document(comparison, explained, settings(evaluate, chosen), time.perf_counter() - start)
    write_json(Path(folder) / RESULT_NAME, document)
    return document


def compared_machine(comparison: Mapping[str, Any]) -> Machine:
    """Load the machine of a comparison, at the level of operation that was held longest."""
    origin, level = comparison["machine_file"]["origin"], comparison["operating_point"]
    machine = load_machine(origin)
    if machine_sha256(machine) != comparison["machine_file"]["sha256"]:
        raise StudyError(f"machine {origin} has changed since the comparison: compare again")
    if level["source"] == "machine":
        return machine
    return machine.with_inputs(x1=level["speed_r_min"], x2=level["torque_kn_m"], x3=level["thrust_kn"])


def settings(evaluate: MachineEvaluation, options: ExplainOptions) -> dict[str, str | float | int]:
    """Gather what an explanation depends on besides the comparison."""
    kept = ("samples", "seeds", "model_error", "seed")
    return {**evaluate.settings, **{name: getattr(options, name) for name in kept}}


def _campaign(
    folder: Path, inputs: InputSet, evaluate: MachineEvaluation, options: ExplainOptions
) -> tuple[Array, Array]:
    """Points (n, d) of the unit cube and statistics (n, k) of the simulations that ended well."""
    problem = Problem(inputs, evaluate.outputs, options.samples, 0, options.seed, evaluate.settings)
    with Store.create_or_open(folder / STORE_NAME, problem) as store:
        run_campaign(store, evaluate, workers=options.workers, scheduler=options.scheduler, progress=options.progress)
        points, values = store.results("train")
    return inputs.to_unit(points), values


def _lengths(comparison: Mapping[str, Any], options: ExplainOptions) -> Lengths:
    return Lengths(options.duration, float(comparison["recording"]["duration"]), float(comparison["model_duration"]))
