"""The result of a study, ``result.json``: its keys are a contract with whoever reads it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

import numpy as np
from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    WrapSerializer,
    computed_field,
)

from tbm_gsa.provenance import package_versions
from tbm_gsa.reading import Maybe, Part, read_document
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.failures import Failures
from tbm_gsa.sensitivity.study.outputs import Band, bands_text
from tbm_msgs_py.base.arrays import Integers
from tbm_msgs_py.base.files import write_json

if TYPE_CHECKING:
    from tbm_gsa.sensitivity.sobol.indices import SobolIndices
    from tbm_gsa.sensitivity.study.analysis import Analysed, OutputFit
    from tbm_gsa.sensitivity.study.other_methods import OtherMethods
    from tbm_gsa.sensitivity.study.spectra import PartOfSpectrum, SpectrumAnalysis
    from tbm_gsa.sensitivity.study.store import Store

RESULT_NAME: Final = "result.json"
REPORT_NAME: Final = "report.html"
TABLES_NAME: Final = "tables"
INDICES: Final = (
    "closed form of the surrogate, sampled where its output was transformed; "
    "intervals: delete-a-group jackknife over the folds, 95 %"
)
STRONGEST: Final = 5
"""Inputs that a table or figure shows of an output."""

LOWEST_R2: Final = 0.5
"""R² of the cross validation below which a surrogate does not follow its output: its indices are not determined."""
NOT_DETERMINED: Final = "not determined"
"""What stands in place of such an index wherever people read it; JSON keeps the number and says so beside it."""

# Interactions below this share of the variance are left out.
SMALLEST_INTERACTION: Final = 1e-3

Codes: TypeAlias = tuple[str, ...]


def _by_code(given: object, info: ValidationInfo) -> object:
    """Return the rows of an array by the codes of the context; a mapping as it is, an empty one for None."""
    if isinstance(given, np.ndarray):
        return dict(zip(info.context or (), given.tolist(), strict=True))
    return {} if given is None else given


IndexInterval: TypeAlias = tuple[Maybe, Maybe]
ByCode = Annotated[dict[str, Maybe], BeforeValidator(_by_code)]
IntervalsByCode = Annotated[dict[str, IndexInterval], BeforeValidator(_by_code)]


class ResultPart(Part):
    """Base of the parts of a study, made of the attributes of what was found; arrays by the codes of the context."""

    model_config = ConfigDict(from_attributes=True, strict=False, allow_inf_nan=True)


class IndexTable(ResultPart):
    """First-order (S1) and total (ST) indices with intervals, by input or group; no intervals where none are known."""

    first: ByCode
    total: ByCode
    first_interval: IntervalsByCode
    total_interval: IntervalsByCode


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
    index: Maybe
    interval: IndexInterval


class PathSpread(ResultPart):
    """An index over conditional Kriging paths, by input: mean, 95 %, deviations by the surrogate and by sampling."""

    mean: ByCode
    interval: IntervalsByCode
    metamodel: ByCode
    monte_carlo: ByCode


class PathTable(ResultPart):
    """Indices over conditional Kriging paths, and the sizes of their sampling."""

    samples: int
    paths: int
    resamples: int
    first: PathSpread
    total: PathSpread


class MorrisTable(ResultPart):
    """Elementary effects by input, in the unit of the output per range of the input: μ, μ* with its 95 %, σ."""

    mean: ByCode
    mean_absolute: ByCode
    mean_absolute_interval: IntervalsByCode
    deviation: ByCode


class SurrogateScores(ResultPart):
    """Quality of a surrogate in cross validation and on the test points; errors in the unit of the output."""

    transform: str
    r2_cv: Maybe
    r2_test: float | None
    rmse_cv: Maybe
    rmse_test: float | None
    largest_error_cv: Maybe
    largest_error_test: float | None

    @computed_field  # type: ignore[prop-decorator]  # of pydantic
    @property
    def determined(self) -> bool:
        """Whether the surrogate follows its output, so that its indices say something of it."""
        return is_determined(self.r2_cv)


def is_determined(r2_cv: float) -> bool:
    """Whether indices of a surrogate with this R² say something of its output."""
    return r2_cv >= LOWEST_R2


class SeedShare(ResultPart):
    """Share of chance in an output: indices of the loads' realisation, S1 with its interval, ST at most."""

    first: Maybe
    first_interval: IndexInterval
    total: Maybe


class OutputResult(MethodIndices, SurrogateScores):
    """Everything found about one output: the chosen surrogate, its indices, and what other methods find.

    `second` holds the largest interactions, largest first; `groups` is empty where the study has no groups, `paths`
    null where there is no Kriging surrogate; `outliers` are the numbers of simulations that lie far from what the
    others say; `seed` is the share of chance, null where all simulations share one realisation of the loads; `scores`
    holds the quality of every surrogate. Of a quick study `second`, `by_surrogate` and `convergence` are empty,
    `paths`, `fast` and `morris` null.
    """

    surrogate: str
    r2_nested: Maybe
    outliers: tuple[int, ...] = ()
    seed: SeedShare | None = None
    second: tuple[Interaction, ...]
    groups: Annotated[
        IndexTable | None,
        BeforeValidator(lambda given: given or None),
        WrapSerializer(lambda table, dump: dump(table) or {}),
    ]
    paths: PathTable | None
    by_surrogate: dict[str, MethodIndices]
    convergence: tuple[ConvergenceIndices, ...]
    fast: IndexTable | None
    morris: MorrisTable | None
    scores: dict[str, SurrogateScores]

    def strongest(self) -> list[str]:
        """Codes of the inputs with the largest total indices, largest first."""
        return sorted(self.total, key=self.total.__getitem__, reverse=True)[:STRONGEST]


class SpectrumPart(IndexTable):
    """Indices of a part of a spectrum, and R² of the cross validation of its surrogate."""

    r2_cv: Maybe

    @computed_field  # type: ignore[prop-decorator]  # of pydantic
    @property
    def determined(self) -> bool:
        """Whether the surrogate follows this part, so that its indices say something of it."""
        return is_determined(self.r2_cv)


class SpectrumBand(SpectrumPart):
    """A band from `low` to `high` (Hz): mean and standard deviation of its level over the design, dB over 1 m/s²."""

    low: float
    high: float
    mean: float
    deviation: float


class SpectrumComponent(SpectrumPart):
    """A component of the levels: its share of their variance, and its shape over the bands, of unit length."""

    share: float
    shape: tuple[float, ...]


class SpectrumResult(SpectrumPart):
    """Everything found about a spectrum; its own indices are the generalised ones, of all bands together.

    `held` is the share of the variance of the levels that the components hold, `left_out` says which bands are
    missing, and why.
    """

    surrogate: str
    r2_test: float | None
    bands: tuple[SpectrumBand, ...]
    components: tuple[SpectrumComponent, ...]
    held: float
    left_out: tuple[str, ...]

    def leading(self) -> dict[str, list[Band]]:
        """Bands by the input with the largest total index in them, under `NOT_DETERMINED` those of a poor surrogate."""
        found: dict[str, list[Band]] = {}
        for band in self.bands:
            input_ = max(band.total, key=band.total.__getitem__) if band.determined else NOT_DETERMINED
            found.setdefault(input_, []).append((band.low, band.high))
        return found

    def text(self) -> str:
        """Which input leads where, and how well the surrogate knows."""
        leading = self.leading()
        unknown = leading.pop(NOT_DETERMINED, [])
        parts = [f"{code} leads in {bands_text(bands)}" for code, bands in leading.items()]
        parts += [f"{NOT_DETERMINED} in {bands_text(unknown)}"] if unknown else []
        count = len(self.components)
        components = "1 component holds" if count == 1 else f"{count} components hold"
        return f"{', '.join(parts)}; {components} {self.held:.1%} of the variance"


class SampleCounts(ResultPart):
    """Training and test simulations that were planned, how many of them failed, and how many have not ended."""

    train: int
    test: int
    failed: int
    pending: int = 0


class Failure(ResultPart):
    """A simulation that failed."""

    row: int
    reason: str


class StudyResult(ResultPart):
    """A finished study: the outputs and whole spectra by name, and where their numbers come from.

    `failure_summary` says how many simulations failed, where and why, null without one; `skipped` why an output that
    was asked for is not among the outputs; `realisations` how many of the loads the simulations shared out, 0 where one
    was common to all. Times in s: `seconds` of this run, `campaign_seconds` of it for the
    campaign, `simulation_seconds` of processor time in all simulations.
    """

    outputs: dict[str, OutputResult]
    spectra: dict[str, SpectrumResult] = Field(default_factory=dict)
    seconds: float
    campaign_seconds: float
    simulation_seconds: float
    groups: dict[str, tuple[str, ...]]
    inputs: dict[str, dict[str, str | float]]
    samples: SampleCounts
    failures: tuple[Failure, ...]
    failure_summary: Failures | None = None
    skipped: dict[str, str] = Field(default_factory=dict)
    design: str
    seed: int
    realisations: int = 0
    settings: dict[str, str | int | float]
    indices: str
    versions: dict[str, str]

    @classmethod
    def of(
        cls,
        store: Store,
        analysed: Analysed,
        others: Mapping[str, OtherMethods],
        *,
        seconds: float,
        campaign_seconds: float,
    ) -> StudyResult:
        """Gather the result of a finished store and what was found about it; times as in the class."""
        problem, counts = store.problem, store.counts()
        codes, groups = problem.inputs.codes, tuple(problem.inputs.groups)
        return StudyResult(
            outputs={
                name: _output(fit, others.get(name), codes, groups, store.rows("train"))
                for name, fit in analysed.outputs.items()
            },
            spectra={name: _spectrum(analysis, codes) for name, analysis in analysed.spectra.items()},
            seconds=seconds,
            campaign_seconds=campaign_seconds,
            simulation_seconds=store.simulation_seconds(),
            groups=dict(problem.inputs.groups),
            inputs={item.code: item.to_dict() for item in problem.inputs.inputs},
            samples=SampleCounts(
                train=problem.train, test=problem.test, failed=counts.failed, pending=counts.total - counts.done
            ),
            failures=tuple(Failure(row=row, reason=reason) for row, reason in store.failures()),
            failure_summary=Failures.of(store),
            skipped=dict(analysed.skipped),
            design=problem.design,
            seed=problem.seed,
            realisations=problem.realisations,
            settings=dict(problem.settings),
            indices=INDICES,
            versions=package_versions(),
        )

    def judged(self) -> dict[str, OutputResult | SpectrumResult]:
        """Return outputs and spectra by name: whatever has a surrogate."""
        return {**self.outputs, **self.spectra}

    def doubts(self) -> list[str]:
        """Sentences that stand above the indices: what failed, what was left out, what is not determined."""
        doubts = []
        if self.failure_summary is not None:
            extrapolated = ", where indices are extrapolated" if self.failure_summary.regions else ""
            warning = "warning: " if self.failure_summary.warned else ""
            doubts.append(f"{warning}{self.failure_summary.text()}; they are left out{extrapolated}")
        if self.samples.pending:
            doubts.append(f"warning: {self.samples.pending} simulations have not ended; `gsa resume` goes on with them")
        doubts += [f"output {name} is left out: {reason}" for name, reason in self.skipped.items()]
        if poor := [f"{name} ({output.r2_cv:.2f})" for name, output in self.outputs.items() if not output.determined]:
            names = ", ".join(poor)
            doubts.append(
                f"{NOT_DETERMINED}, for R² of the cross validation is below {LOWEST_R2:g}: indices of {names}"
            )
        tested = {name: output.r2_test for name, output in self.judged().items() if output.determined}
        if poor := [f"{name} ({r2:.2f})" for name, r2 in tested.items() if r2 is not None and r2 < LOWEST_R2]:
            doubts.append(f"in doubt, for R² on the test points is below {LOWEST_R2:g}: indices of {', '.join(poor)}")
        doubts += [
            f"output {name}: simulation {', '.join(map(str, output.outliers[:STRONGEST]))} lies far from what the "
            "others say; one such spoils R² and indices"
            for name, output in self.outputs.items()
            if output.outliers
        ]
        return doubts

    def write(self, path: Path) -> None:
        """Write the result as JSON, whole or not at all."""
        write_json(path, self.model_dump())

    @classmethod
    def read(cls, path: Path) -> StudyResult:
        """Read what `write` wrote; a StudyError of one line for any other file."""
        return read_document(path, cls, "the result of a study", StudyError)


def _output(fit: OutputFit, other: OtherMethods | None, codes: Codes, groups: Codes, rows: Integers) -> OutputResult:
    """Gather the result of one output."""
    followed = tuple(codes[k] for k in other.places) if other else ()
    return OutputResult(
        **dict(MethodIndices.model_validate(fit.indices, context=codes)),
        **dict(SurrogateScores.model_validate(fit.best)),
        surrogate=fit.chosen,
        r2_nested=fit.nested_r2,
        outliers=tuple(rows[fit.best.validation.outliers].tolist()),
        seed=fit.chance and SeedShare.model_validate(fit.chance),
        second=_interactions(other.pairs, codes) if other else (),
        groups=fit.groups and IndexTable.model_validate(fit.groups, context=groups),
        paths=other and other.paths and PathTable.model_validate(other.paths, context=codes),
        by_surrogate={
            method: MethodIndices.model_validate(found, context=codes)
            for method, found in (other.surrogates if other else {}).items()
        },
        convergence=tuple(
            ConvergenceIndices(
                asked=step.asked,
                samples=step.samples,
                **dict(IndexTable.model_validate(step.indices, context=followed)),
            )
            for step in (other.convergence if other else ())
        ),
        fast=other and IndexTable.model_validate(other.fast, context=codes),
        morris=other and MorrisTable.model_validate(other.morris, context=codes),
        scores={method: SurrogateScores.model_validate(found) for method, found in fit.candidates.items()},
    )


def _spectrum(analysis: SpectrumAnalysis, codes: Codes) -> SpectrumResult:
    """Gather the result of a spectrum."""

    def indices(part: PartOfSpectrum) -> dict[str, object]:
        return {**dict(IndexTable.model_validate(part.indices, context=codes)), "r2_cv": part.r2_cv}

    components = analysis.components
    moments = analysis.level.mean(axis=0).tolist(), analysis.level.std(axis=0).tolist()
    return SpectrumResult(
        **indices(analysis.whole),
        surrogate="prs",
        r2_test=analysis.r2_test,
        bands=tuple(
            SpectrumBand(**indices(part), low=low, high=high, mean=mean, deviation=deviation)
            for part, (low, high), mean, deviation in zip(analysis.by_band, analysis.bands, *moments, strict=True)
        ),
        components=tuple(
            SpectrumComponent(**indices(part), share=share, shape=tuple(shape))
            for part, share, shape in zip(
                analysis.by_component, components.shares.tolist(), components.shapes.T.tolist(), strict=True
            )
        ),
        held=float(components.shares.sum()),
        left_out=analysis.left_out,
    )


def _interactions(indices: SobolIndices, codes: Codes) -> tuple[Interaction, ...]:
    """Gather second-order indices with intervals, largest first."""
    second, interval = indices.second, indices.second_interval
    if second is None or interval is None:
        return ()
    pairs = [(j, k) for j in range(len(codes)) for k in range(j) if second[j, k] >= SMALLEST_INTERACTION]
    return tuple(
        Interaction(inputs=(codes[k], codes[j]), index=float(second[j, k]), interval=tuple(interval[j, k].tolist()))
        for j, k in sorted(pairs, key=lambda pair: -second[pair])
    )
