"""The JSON document of a comparison; its keys are a contract, docs/comparison.md lists them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tbm_dynamics import Machine
from tbm_gsa.comparison.expected import ExpectedLine
from tbm_gsa.comparison.field_side import FieldSide
from tbm_gsa.comparison.levels import Course
from tbm_gsa.comparison.offline import AxisComparison, Comparison, PointComparison, Windows
from tbm_gsa.provenance import machine_sha256, package_versions
from tbm_gsa.signals.estimates import SignalStatistics
from tbm_gsa.signals.intervals import CONFIDENCE, Interval
from tbm_msgs_py.bags.metadata import is_synthetic
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.units import STANDARD_GRAVITY
from tbm_msgs_py.recordings.recording import RecordingReader
from tbm_msgs_py.recordings.recording_health import PointHealth

STATISTICS = ("rms", "peak", "crest_factor", "kurtosis", "velocity_rms")
_DIGITS = 8  # significant ones of what is written by the thousand


@dataclass(frozen=True, eq=False)
class Provenance:
    """Where the numbers of a comparison come from.

    Attributes
    ----------
    reader : RecordingReader
        Read to its end.
    machine : Machine
        As described, at no level yet.
    course : Course
    lines : sequence of ExpectedLine
    skipped : mapping of str to str
        Recorded points that were not compared, with the reason.
    seed : int
        Of the model's loads.
    model_duration : float
        Of the run at each level, s.
    """

    reader: RecordingReader
    machine: Machine
    course: Course
    lines: Sequence[ExpectedLine]
    skipped: Mapping[str, str]
    seed: int
    model_duration: float


def comparison_document(field: FieldSide, comparison: Comparison, provenance: Provenance) -> dict[str, Any]:
    """Gather a comparison: what JSON can hold, null where a number is not defined."""
    nodes, course = provenance.machine.description.test_points, provenance.course
    document = {
        "window_s": comparison.window_s,
        "confidence": CONFIDENCE,
        "points": {
            name: {axis: _axis(point, compared) for axis, compared in point.axes.items()}
            for name, point in comparison.points.items()
        },
        "spectra": {name: _spectra(point) for name, point in comparison.points.items()},
        "nodes": {point: nodes[point] for point in comparison.points},
        "bands": {name: _band(point) for name, point in comparison.points.items()},
        "skipped": dict(provenance.skipped),
        "recording": _recording(field, provenance),
        "expected_lines": [
            {"name": line.name, "frequency_hz": line.frequency, "kind": line.kind} for line in provenance.lines
        ],
        "machine": provenance.machine.name,
        "machine_file": {"origin": provenance.machine.origin, "sha256": machine_sha256(provenance.machine)},
        "operating_point": asdict(course.levels[0]),
        "levels": [_level(number, comparison, course) for number in range(len(course.levels))],
        "dwells": [
            {
                "begin": (dwell.begin_ns - field.begin_ns) * 1e-9,
                "end": (dwell.end_ns - field.begin_ns) * 1e-9,
                "kind": dwell.kind,
                "level": dwell.level,
            }
            for dwell in course.dwells
        ],
        "seed": provenance.seed,
        "model_duration": provenance.model_duration,
        "versions": package_versions(),
    }
    return {**document, "synthetic": True} if is_synthetic(provenance.reader.path) else document


@dataclass(frozen=True)
class AxialRow:
    """A row of the paper's Table 2: RMS of the axial acceleration in g; the error None where nothing was measured."""

    point: str
    node: int
    predicted_g: float
    measured_g: float
    relative_error: float | None


def axial_rows(document: Mapping[str, Any]) -> list[AxialRow]:
    """Give the rows of the paper's Table 2 for every compared point, along the power flow."""
    return [
        AxialRow(
            point,
            document["nodes"][point],
            axes["x"]["model_rms_g"],
            axes["x"]["field_rms_g"],
            axes["x"]["relative_error"],
        )
        for point, axes in document["points"].items()
    ]


def stuck_texts(record: Mapping[str, Any]) -> list[str]:
    """Sensor axes that held one value, and for how long."""
    seconds: dict[str, float] = {}
    for axis, begin, end in record["stuck"]:
        seconds[axis] = seconds.get(axis, 0.0) + end - begin
    return [f"{axis} for {time:.3g} s" for axis, time in seconds.items()]


def _axis(point: PointComparison, compared: AxisComparison) -> dict[str, Any]:
    result: dict[str, Any] = {"relative_error": number(compared.relative_error), "coverage": point.coverage}
    intervals: dict[str, Any] = {"relative_error": _interval(compared.error_interval)}
    for side, statistics in (("field", compared.field), ("model", compared.model)):
        result |= {f"{side}_{name}": number(getattr(statistics, name)) for name in STATISTICS}
        intervals |= {f"{side}_{name}": _interval(statistics.intervals[name]) for name in STATISTICS}
        result[f"{side}_rms_g"] = statistics.rms / STANDARD_GRAVITY
        result[f"{side}_band_rms"] = {name: number(value) for name, value in statistics.band_rms.items()}
        intervals[f"{side}_band_rms"] = {name: _interval(value) for name, value in statistics.band_intervals.items()}
        result[f"{side}_lines"] = _lines(statistics)
    return {**result, "intervals": intervals, "windows": _windows(compared.windows)}


def _lines(statistics: SignalStatistics) -> list[dict[str, Any]]:
    low, high = (math.sqrt(factor) for factor in statistics.density_factors)
    return [
        {
            "frequency_hz": line.frequency,
            "rms": line.rms,
            "match": line.match,
            "interval": [low * line.rms, high * line.rms],
        }
        for line in statistics.lines
    ]


def _windows(windows: Windows) -> dict[str, Any]:
    found: dict[str, Any] = {name: _numbers(values) for name, values in windows.arrays().items() if name != "level"}
    found["level"] = [None if level < 0 else level for level in windows.level.tolist()]
    found["field_band_rms"] = {name: _numbers(values) for name, values in windows.field_band_rms.items()}
    return found


def _spectra(point: PointComparison) -> dict[str, Any]:
    spectra = {}
    for axis, compared in point.axes.items():
        sides = {}
        for side, statistics in (("field", compared.field), ("model", compared.model)):
            spectrum = statistics.spectrum
            sides[side] = {
                "resolution_hz": float(spectrum.frequency[1]),
                "density": _numbers(spectrum.density),
                "segments": spectrum.segments,
                "interval_factors": list(statistics.density_factors),
            }
        spectra[axis] = sides
    return spectra


def _level(place: int, comparison: Comparison, course: Course) -> dict[str, Any]:
    points = {}
    for name, point in comparison.points.items():
        axes = {axis: compared.levels[place] for axis, compared in point.axes.items() if place in compared.levels}
        points[name] = {
            axis: {
                "field_rms": one.field.rms,
                "model_rms": one.model.rms,
                "relative_error": number(one.relative_error),
                "intervals": {
                    "field_rms": _interval(one.field.intervals["rms"]),
                    "model_rms": _interval(one.model.intervals["rms"]),
                    "relative_error": _interval(one.error_interval),
                },
            }
            for axis, one in axes.items()
        }
    return {**asdict(course.levels[place]), "points": points}


def _band(point: PointComparison) -> dict[str, float]:
    return {
        "low_hz": point.band.low,
        "high_hz": point.band.high,
        "field_rate_hz": point.field.rate_hz,
        "model_rate_hz": point.model.rate_hz,
    }


def _recording(field: FieldSide, provenance: Provenance) -> dict[str, Any]:
    reader = provenance.reader
    return {
        "path": str(reader.path),
        "messages": reader.messages,
        "lost": reader.lost,
        "truncated": reader.truncated,
        "damaged": reader.damaged,
        "sha256": reader.sha256,
        "duration": (field.end_ns - field.begin_ns) * 1e-9,
        "points": {point: _recorded(health) for point, health in field.health.items()},
    }


def _recorded(health: PointHealth) -> dict[str, Any]:
    return {
        "topic": health.topic,
        "samples": health.samples,
        "rate_hz": health.rate_hz,
        "duration": health.duration,
        "gaps": [list(gap) for gap in health.gaps],
        "stuck": [list(stretch) for stretch in health.stuck],
        **health.counts(),
        "clock_offset": health.clock_offset,
        "clock_drift": health.clock_drift,
        "gravity": health.gravity,
        "frame": health.frame,
    }


def number(value: float) -> float | None:
    """Give a number as JSON has it."""
    return value if math.isfinite(value) else None


def _interval(interval: Interval) -> list[float] | None:
    return list(interval) if all(map(math.isfinite, interval)) else None


def _numbers(values: Array) -> list[float | None]:
    """Numbers to eight digits, for there are thousands."""
    found = np.array([float(f"{value:.{_DIGITS}g}") for value in values.tolist()])
    return [number(value) for value in found.tolist()]
