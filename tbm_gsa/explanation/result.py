"""The result of an explanation, `explanation.json`; its keys are a contract, docs/sensitivity.md lists them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import numpy as np
from pydantic import Field, model_validator

from tbm_gsa.comparison.results import Duration, OperatingLevel
from tbm_gsa.reading import (
    Interval,
    Line,
    MachineFile,
    Maybe,
    Name,
    Number,
    Part,
    RecordingFile,
    Seed,
    Size,
    read_document,
)
from tbm_gsa.sensitivity.study.distributions import distribution_from
from tbm_gsa.sensitivity.study.failures import Failures

RESULT_NAME: Final = "explanation.json"
LARGEST_MISFIT: Final = 2.0
"""Standard deviations that the statistics may be off by (root mean square) where a cause explains a recording."""

Count = Annotated[int, Field(ge=1, lt=2**31)]


def explains(standardised_misfit: float) -> bool:
    """Whether what a cause leaves, in standard deviations, is small enough; probabilities only rank the causes."""
    return standardised_misfit <= LARGEST_MISFIT


class NoChange(Part):
    """The explanation that nothing has changed."""

    input: None = None
    name: Line = "nothing has changed"
    probability: Size
    log_evidence: Maybe


class InputCause(Part):
    """An input as the only change: its value and 90 % interval, beside the machine's own value."""

    input: Name
    name: Line
    symbol: Line
    unit: Line
    kind: Line
    probability: Size
    log_evidence: Maybe
    value: Number
    interval: Interval
    machine_value: Number

    def __str__(self) -> str:
        low, high = self.interval
        return (
            f"{self.input} ({self.name}) {self.machine_value:.4g} to {self.value:.4g} {self.unit}".rstrip()
            + f" (90 % interval {low:.4g} to {high:.4g})"
        )


class JointInput(Part):
    """An input of the joint posterior: value, 90 % interval, share of its range that was learnt, range searched."""

    value: Number
    interval: Interval
    machine_value: Number
    learnt: Maybe
    lower: Number
    upper: Number
    distribution: Name

    def shares(self) -> tuple[float, float, float]:
        """Place the ends of the interval and the machine's value in the range, 0 to 1 by its distribution."""
        law = distribution_from({key: getattr(self, key) for key in ("distribution", "lower", "upper")})
        low, high, own = law.to_unit([*self.interval, self.machine_value]).tolist()
        return low, high, own


class Joint(Part):
    """Posterior of all inputs at once, and how far its most probable sample is off in standard deviations."""

    inputs: dict[Name, JointInput]
    accepted: Maybe
    effective_samples: Maybe
    standardised_misfit: Maybe


class ComparedStatistic(Part):
    """A statistic (m/s²): of the field, of the model as compared, predicted and checked after the first input."""

    name: Line
    field: Size
    model: Size
    predicted: Maybe
    checked: Maybe
    deviation: Maybe
    r2_cv: Maybe


class Misfits(Part):
    """Root mean square over all statistics: as compared, as predicted and as checked after the first input."""

    model: Maybe
    predicted: Maybe
    checked: Maybe


class ExplanationSettings(Part):
    """What an explanation depends on besides the comparison."""

    machine: Line
    machine_sha256: Name
    duration: Duration
    load_seed: Seed
    high_hz: Maybe
    samples: Count
    seeds: Count
    model_error: Size
    seed: Seed


class Explanation(Part):
    """Which inputs explain a recording.

    Attributes
    ----------
    recording, machine, machine_file, operating_point
        Of the comparison.
    causes : tuple of InputCause or NoChange
        The most probable first.
    joint : Joint
    statistics : tuple of ComparedStatistic
    misfit, standardised_misfit : Misfits
        Of the logarithms of field over model, and in standard deviations.
    explained : bool
        Whether the first cause explains the recording.
    failure_summary : Failures or None
        Simulations of the campaign that failed.
    settings : ExplanationSettings
    seconds : float
    versions : dict of str to str
    """

    recording: RecordingFile
    machine: Name
    machine_file: MachineFile
    operating_point: OperatingLevel
    causes: Annotated[tuple[InputCause | NoChange, ...], Field(min_length=1)]
    joint: Joint
    statistics: tuple[ComparedStatistic, ...]
    misfit: Misfits
    standardised_misfit: Misfits
    explained: bool
    failure_summary: Failures | None = None
    settings: ExplanationSettings
    seconds: Maybe
    versions: dict[Name, Line]

    @model_validator(mode="after")
    def _joint_causes(self) -> Explanation:
        for cause in self.inputs:
            if cause not in self.joint.inputs:
                raise ValueError(f"joint.inputs: no {cause}, which is among the causes")
        return self

    @property
    def inputs(self) -> dict[str, InputCause]:
        """Causes that are inputs, by code, the most probable first."""
        return {cause.input: cause for cause in self.causes if isinstance(cause, InputCause)}

    def off_by(self) -> Misfits:
        """Factors that the statistics are off by."""
        return Misfits(**{name: float(np.exp(value)) for name, value in self.misfit})

    def together(self, codes: list[str]) -> list[InputCause]:
        """Causes with the values that they have together with all other inputs."""
        joint = {code: self.joint.inputs[code] for code in codes}
        return [
            self.inputs[code].model_copy(update={"value": found.value, "interval": found.interval})
            for code, found in joint.items()
        ]

    def verdict(self) -> str:
        """Whether the first cause explains the recording, and whether all inputs together could, as a sentence."""
        first, off = self.causes[0], self.standardised_misfit
        subject, size = (
            ("that nothing has changed", off.model)
            if isinstance(first, NoChange)
            else (f"{first.input} alone", off.checked)
        )
        judged = "explains" if self.explained else "does not explain"
        text = f"{subject} {judged} the recording: {size:.1f} standard deviations off (RMS)"
        if self.explained:
            return text
        together = self.joint.standardised_misfit
        more = f"nor do all inputs together ({together:.1f}): look for what the model does not have, or at the sensors"
        if explains(together):
            more = f"all inputs together could ({together:.1f} as predicted)"
        return f"{text}, at most {LARGEST_MISFIT:g} allowed; the probabilities only rank the causes; {more}"


def read_explanation(source: Path) -> Explanation:
    """Read an explanation from its file or its folder."""
    file = source / RESULT_NAME if source.is_dir() else source
    return read_document(file, Explanation, f"the {RESULT_NAME} of `tbm-monitor gsa explain`")
