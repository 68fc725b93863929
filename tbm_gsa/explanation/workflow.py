"""From a comparison to its explanation: curves, judgement, joint posterior, and the check by the model."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from tbm_dynamics import Machine, load_machine
from tbm_gsa.comparison.results import ComparisonResult, OperatingLevel
from tbm_gsa.explanation.cause_curves import WORKERS
from tbm_gsa.explanation.curve_cache import at_operating_point, cached_curves
from tbm_gsa.explanation.joint import STEPS, inputs_posterior
from tbm_gsa.explanation.judgement import LEAST_MODEL_ERROR, judge
from tbm_gsa.explanation.observed import Observed, observed
from tbm_gsa.explanation.parts import ExplanationParts, checked_powers
from tbm_gsa.explanation.ranges import loads_prior
from tbm_gsa.explanation.result import RESULT_NAME, Explanation, ExplanationSettings
from tbm_gsa.provenance import machine_sha256, package_versions
from tbm_gsa.reading import MachineFile, RecordingFile
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_msgs_py.base.files import write_json
from tbm_msgs_py.base.progress import Progress


@dataclass(frozen=True)
class ExplainOptions:
    """How an explanation is looked for.

    Parameters
    ----------
    samples : int
        Steps of each walker of the joint posterior.
    duration : float
        Length of the model's run at what was found, s.
    model_error : float
        Standard deviation of the logarithm of a band power that the model is wrong by in any case.
    time_step : float, optional
        Of that run, s; the machine's own without it.
    seed : int
    workers : int
        Processes that compute the curves.
    progress : callable, optional
    """

    samples: int = STEPS
    duration: float = 6.0
    time_step: float | None = None
    model_error: float = LEAST_MODEL_ERROR
    seed: int = 0
    workers: int = WORKERS
    progress: Progress = lambda *_: None


@dataclass(frozen=True, eq=False)
class ExplanationSource:
    """What is to be explained, and where it comes from.

    Attributes
    ----------
    observed : Observed
    machine : Machine
        At the level of operation.
    recording : RecordingFile
    machine_file : MachineFile
    operating_point : OperatingLevel
    doubts : tuple of str
        What may be wrong with it, a line each.
    """

    observed: Observed
    machine: Machine
    recording: RecordingFile
    machine_file: MachineFile
    operating_point: OperatingLevel
    doubts: tuple[str, ...] = ()


def explain(comparison: ComparisonResult, folder: str | Path, options: ExplainOptions | None = None) -> Explanation:
    """Find what explains a recording.

    Parameters
    ----------
    comparison : ComparisonResult
    folder : str or Path
        Gets ``explanation.json``.
    options : ExplainOptions, optional

    Raises
    ------
    StudyError
        A machine file that has changed since the comparison, or what a verdict needs and the recording lacks.
    """
    machine = compared_machine(comparison)
    source = ExplanationSource(
        observed(comparison, machine),
        machine,
        RecordingFile(
            path=comparison.recording.path, sha256=comparison.recording.sha256, begin=comparison.recording.begin
        ),
        comparison.machine_file,
        comparison.operating_point,
        comparison.doubts,
    )
    return explain_source(source, folder, options)


def explain_source(source: ExplanationSource, folder: str | Path, options: ExplainOptions | None = None) -> Explanation:
    """Find what explains band powers; parameters and errors as those of `explain`."""
    chosen, start = options or ExplainOptions(), time.perf_counter()
    seen, machine = source.observed, source.machine
    prior = loads_prior(machine)
    curves = cached_curves(
        machine, seen.reading, chosen.workers, lambda done, of: chosen.progress("curves of the inputs", done / of)
    )
    found = judge(seen, curves, prior, chosen.model_error, lambda done, of: chosen.progress("causes", done / of))
    posterior = inputs_posterior(found, prior, chosen.samples, chosen.seed)
    names = tuple(one.name for one in found.curves.nominal.transfer.statistics)
    evaluate = MachineEvaluation(
        machine.origin,
        machine.description.model_dump_json(),
        chosen.duration,
        chosen.seed,
        names,
        seen.reading.band.high,
        machine.step(chosen.time_step),
        machine.settling(),
    )
    depends = {key: evaluate.settings[key] for key in ("machine", "machine_sha256", "duration", "load_seed", "high_hz")}
    parts = ExplanationParts(found, posterior, checked_powers(found, evaluate), chosen.duration)
    result = Explanation(
        recording=source.recording,
        machine=machine.name,
        machine_file=source.machine_file,
        operating_point=source.operating_point,
        verdict=found.verdict,
        probabilities=dict(found.words.items()),
        loads=parts.loads(),
        sensors=parts.sensors(),
        cannot_be_told=found.blind,
        doubts=source.doubts,
        weightless=seen.weightless(found.used, curves.nominal),
        largest_deviation=parts.largest_deviation,
        observable=parts.observable(),
        causes=parts.causes(),
        joint=parts.joint(),
        statistics=parts.statistics(),
        misfit=parts.misfit,
        standardised_misfit=parts.standardised_misfit,
        explained=found.verdict != "not explained",
        settings=ExplanationSettings.model_validate(
            depends | {"samples": chosen.samples, "seeds": 1, "model_error": chosen.model_error, "seed": chosen.seed}
        ),
        seconds=time.perf_counter() - start,
        versions=package_versions(),
    )
    write_json(Path(folder) / RESULT_NAME, result.model_dump())
    return result


def compared_machine(comparison: ComparisonResult) -> Machine:
    """Machine of a comparison, at the level of operation that was held longest, rounded."""
    origin, level = comparison.machine_file.origin, comparison.operating_point
    machine = load_machine(origin)
    if machine_sha256(machine) != comparison.machine_file.sha256:
        raise StudyError(f"machine {origin} has changed since the comparison: compare again")
    machine = machine.with_offsets(comparison.offsets)
    if level.source == "machine":
        return machine
    return at_operating_point(machine, level.speed_r_min, level.torque_kn_m, level.thrust_kn)
