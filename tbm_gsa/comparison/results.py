"""The result of a comparison: what `compare --json` prints, pages draw, and an explanation reads back.

m/s², m/s, Hz and s, unless a name ends in ``_g``; None, null in JSON, where a number is not defined. The keys are a
contract; docs/comparison.md says what each holds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from tbm_dynamics import Machine
from tbm_dynamics.integration import DEFAULT_STEP
from tbm_gsa.comparison.drive_results import DrivesResult
from tbm_gsa.reading import (
    LARGEST_NUMBER,
    Begin,
    Interval,
    MachineFile,
    Name,
    Number,
    Part,
    PathText,
    Seed,
    Size,
    TextLine,
)
from tbm_msgs_py.base.fields import Vector3
from tbm_msgs_py.recordings.channels import LeftOut
from tbm_msgs_py.recordings.faults import seconds_by_axis
from tbm_msgs_py.recordings.used import UsedSources

BAND = r"^\d+(\.\d+)?-\d+(\.\d+)?_hz$"
COMPARISON: Final = "what `tbm-monitor compare BAG --json` prints"
DIGITS = 8  # significant ones of what is written by the thousand

OperatingKind = Literal["steady", "transient", "standstill", "outside"]
"""The last of what a comparison of a stretch of a recording leaves out."""
LineKind = Literal["load", "mesh", "sideband", "shaft", "axial"]
BandName = Annotated[str, Field(max_length=40, pattern=BAND)]
Duration = Annotated[float, Field(ge=1.0, le=3600.0)]
Numbers = tuple[Number | None, ...]
BandValues = dict[BandName, Size | None]
BandLimits = dict[BandName, Interval | None]


def finite(value: float) -> float | None:
    """Value as JSON has it: None of one that is not finite, or too large to go on with."""
    return float(value) if abs(value) <= LARGEST_NUMBER else None


def finite_interval(interval: tuple[float, float]) -> tuple[float, float] | None:
    """Interval as JSON has it: None unless both ends are known."""
    return None if None in map(finite, interval) else interval


def rounded(values: Iterable[float]) -> tuple[float | None, ...]:
    """Numbers to eight digits, for there are thousands."""
    return tuple(finite(float(f"{value:.{DIGITS}g}")) for value in values)


class SpectralPeak(Part):
    """One of the strongest lines of a signal; `match` names the expected line it is, if any."""

    frequency_hz: Size
    rms: Size | None
    match: str
    interval: Interval | None


class WindowColumns(Part):
    """Window by window along one axis, those without a sample left out; `start` counts from the first sample."""

    start: Numbers
    coverage: Numbers
    relative_error: Numbers
    field_rms: Numbers
    field_peak: Numbers
    field_crest_factor: Numbers
    field_kurtosis: Numbers
    field_velocity_rms: Numbers
    field_line_hz: Numbers
    level: tuple[int | None, ...]
    field_band_rms: dict[BandName, Numbers]


class LevelIntervals(Part):
    """95 % intervals at one level of operation."""

    field_rms: Interval | None
    model_rms: Interval | None
    relative_error: Interval | None


class AxisIntervals(LevelIntervals):
    """95 % intervals of the statistics of one axis."""

    field_peak: Interval | None
    field_crest_factor: Interval | None
    field_kurtosis: Interval | None
    field_velocity_rms: Interval | None
    field_band_rms: BandLimits
    model_peak: Interval | None
    model_crest_factor: Interval | None
    model_kurtosis: Interval | None
    model_velocity_rms: Interval | None
    model_band_rms: BandLimits


class LevelAxis(Part):
    """One axis of one test point at one level of operation."""

    field_rms: Size | None
    model_rms: Size | None
    relative_error: Size | None
    intervals: LevelIntervals


class AxisResult(Part):
    """One axis of one test point, over all windows at a level; the model's levels weigh as long as they were held.

    Of an axis that the sensor does not have all of the field is None, and no window is listed.
    """

    relative_error: Size | None
    coverage: Size | None
    field_rms: Size | None
    field_peak: Size | None
    field_crest_factor: Size | None
    field_kurtosis: Number | None
    field_velocity_rms: Size | None
    field_rms_g: Size | None
    field_band_rms: BandValues
    field_lines: tuple[SpectralPeak, ...]
    model_rms: Size | None
    model_peak: Size | None
    model_crest_factor: Size | None
    model_kurtosis: Number | None
    model_velocity_rms: Size | None
    model_rms_g: Size | None
    model_band_rms: BandValues
    model_lines: tuple[SpectralPeak, ...]
    intervals: AxisIntervals
    windows: WindowColumns

    @model_validator(mode="after")
    def _same_bands(self) -> AxisResult:
        bands = self.field_band_rms.keys()
        others = (self.model_band_rms, self.intervals.field_band_rms, self.intervals.model_band_rms)
        if any(bands != other.keys() for other in others):
            raise ValueError("other bands of the field than of the model")
        return self


class SpectrumResult(Part):
    """Power spectral density from 0 Hz on; `interval_factors` times it are the ends of its 95 % interval."""

    resolution_hz: Size
    density: Numbers
    segments: Size
    interval_factors: Interval


class AxisSpectra(Part):
    """Densities of both signals along one axis."""

    field: SpectrumResult
    model: SpectrumResult


class PointBand(Part):
    """BandName in which a test point was compared, and the sampling rates of both signals."""

    low_hz: Size
    high_hz: Annotated[float, Field(gt=0.0, le=LARGEST_NUMBER)]
    field_rate_hz: Size
    model_rate_hz: Size


class OperatingLevel(Part):
    """Level of operation that the model runs at (inputs x1, x2, x3), how long it was held, and how it was found."""

    speed_r_min: Number
    torque_kn_m: Number
    thrust_kn: Number
    seconds: Size
    source: Literal["recording", "machine"]
    note: str

    def apply(self, machine: Machine) -> Machine:
        """Machine at this level, if it is not the machine's own."""
        if self.source == "machine":
            return machine
        return machine.with_inputs(x1=self.speed_r_min, x2=self.torque_kn_m, x3=self.thrust_kn)


class LevelResult(OperatingLevel):
    """Comparison at one level of operation, by test point and axis."""

    points: dict[Name, dict[Name, LevelAxis]]


class DwellResult(Part):
    """Time in one way of operation, s after the first sample of all, and the number of its level."""

    begin: Number
    end: Number
    kind: OperatingKind
    level: int | None


class ExpectedLine(Part):
    """Line of the loads, of a mesh, its gears or a shaft, or axial natural frequency."""

    name: TextLine
    frequency_hz: Size
    kind: LineKind


class RecordedPoint(Part):
    """What was recorded at one test point, and what was wrong with it.

    `noise_power` is the density of the noise of each axis that the mapping states, m²/s⁴/Hz, and `band_hz` where it
    says that the sensor measures.
    """

    topic: str
    samples: int
    rate_hz: Size
    duration: Size
    gaps: tuple[Interval, ...]
    stuck: tuple[tuple[str, Number, Number], ...]
    clipped: int
    undecodable: int
    unstamped: int = 0
    unmeasured: int = 0
    astray: int
    invalid: int
    duplicates: int
    late: int
    disordered: int
    clock_steps: int
    clock_offset: Number
    clock_drift: Number
    gravity: Literal["included", "removed"]
    frame: Literal["fixed", "rotating"]
    noise_power: Size | None = None
    band_hz: Interval | None = None

    @property
    def longest_gap(self) -> float:
        """Of all gaps, s; zero without one."""
        return max((end - begin for begin, end in self.gaps), default=0.0)

    @property
    def stuck_texts(self) -> list[str]:
        """Sensor axes that held one value, and for how long."""
        return [f"{axis} for {time:.3f} s" for axis, time in seconds_by_axis(self.stuck).items()]


class RecordingResult(Part):
    """The recording as it was read."""

    path: PathText
    messages: int
    lost: int
    truncated: bool
    damaged: int
    sha256: Name
    begin: Begin = ""
    duration: Size
    points: dict[str, RecordedPoint]


@dataclass(frozen=True)
class AxialRow:
    """RMS of the axial acceleration of a test point in g; None where nothing was measured."""

    point: str
    node: int
    predicted_g: float | None
    measured_g: float | None
    relative_error: float | None


class ComparisonResult(Part):
    """A recording held against the model; compared points in their order along the power flow.

    `offsets` are those of sensors that sit off their node, m. `skipped` names points that were not compared, `left_out`
    messages that are not used; `sources` says what is used, and `doubts` what may be wrong with it, a line each.
    `changes` are times at which the vibration changed while the machine was driven alike, s after the first sample.
    `drives` is None where the recording holds none that can be compared.
    """

    window_s: Size
    confidence: Annotated[float, Field(gt=0.0, lt=1.0)]
    points: dict[Name, dict[Name, AxisResult]]
    spectra: dict[Name, dict[Name, AxisSpectra]]
    nodes: dict[Name, int]
    offsets: dict[Name, Vector3] = Field(default_factory=dict)
    bands: dict[Name, PointBand]
    skipped: dict[str, str]
    left_out: tuple[LeftOut, ...] = ()
    recording: RecordingResult
    expected_lines: tuple[ExpectedLine, ...]
    machine: Name
    machine_file: MachineFile
    sources: UsedSources = UsedSources()
    doubts: tuple[str, ...] = ()
    operating_point: OperatingLevel
    levels: tuple[LevelResult, ...]
    dwells: tuple[DwellResult, ...]
    changes: tuple[Number, ...] = ()
    seed: Seed
    model_duration: Duration
    settling: Number = 0.0
    time_step: Number = DEFAULT_STEP
    versions: dict[Name, TextLine]
    synthetic: bool = False
    drives: DrivesResult | None = None

    @model_validator(mode="after")
    def _complete(self) -> ComparisonResult:
        for key, found in (("bands", self.bands), ("spectra", self.spectra), ("nodes", self.nodes)):
            if self.points.keys() != found.keys():
                raise ValueError(f"{key}: other test points than in points")
        if not self.points and self.drives is None:
            raise ValueError("points: none, allowed: at least one, or drives")
        return self

    @model_serializer(mode="wrap")
    def _written(self, serialise: SerializerFunctionWrapHandler) -> dict[str, object]:
        """Leave `synthetic`, `offsets` and `drives` out of the JSON where there is none."""
        written: dict[str, object] = serialise(self)
        return {key: value for key, value in written.items() if value or key not in ("synthetic", "offsets", "drives")}

    @property
    def axial_rows(self) -> list[AxialRow]:
        """Axial accelerations of every compared point, along the power flow."""
        return [
            AxialRow(point, self.nodes[point], axes["x"].model_rms_g, axes["x"].field_rms_g, axes["x"].relative_error)
            for point, axes in self.points.items()
        ]

    @property
    def off_node(self) -> str:
        """Sensors that sit off their node, and by what; empty if none does."""
        arms = {point: ", ".join(f"{value:g}" for value in offset) for point, offset in self.offsets.items()}
        return ", ".join(f"{point} by ({arm}) m" for point, arm in arms.items())

    @property
    def not_at_a_level(self) -> dict[str, float]:
        """Seconds of the recording that are compared at no level, by where they are; empty if there are none."""
        found: dict[str, float] = {}
        for dwell in self.dwells:
            if dwell.level is None:
                where = "outside the stretch" if dwell.kind == "outside" else "between levels or at a standstill"
                found[where] = found.get(where, 0.0) + dwell.end - dwell.begin
        return found

    def model_rms(self, level: int | None, point: str, axis: str) -> float:
        """RMS of the model's run at a level; NaN at none, or at one that was too short at this point to be compared."""
        axes = {} if level is None else self.levels[level].points.get(point, {})
        found = axes[axis].model_rms if axis in axes else None
        return math.nan if found is None else found
