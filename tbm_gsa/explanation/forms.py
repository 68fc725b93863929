"""What an explanation reads of a comparison, and what is read of an explanation."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from tbm_gsa.reading import Line, Name, Number, Pair, Part, Seed, Size

COMPARISON: Final = "what `tbm-monitor compare BAG --json` prints"
EXPLANATION: Final = "the explanation.json of `tbm-monitor gsa explain`"
BAND: Final = r"^\d+(\.\d+)?-\d+(\.\d+)?_hz$"

Band = Annotated[str, Field(max_length=40, pattern=BAND)]
Bands = dict[Band, Size | None]
BandIntervals = dict[Band, Pair | None]
Duration = Annotated[float, Field(ge=1.0, le=3600.0)]


class _MachineFile(Part):
    origin: Line
    sha256: Name


class _Recording(Part):
    path: Line
    sha256: Name


class _Intervals(Part):
    field_rms: Pair | None
    model_rms: Pair | None
    field_band_rms: BandIntervals
    model_band_rms: BandIntervals


class _Axis(Part):
    field_rms: Size | None
    model_rms: Size | None
    field_band_rms: Bands
    model_band_rms: Bands
    intervals: _Intervals

    @model_validator(mode="after")
    def _same_bands(self) -> _Axis:
        bands = self.field_band_rms.keys()
        others = (self.model_band_rms, self.intervals.field_band_rms, self.intervals.model_band_rms)
        if any(bands != other.keys() for other in others):
            raise ValueError("other bands of the field than of the model")
        return self


class _PointBand(Part):
    high_hz: Annotated[float, Field(gt=0.0, le=1e6)]


class _Level(Part):
    speed_r_min: Number
    torque_kn_m: Number
    thrust_kn: Number
    source: Literal["recording", "machine"]


class _ComparedRecording(_Recording):
    duration: Annotated[float, Field(gt=0.0, le=1e9)]


class ComparisonForm(Part):
    """What an explanation needs of a comparison."""

    confidence: Annotated[float, Field(gt=0.0, lt=1.0)]
    points: dict[Name, dict[Name, _Axis]]
    bands: Annotated[dict[Name, _PointBand], Field(min_length=1)]
    recording: _ComparedRecording
    machine: Name
    machine_file: _MachineFile
    operating_point: _Level
    model_duration: Duration
    seed: Seed

    @model_validator(mode="after")
    def _bands_of_points(self) -> ComparisonForm:
        for point in self.points:
            if point not in self.bands:
                raise ValueError(f"bands: none of point {point}")
        return self


class _Nothing(Part):
    input: None
    probability: Size


class _Cause(Part):
    input: Name
    name: Line
    unit: Line
    probability: Size
    value: Number
    interval: Pair
    machine_value: Number


class _JointInput(Part):
    value: Number
    interval: Pair


class _Joint(Part):
    inputs: dict[Name, _JointInput]
    standardised_misfit: Size


class _Misfits(Part):
    model: Size
    checked: Size


class _Settings(Part):
    samples: Annotated[int, Field(ge=1, lt=2**31)]
    duration: Duration
    seed: Seed


class ExplanationForm(Part):
    """What `machine update` needs of an explanation."""

    causes: Annotated[list[_Cause | _Nothing], Field(min_length=1)]
    joint: _Joint
    standardised_misfit: _Misfits
    explained: bool
    recording: _Recording
    machine_file: _MachineFile
    settings: _Settings
    versions: dict[Name, Line]

    @model_validator(mode="after")
    def _joint_causes(self) -> ExplanationForm:
        for cause in self.causes:
            if cause.input is not None and cause.input not in self.joint.inputs:
                raise ValueError(f"joint.inputs: no {cause.input}, which is among the causes")
        return self
