"""The HTML page of a comparison of a recording with the model."""

from pathlib import Path
from typing import Final

from tbm_gsa.app.report import compare_figures
from tbm_gsa.app.report.drive_figure import drive_figure
from tbm_gsa.app.report.page import PageHead, PageMachine, embed_figure, recorded_at, render_page
from tbm_gsa.app.report.spectrum_figures import lines_by_kind, spectra, spectrograms
from tbm_gsa.comparison.results import ComparisonResult
from tbm_gsa.comparison.workflow import RecordingComparison
from tbm_gsa.provenance import versions_text
from tbm_msgs_py.base.units import STANDARD_GRAVITY
from tbm_msgs_py.recordings.recording_health import COUNTS

LOW_COVERAGE: Final = 0.9
ALWAYS_SHOWN: Final = ("clipped", "duplicates", "invalid", "undecodable")


def compare_page(compared: RecordingComparison) -> str:
    """Page of a comparison that holds its figures and style."""
    result = compared.result
    points = f"test points {', '.join(result.points)}" if result.points else "drives"
    coverage = {
        name: next(axis.coverage for axis in point.values() if axis.coverage is not None)  # of all alike
        for name, point in result.points.items()
    }
    head = PageHead(
        title="Recording against model",
        subtitle=f"{Path(result.recording.path).name}, machine {result.machine}, {points}",
        data=recorded_at(result.recording.begin, result.recording.duration),
        units=f"accelerations in m/s², velocities in mm/s; 1 g = {STANDARD_GRAVITY:g} m/s²",
        machines=(PageMachine.of(result.machine, result.machine_file),),
    )
    context = {
        "result": result,
        "gravity": STANDARD_GRAVITY,
        "drives": result.drives,
        "drives_figure": result.drives and embed_figure(drive_figure(result.drives), "Torques of the drives"),
        "axis_names": compare_figures.AXIS_NAMES,
        "coverage": coverage,
        "low": [name for name, share in coverage.items() if share < LOW_COVERAGE],
        "low_limit": LOW_COVERAGE,
        "health": {
            name: result.recording.points[name]
            for name in (*result.points, *result.skipped)
            if name in result.recording.points  # a dead sensor has no samples, a missing topic no sensor
        },
        "fault_names": _fault_names(result),
        "provenance": _provenance(result),
    }
    return render_page("compare.html", head, context | (_of_points(compared) if result.points else {}))


def _of_points(compared: RecordingComparison) -> dict[str, object]:
    """Figures of the test points, and what their tables need."""
    result = compared.result
    first, axes = next(iter(result.points.items()))
    return {
        "excerpt": first,
        "band_names": [name.replace("-", " to ").replace("_hz", " Hz") for name in axes["x"].field_band_rms],
        "window_count": max(len(axis.windows.start) for point in result.points.values() for axis in point.values()),
        "most_windows": compare_figures.MOST_WINDOWS,
        "series": embed_figure(
            compare_figures.time_series(*compared.excerpts[first]),
            f"Axial acceleration measured and computed at {first}",
        ),
        "spectra": embed_figure(spectra(result), "Axial power spectral densities"),
        "spectrograms": compared.spectrograms
        and embed_figure(
            spectrograms(result, compared.spectrograms), "Axial power over time and frequency, measured and computed"
        ),
        "expected": lines_by_kind(result.expected_lines),
        "flow": embed_figure(compare_figures.power_flow(result), "RMS of every test point in each direction"),
        "windows": embed_figure(compare_figures.windows(result), "Axial RMS and relative error by window"),
    }


def _fault_names(result: ComparisonResult) -> dict[str, str]:
    """Faults that get a column: the usual ones, and what else was found at any point."""
    found = [name for point in result.recording.points.values() for name in COUNTS if getattr(point, name)]
    return {name: name.replace("_", " ").capitalize() for name in dict.fromkeys((*ALWAYS_SHOWN, *found))}


def _provenance(result: ComparisonResult) -> dict[str, object]:
    """Where the numbers come from, as rows of a table."""
    bands = {f"{band.low_hz:g} to {band.high_hz:g} Hz" for band in result.bands.values()}
    return {
        "recording": result.recording.path,
        "SHA-256 of the recording": result.recording.sha256,
        **dict(line.split(": ", 1) for line in result.sources.lines()),
        **({"sensors off their node": result.off_node} if result.offsets else {}),
        "machine": f"{result.machine} ({result.machine_file.origin})",
        "SHA-256 of the machine": result.machine_file.sha256,
        "model run": f"{result.model_duration:g} s a level after {result.settling:.3g} s of settling, "
        f"time step {result.time_step:g} s, seed {result.seed}",
        **({"compared band": "; ".join(sorted(bands))} if bands else {}),
        "window": f"{result.window_s:g} s",
        "versions": versions_text(result.versions),
    }
