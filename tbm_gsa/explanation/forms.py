"""What an explanation reads of a comparison."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from tbm_gsa.reading import Interval, Line, MachineFile, Name, Number, Part, RecordingFile, Seed, Size

COMPARISON: Final = "what `tbm-monitor compare BAG --json` prints"
BAND: Final = r"^\d+(\.\d+)?-\d+(\.\d+)?_hz$"

Band = Annotated[str, Field(max_length=40, pattern=BAND)]
Bands = dict[Band, Size | None]
BandIntervals = dict[Band, Interval | None]
Duration = Annotated[float, Field(ge=1.0, le=3600.0)]


class _Intervals(Part):
    field_rms: Interval | None
    model_rms: Interval | None
    field_band_rms: BandIntervals
    model_band_rms: BandIntervals


class ComparedAxis(Part):
    """One axis of a test point: RMS (m/s²), whole and in bands, of the field and of the model, with intervals."""

    field_rms: Size | None
    model_rms: Size | None
    field_band_rms: Bands
    model_band_rms: Bands
    intervals: _Intervals

    @model_validator(mode="after")
    def _same_bands(self) -> ComparedAxis:
        bands = self.field_band_rms.keys()
        others = (self.model_band_rms, self.intervals.field_band_rms, self.intervals.model_band_rms)
        if any(bands != other.keys() for other in others):
            raise ValueError("other bands of the field than of the model")
        return self


class _PointBand(Part):
    high_hz: Annotated[float, Field(gt=0.0, le=1e6)]


class OperatingLevel(Part):
    """Level of operation that the model ran at, how long it was held, and where it comes from."""

    speed_r_min: Number
    torque_kn_m: Number
    thrust_kn: Number
    seconds: Size
    source: Literal["recording", "machine"]
    note: Line


class _ComparedRecording(RecordingFile):
    duration: Annotated[float, Field(gt=0.0, le=1e9)]


class ComparisonForm(Part):
    """What an explanation needs of a comparison."""

    confidence: Annotated[float, Field(gt=0.0, lt=1.0)]
    points: dict[Name, dict[Name, ComparedAxis]]
    bands: Annotated[dict[Name, _PointBand], Field(min_length=1)]
    recording: _ComparedRecording
    machine: Name
    machine_file: MachineFile
    operating_point: OperatingLevel
    model_duration: Duration
    seed: Seed

    @model_validator(mode="after")
    def _bands_of_points(self) -> ComparisonForm:
        for point in self.points:
            if point not in self.bands:
                raise ValueError(f"bands: none of point {point}")
        return self
