"""The result of an explanation, `explanation.json`; its keys are a contract, docs/rock_or_machine.md lists them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field, model_validator

from tbm_gsa.comparison.results import Duration, OperatingLevel
from tbm_gsa.explanation.observability_result import Observable
from tbm_gsa.reading import (
    Interval,
    MachineFile,
    Maybe,
    Name,
    Number,
    Part,
    RecordingFile,
    Seed,
    Size,
    TextLine,
    read_document,
)
from tbm_gsa.sensitivity.study.distributions import distribution_from
from tbm_msgs_py.base.units import STANDARD_GRAVITY

RESULT_NAME: Final = "explanation.json"
PAGE_NAME: Final = "explanation.html"
"""Beside it."""
Verdict = Literal["rock", "machine", "sensor", "not explained"]
Fault = Literal["gain", "dead", "noise"]

Count = Annotated[int, Field(ge=1, lt=2**31)]


class NoChange(Part):
    """The explanation that nothing has changed."""

    input: None = None
    name: TextLine = "nothing has changed"
    probability: Size
    log_evidence: Maybe


class InputCause(Part):
    """An input as the only change: its value and 90 % interval, beside the machine's own value."""

    input: Name
    name: TextLine
    symbol: TextLine
    unit: TextLine
    kind: TextLine
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
    """A band RMS (m/s²): of the field, of the machine as it stands, as the verdict has it, and in a run of that.

    `deviation` is that of the logarithm of field over prediction; `r2_cv` belonged to a surrogate, and is null.
    """

    name: TextLine
    field: Size
    model: Size
    predicted: Maybe
    checked: Maybe
    deviation: Maybe
    r2_cv: Maybe


class Misfits(Part):
    """Root mean square over all statistics: machine as it stands, as the verdict has it, in a run of that."""

    model: Maybe
    predicted: Maybe
    checked: Maybe


class ExplanationSettings(Part):
    """What an explanation depends on besides the comparison."""

    machine: TextLine
    machine_sha256: Name
    duration: Duration
    load_seed: Seed
    high_hz: Maybe
    samples: Count
    seeds: Count
    model_error: Size
    seed: Seed


class LoadLevel(Part):
    """Factor on the amplitude of a group of loads, its 90 % interval, and the share of the prior's variance gone."""

    value: Size
    interval: Interval
    learnt: Maybe = math.nan

    @property
    def moved(self) -> bool:
        """Whether it is another than the machine file's, 1."""
        return not self.interval[0] <= 1.0 <= self.interval[1]


class SensorState(Part):
    """A channel: gain if it alone were off, with its 90 % interval, null where it says nothing; noise, m/s²/√Hz."""

    gain: Size | None
    gain_interval: Interval | None = None
    noise: Size
    probability: Size = 0.0
    fault: Fault | None = None

    def __str__(self) -> str:
        if self.fault == "dead":
            return "is dead: it shows nothing but noise"
        if self.fault == "noise":
            return f"has too much noise: {1e6 * self.noise / STANDARD_GRAVITY:.3g} µg/√Hz"
        low, high = self.gain_interval or (math.nan, math.nan)
        return f"reads {self.gain or math.nan:.3g} of what it should (90 % interval {low:.3g} to {high:.3g})"


class Explanation(Part):
    """What explains a recording: rock, machine, sensor, or nothing that was looked at.

    Attributes
    ----------
    recording, machine, machine_file, operating_point
        Of the comparison.
    verdict : str
        Where an earlier version wrote the file it has none, and explains nothing.
    probabilities : dict of str to float
        Of the four words.
    loads : dict of str to LoadLevel
        By group, if the verdict is right.
    sensors : dict of str to SensorState
        By channel.
    cannot_be_told : tuple of str
        Inputs without influence on what was recorded.
    doubts : tuple of str
        What may be wrong with the recording, as the comparison says it.
    weightless : dict of str to str
        Band powers that carry no weight, and why.
    largest_deviation : float
        Of a band power, standard deviations, if the verdict is right.
    observable : Observable or None
        What the recording could show; an earlier version wrote none.
    causes : tuple of InputCause or NoChange
        The most probable first; with sensors and what is not explained their probabilities add up to 1.
    joint : Joint
    statistics : tuple of ComparedStatistic
    misfit, standardised_misfit : Misfits
        Of the logarithms of field over model, and in standard deviations.
    explained : bool
        Whether anything does.
    settings : ExplanationSettings
    seconds : float
    versions : dict of str to str
    """

    recording: RecordingFile
    machine: Name
    machine_file: MachineFile
    operating_point: OperatingLevel
    verdict: Verdict = "not explained"
    probabilities: dict[Name, Size] = Field(default_factory=dict)
    loads: dict[Name, LoadLevel] = Field(default_factory=dict)
    sensors: dict[Name, SensorState] = Field(default_factory=dict)
    cannot_be_told: tuple[Name, ...] = ()
    doubts: tuple[TextLine, ...] = ()
    weightless: dict[Name, TextLine] = Field(default_factory=dict)
    largest_deviation: Maybe = math.nan
    observable: Observable | None = None
    causes: Annotated[tuple[InputCause | NoChange, ...], Field(min_length=1)]
    joint: Joint
    statistics: tuple[ComparedStatistic, ...]
    misfit: Misfits
    standardised_misfit: Misfits
    explained: bool
    settings: ExplanationSettings
    seconds: Maybe
    versions: dict[Name, TextLine]

    @model_validator(mode="after")
    def _names_what_it_says(self) -> Explanation:
        if self.verdict == "machine" and not self.inputs:
            raise ValueError("causes: none is an input, which the verdict names")
        if self.verdict == "sensor" and not any(state.fault for state in self.sensors.values()):
            raise ValueError("sensors: none has a fault, which the verdict names")
        return self

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

    def sentence(self) -> str:
        """Say the verdict."""
        sure = f"probability {self.probabilities.get(self.verdict, math.nan):.2f}"
        if self.verdict == "rock":
            moved = [
                f"{group} {level.value:.2f} times the machine's ({level.interval[0]:.2f} to {level.interval[1]:.2f})"
                for group, level in self.loads.items()
                if level.moved
            ]
            loads = "; ".join(moved) or "all as the machine file has them"
            return f"rock: the loads alone explain the recording ({sure}): {loads}"
        if self.verdict == "machine":
            return f"machine: {next(iter(self.inputs.values()))} explains the recording ({sure})"
        if self.verdict == "sensor":
            channel, state = self.faulty
            return f"sensor: {channel} {state} ({sure})"
        return (
            f"not explained: what comes nearest leaves a band power {self.largest_deviation:.1f} standard deviations "
            "off; look for what the model does not have, for two changes at once, or at the sensors"
        )

    def remarks(self) -> list[str]:
        """Say what else there is: loads, sensors, what cannot be told, what carries no weight, and the misfits."""
        off = self.off_by()
        loads = ", ".join(
            f"{group} {level.value:.2f} ({level.interval[0]:.2f} to {level.interval[1]:.2f})"
            for group, level in self.loads.items()
        )
        kinds: dict[str, list[str]] = {}
        for name, reason in self.weightless.items():
            kinds.setdefault(reason, []).append(name)
        remarks = [
            *self.doubts,
            f"level of the loads over the machine file's, with 90 % intervals: {loads}" if loads else "",
            f"cannot be told from this recording: {', '.join(self.cannot_be_told)}" if self.cannot_be_told else "",
            *(f"without weight, {reason}: {', '.join(names)}" for reason, names in kinds.items()),
            f"{len(self.statistics)} band RMS values carry weight: off by a factor of {off.model:.3g} (RMS) as the "
            f"machine stands, {off.predicted:.3g} as the verdict has it, {off.checked:.3g} in a run of the model",
        ]
        return [remark for remark in remarks if remark]

    @property
    def faulty(self) -> tuple[str, SensorState]:
        """Channel that the verdict names, and what is wrong with it."""
        return next((channel, state) for channel, state in self.sensors.items() if state.fault)


class StretchFinding(Part):
    """What explains a stretch of a recording.

    Attributes
    ----------
    begin, end : float
        s after the first sample.
    verdict : str or None
        None where there is none, for the reason that is the sentence.
    sentence : str
    folder : str or None
        Of its explanation.
    """

    begin: Number
    end: Number
    verdict: Verdict | None
    sentence: TextLine
    folder: str | None

    def __str__(self) -> str:
        return f"{self.begin:.0f} to {self.end:.0f} s: {self.sentence}"


def read_explanation(source: Path) -> Explanation:
    """Read an explanation from its file or its folder."""
    file = source / RESULT_NAME if source.is_dir() else source
    return read_document(file, Explanation, f"the {RESULT_NAME} of `tbm-monitor gsa explain`")
