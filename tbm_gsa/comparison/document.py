"""The JSON document of a comparison; its keys are a contract with whoever reads it."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tbm_dynamics import Machine
from tbm_gsa.comparison.expected import ExpectedLine
from tbm_gsa.comparison.offline import Comparison, PointComparison
from tbm_gsa.comparison.operating import Operating
from tbm_gsa.study.document import package_versions
from tbm_msgs_py.recording import AccelerationRecord, Recording


@dataclass(frozen=True, eq=False)
class Provenance:
    """Where the numbers of a comparison come from.

    Attributes
    ----------
    machine : Machine
        At the operating point of the run.
    operating : Operating
    lines : sequence of ExpectedLine
    skipped : mapping of str to str
        Recorded points that were not compared, with the reason.
    seed : int
        Of the model's loads.
    model_duration : float
        s.
    """

    machine: Machine
    operating: Operating
    lines: Sequence[ExpectedLine]
    skipped: Mapping[str, str]
    seed: int
    model_duration: float


def comparison_document(recording: Recording, comparison: Comparison, provenance: Provenance) -> dict[str, Any]:
    """Gather a comparison.

    Returns
    -------
    dict
        ``points{point: {axis: …}}`` and ``window_s`` as `Comparison.to_dict` gives them; ``nodes``, ``bands`` and
        ``skipped`` by point; ``recording{path, messages, lost, truncated, sha256, duration, points{…}}``;
        ``expected_lines``, ``machine``, ``operating_point``, ``seed``, ``model_duration``, ``versions``; and
        ``synthetic``, true, if the recording's own notes call it so.
    """
    nodes = provenance.machine.description.test_points
    document = {
        **comparison.to_dict(),
        "nodes": {point: nodes[point] for point in comparison.points},
        "bands": {name: _band(point) for name, point in comparison.points.items()},
        "skipped": dict(provenance.skipped),
        "recording": _recording(recording),
        "expected_lines": [
            {"name": line.name, "frequency_hz": line.frequency, "kind": line.kind} for line in provenance.lines
        ],
        "machine": provenance.machine.name,
        "operating_point": asdict(provenance.operating),
        "seed": provenance.seed,
        "model_duration": provenance.model_duration,
        "versions": package_versions(),
    }
    return {**document, "synthetic": True} if _called_synthetic(recording.path) else document


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


def _band(point: PointComparison) -> dict[str, float]:
    return {
        "low_hz": point.band.low,
        "high_hz": point.band.high,
        "field_rate_hz": point.field_rate_hz,
        "model_rate_hz": point.model_rate_hz,
    }


def _recording(recording: Recording) -> dict[str, Any]:
    records = recording.points.values()
    begin = min(record.start_ns for record in records)
    return {
        "path": str(recording.path),
        "messages": recording.messages,
        "lost": recording.lost,
        "truncated": recording.truncated,
        "sha256": recording.sha256,
        "duration": max((record.start_ns - begin) * 1e-9 + record.duration for record in records),
        "points": {point: _record(record) for point, record in recording.points.items()},
    }


def _record(record: AccelerationRecord) -> dict[str, Any]:
    return {
        "topic": record.topic,
        "samples": len(record.time),
        "rate_hz": record.rate_hz,
        "duration": record.duration,
        "gaps": [list(gap) for gap in record.gaps],
        "clipped": record.clipped,
        "duplicates": record.duplicates,
        "invalid": record.invalid,
        "undecodable": record.undecodable,
        "gravity": record.gravity,
        "frame": record.frame,
    }


def _called_synthetic(path: Path) -> bool:
    """Whether the README.md in the folder of a recording says the word; a bare file has no notes of its own."""
    notes = path / "README.md"
    return notes.is_file() and re.search(r"\bsynthetic\b", notes.read_text("utf-8", "replace"), re.I) is not None
