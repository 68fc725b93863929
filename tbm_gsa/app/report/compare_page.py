"""The HTML page of a comparison of a recording with the model."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from tbm_gsa.app.report import compare_figures
from tbm_gsa.app.report.page import embed_figure, render_page
from tbm_gsa.comparison.document import axial_rows, stuck_texts
from tbm_gsa.comparison.workflow import ComparisonResult
from tbm_msgs_py.base.files import write_whole
from tbm_msgs_py.recordings.recording_health import COUNTS

LOW_COVERAGE: Final = 0.9
ALWAYS_SHOWN: Final = ("clipped", "duplicates", "invalid", "undecodable")


def compare_page(result: ComparisonResult) -> str:
    """Render a comparison as a page that holds its figures and style."""
    document = result.document
    points = ", ".join(document["points"])
    context = {
        "title": "Recording against model",
        "subtitle": f"{document['recording']['path']}, machine {document['machine']}, test points {points}",
        "document": document,
        "rows": axial_rows(document),
        "axis_names": compare_figures.AXIS_NAMES,
        "axes": list(_axes(document)),
        "low": [name for name, point in result.comparison.points.items() if point.coverage < LOW_COVERAGE],
        "low_limit": LOW_COVERAGE,
        "health": [_health(document, name) for name in [*document["points"], *document["skipped"]]],
        "excerpt": next(iter(result.comparison.points)),
        "levels": document["levels"],
        "left_out": [dwell for dwell in document["dwells"] if dwell["level"] is None],
        "fault_names": _fault_names(document),
        "band_names": [
            name.replace("-", " to ").replace("_hz", " Hz") for name in _first_axis(document)["field_band_rms"]
        ],
        "window_count": max(len(axes["x"]["windows"]["start"]) for axes in document["points"].values()),
        "provenance": _provenance(document),
        **_figures(result),
    }
    return render_page("compare.html", context)


def write_page(result: ComparisonResult, path: Path) -> None:
    """Write the page so that a reader sees the old file or the new one, never half of it."""
    write_whole(path, compare_page(result).encode())


def _fault_names(document: Mapping[str, Any]) -> dict[str, str]:
    """Faults to give a column: the usual ones, and what else was found at any point."""
    records = document["recording"]["points"].values()
    found = [name for record in records for name in COUNTS if record[name]]
    return {name: name.replace("_", " ").capitalize() for name in dict.fromkeys((*ALWAYS_SHOWN, *found))}


def _first_axis(document: Mapping[str, Any]) -> Mapping[str, Any]:
    axes: Mapping[str, Mapping[str, Any]] = next(iter(document["points"].values()))
    return axes["x"]


def _axes(document: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Rows of the table of every point and axis."""
    for name, axes in document["points"].items():
        for axis, values in axes.items():
            yield {"point": name, "axis": axis, "first": axis == "x", "span": len(axes), **values}


def _health(document: Mapping[str, Any], name: str) -> dict[str, Any]:
    """One recorded point in the table of the recording's health."""
    record = document["recording"]["points"][name]
    gaps = [end - begin for begin, end in record["gaps"]]
    compared = document["points"].get(name)
    return {
        "point": name,
        **record,
        "gap_count": len(gaps),
        "longest": max(gaps, default=0.0),
        "stuck": stuck_texts(record),
        "coverage": compared["x"]["coverage"] if compared else None,
    }


def _figures(result: ComparisonResult) -> dict[str, str]:
    """Draw the figures as image elements."""
    comparison = result.comparison
    name, first = next(iter(comparison.points.items()))
    return {
        "series": embed_figure(
            compare_figures.time_series(first), f"Axial acceleration measured and computed at {name}"
        ),
        "spectra": embed_figure(compare_figures.spectra(comparison, result.lines), "Axial power spectral densities"),
        "flow": embed_figure(compare_figures.power_flow(comparison), "RMS of every test point in each direction"),
        "windows": embed_figure(compare_figures.windows(comparison), "Axial RMS and relative error by window"),
    }


def _provenance(document: Mapping[str, Any]) -> dict[str, object]:
    """Where the numbers come from, as rows of a table."""
    recording, file = document["recording"], document["machine_file"]
    bands = {f"{band['low_hz']:g} to {band['high_hz']:.0f} Hz" for band in document["bands"].values()}
    return {
        "recording": recording["path"],
        "SHA-256 of the recording": recording["sha256"],
        "machine": f"{document['machine']} ({file['origin']})",
        "SHA-256 of the machine": file["sha256"],
        "model run": f"{document['model_duration']:g} s a level, seed {document['seed']}",
        "compared band": "; ".join(sorted(bands)),
        "window": f"{document['window_s']:g} s",
        "versions": ", ".join(f"{name} {number}" for name, number in document["versions"].items()),
    }
