"""The result of a study, ``result.json``: its keys are a contract with whoever reads it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Self, TypeAlias

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError, WithJsonSchema, WrapSerializer

from tbm_gsa.provenance import package_versions
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.results import write_json

if TYPE_CHECKING:
    from tbm_gsa.sensitivity.sobol import PathIndices, SobolIndices
    from tbm_gsa.sensitivity.sobol.paths import Spread
    from tbm_gsa.sensitivity.study.analysis import MethodComparison, OutputAnalysis
    from tbm_gsa.sensitivity.study.candidates import Candidate
    from tbm_gsa.sensitivity.study.store import Store

RESULT_NAME: Final = "result.json"
REPORT_NAME: Final = "report.html"
TABLES_NAME: Final = "tables"
INDICES: Final = (
    "closed form of the surrogate, sampled where its output was transformed; "
    "intervals: delete-a-group jackknife over the folds, 95 %"
)
# Interactions below this share of the variance are left out.
SMALLEST_INTERACTION: Final = 1e-3

Number = Annotated[
    float,
    BeforeValidator(lambda given: math.nan if given is None else given),  # JSON has null for what is not finite
    WithJsonSchema({"type": ["number", "null"]}),
]
Interval: TypeAlias = tuple[Number, Number]
Codes: TypeAlias = tuple[str, ...]


class ResultPart(BaseModel):
    """Base of the parts of a result: frozen, in JSON under the names of its fields."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)


class IndexTable(ResultPart):
    """First-order (S1) and total (ST) indices with intervals, by input or group; no intervals where none are known."""

    first: dict[str, Number]
    total: dict[str, Number]
    first_interval: dict[str, Interval]
    total_interval: dict[str, Interval]

    @classmethod
    def of(cls, indices: SobolIndices, codes: Codes, **others: object) -> Self:
        """Build the table of the inputs or groups of these codes, with its other fields."""
        parts = {
            "first": _values(codes, indices.first),
            "total": _values(codes, indices.total),
            "first_interval": _intervals(codes, indices.first_interval),
            "total_interval": _intervals(codes, indices.total_interval),
        }
        return cls.model_validate({**parts, **others})


class MethodIndices(IndexTable):
    """Indices, and how they were found."""

    source: str


class ConvergenceIndices(IndexTable):
    """Indices of the strongest inputs at one base size of Saltelli's scheme, and the sizes that were asked for."""

    asked: tuple[int, ...]
    samples: int


class Interaction(ResultPart):
    """Second-order index (S2) of two inputs."""

    inputs: tuple[str, str]
    index: Number
    interval: Interval


class PathSpread(ResultPart):
    """An index over conditional Kriging paths, by input: mean, 95 %, deviations by the surrogate and by sampling."""

    mean: dict[str, Number]
    interval: dict[str, Interval]
    metamodel: dict[str, Number]
    monte_carlo: dict[str, Number]

    @classmethod
    def of(cls, spread: Spread, codes: Codes) -> Self:
        """Build the spread over the inputs of these codes."""
        mean, metamodel, monte_carlo = (
            _values(codes, values) for values in (spread.mean, spread.metamodel, spread.monte_carlo)
        )
        interval = _intervals(codes, spread.interval)
        return cls(mean=mean, interval=interval, metamodel=metamodel, monte_carlo=monte_carlo)


class PathTable(ResultPart):
    """Indices over conditional Kriging paths, and the sizes of their sampling."""

    samples: int
    paths: int
    resamples: int
    first: PathSpread
    total: PathSpread


class MorrisTable(ResultPart):
    """Elementary effects by input, in the unit of the output per range of the input: μ, μ* with its 95 %, σ."""

    mean: dict[str, Number]
    mean_absolute: dict[str, Number]
    mean_absolute_interval: dict[str, Interval]
    deviation: dict[str, Number]


class SurrogateScores(ResultPart):
    """Quality of a surrogate in cross validation and on the test points; errors in the unit of the output."""

    transform: str
    r2_cv: Number
    r2_test: float | None
    rmse_cv: Number
    rmse_test: float | None
    largest_error_cv: Number
    largest_error_test: float | None


class OutputResult(MethodIndices, SurrogateScores):
    """Everything found about one output: the chosen surrogate, its indices, and what other methods find.

    `second` holds the largest interactions, largest first; `groups` is empty where the study has no groups, `paths`
    null where there is no Kriging surrogate; `scores` holds the quality of every surrogate.
    """

    surrogate: str
    r2_nested: Number
    second: tuple[Interaction, ...]
    groups: Annotated[
        IndexTable | None,
        BeforeValidator(lambda given: given or None),
        WrapSerializer(lambda table, dump: dump(table) or {}),
    ]
    paths: PathTable | None
    by_surrogate: dict[str, MethodIndices]
    convergence: tuple[ConvergenceIndices, ...]
    fast: IndexTable
    morris: MorrisTable
    scores: dict[str, SurrogateScores]


class SampleCounts(ResultPart):
    """Training and test simulations that were planned, and how many of them failed."""

    train: int
    test: int
    failed: int


class Failure(ResultPart):
    """A simulation that failed."""

    row: int
    reason: str


class StudyResult(ResultPart):
    """A finished study: the outputs by name, and where their numbers come from.

    Times in s: `seconds` of this run, `campaign_seconds` of it for the campaign, `simulation_seconds` of processor time
    in all simulations.
    """

    outputs: dict[str, OutputResult]
    seconds: float
    campaign_seconds: float
    simulation_seconds: float
    groups: dict[str, tuple[str, ...]]
    inputs: dict[str, dict[str, str | float]]
    samples: SampleCounts
    failures: tuple[Failure, ...]
    design: str
    seed: int
    settings: dict[str, str | int | float]
    indices: str
    versions: dict[str, str]

    @classmethod
    def of(
        cls, store: Store, analyses: Mapping[str, OutputAnalysis], *, seconds: float, campaign_seconds: float
    ) -> StudyResult:
        """Gather the result of a finished store and its analyses; times as in the class."""
        problem = store.problem
        codes, groups = problem.inputs.codes, tuple(problem.inputs.groups)
        return StudyResult(
            outputs={name: _output(analysis, codes, groups) for name, analysis in analyses.items()},
            seconds=seconds,
            campaign_seconds=campaign_seconds,
            simulation_seconds=store.simulation_seconds(),
            groups=dict(problem.inputs.groups),
            inputs={item.code: item.to_dict() for item in problem.inputs.inputs},
            samples=SampleCounts(train=problem.train, test=problem.test, failed=store.counts().failed),
            failures=tuple(Failure(row=row, reason=reason) for row, reason in store.failures()),
            design=problem.design,
            seed=problem.seed,
            settings=dict(problem.settings),
            indices=INDICES,
            versions=package_versions(),
        )

    def write(self, path: Path) -> None:
        """Write the result as JSON, whole or not at all."""
        write_json(path, self.model_dump())

    @classmethod
    def read(cls, path: Path) -> StudyResult:
        """Read what `write` wrote; a StudyError of one line for any other file."""
        try:
            return cls.model_validate_json(path.read_bytes())
        except OSError as error:
            raise StudyError(f"{path}: {error.strerror}, allowed: the result of a study") from None
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(map(str, first["loc"]))
            raise StudyError(f"{path}: not the result of a study ({place}: {first['msg']})") from None


def _output(analysis: OutputAnalysis, codes: Codes, groups: Codes) -> OutputResult:
    """Gather the result of one output."""
    return OutputResult.of(
        analysis.indices,
        codes,
        **dict(_scores(analysis.best)),
        surrogate=analysis.chosen,
        r2_nested=analysis.nested_r2,
        source=_source(analysis.indices),
        second=_interactions(analysis.indices, codes),
        groups=None if analysis.groups is None else IndexTable.of(analysis.groups, groups),
        paths=None if analysis.paths is None else _paths(analysis.paths, codes),
        **_other_methods(analysis.comparison, codes),
        scores={method: _scores(candidate) for method, candidate in analysis.candidates.items()},
    )


def _scores(candidate: Candidate) -> SurrogateScores:
    """Gather the scores of a candidate."""
    return SurrogateScores(
        transform=candidate.transform,
        r2_cv=candidate.r2_cv,
        r2_test=candidate.r2_test,
        rmse_cv=candidate.validation.rmse,
        rmse_test=candidate.rmse_test,
        largest_error_cv=candidate.validation.largest_error,
        largest_error_test=candidate.largest_error_test,
    )


def _source(indices: SobolIndices) -> str:
    """How indices were found."""
    return f"sampling, {indices.evaluations} evaluations" if indices.evaluations else "closed form"


def _interactions(indices: SobolIndices, codes: Codes) -> tuple[Interaction, ...]:
    """Second-order indices with intervals, largest first."""
    second, interval = indices.second, indices.second_interval
    if second is None or interval is None:
        return ()
    pairs = [(j, k) for j in range(len(codes)) for k in range(j) if second[j, k] >= SMALLEST_INTERACTION]
    return tuple(
        Interaction(inputs=(codes[k], codes[j]), index=float(second[j, k]), interval=tuple(interval[j, k].tolist()))
        for j, k in sorted(pairs, key=lambda pair: -second[pair])
    )


def _paths(paths: PathIndices, codes: Codes) -> PathTable:
    """Gather the indices over conditional Kriging paths by input."""
    first, total = PathSpread.of(paths.first, codes), PathSpread.of(paths.total, codes)
    return PathTable(samples=paths.samples, paths=paths.paths, resamples=paths.resamples, first=first, total=total)


def _other_methods(comparison: MethodComparison, codes: Codes) -> dict[str, object]:
    """Gather what other methods find, by field of `OutputResult`."""
    followed, morris = tuple(codes[k] for k in comparison.places), comparison.morris
    return {
        "by_surrogate": {
            method: MethodIndices.of(indices, codes, source=_source(indices))
            for method, indices in comparison.surrogates.items()
        },
        "convergence": tuple(
            ConvergenceIndices.of(step.indices, followed, asked=step.asked, samples=step.samples)
            for step in comparison.convergence
        ),
        "fast": IndexTable.of(comparison.fast, codes),
        "morris": MorrisTable(
            mean=_values(codes, morris.mean),
            mean_absolute=_values(codes, morris.mean_absolute),
            mean_absolute_interval=_intervals(codes, morris.mean_absolute_interval),
            deviation=_values(codes, morris.deviation),
        ),
    }


def _values(codes: Codes, values: Array) -> dict[str, float]:
    """Values (d,) by code."""
    return dict(zip(codes, values.tolist(), strict=True))


def _intervals(codes: Codes, ends: Array | None) -> dict[str, Interval]:
    """Lower and upper ends (d, 2) by code."""
    return {} if ends is None else {code: (low, high) for code, (low, high) in zip(codes, ends.tolist(), strict=True)}
