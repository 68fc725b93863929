"""What the history holds: one entry a window, test point and axis, and where it comes from."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from tbm_gsa.comparison import WindowResult

Kind = Literal["live", "offline"]


@dataclass(frozen=True)
class Source:
    """Comparison that windows come from; a window of the same source, place and time replaces the older one.

    Attributes
    ----------
    kind : {"live", "offline"}
    name : str
        Path of the recording, or name of the node.
    digest : str
        SHA-256 of the recording; empty of a live one.
    machine, machine_sha256 : str
        Name and file of the machine that the model is of.
    """

    kind: Kind
    name: str
    digest: str
    machine: str
    machine_sha256: str


@dataclass(frozen=True)
class Entry:
    """One window at one test point along one axis; NaN where a number is not known.

    Attributes
    ----------
    point, axis : str
        The axis is ``x``, ``y``, ``z``, or ``yz`` of a sensor that turns with the head.
    start_ns, length_ns : int
        The window on header time.
    field_rms, model_rms : float
        m/s².
    relative_error : float
        Equation (4); infinite where nothing was measured.
    coverage : float
        Recorded share of the window.
    """

    point: str
    axis: str
    start_ns: int
    length_ns: int
    field_rms: float
    model_rms: float
    relative_error: float
    coverage: float


@dataclass(frozen=True)
class Window:
    """An entry as it is read back, with its source."""

    source: Source
    entry: Entry


def live_entries(result: WindowResult, rotating: bool) -> Iterator[Entry]:
    """Entries of a window of the analysis node; none of a window in which nothing was measured."""
    if result.field_coverage == 0.0:
        return
    for place, axis in enumerate(("x", "yz") if rotating else ("x", "y", "z")):
        yield Entry(
            result.point,
            axis,
            result.start_ns,
            result.length_ns,
            float(result.field_rms[place]),
            float(result.model_rms[place]),
            float(result.relative_error[place]),
            result.field_coverage,
        )


def recording_entries(document: Mapping[str, Any], starts_ns: Mapping[str, int]) -> Iterator[Entry]:
    """Entries of a comparison of a recording; windows without a sample are left out, so are those at no level.

    Parameters
    ----------
    document : mapping
        As `comparison_document` gives it.
    starts_ns : mapping of str to int
        Header time of the first sample of each point.
    """
    length_ns = round(document["window_s"] * 1e9)
    for point, axes in document["points"].items():
        for axis, values in axes.items():
            windows = values["windows"]
            for place, start in enumerate(windows["start"]):
                level, field_rms = windows["level"][place], windows["field_rms"][place]
                compared = {} if level is None else document["levels"][level]["points"].get(point, {})
                if field_rms is None or axis not in compared:
                    continue
                model_rms = compared[axis]["model_rms"]
                error = windows["relative_error"][place]
                yield Entry(
                    point,
                    axis,
                    starts_ns[point] + round(start * 1e9),
                    length_ns,
                    field_rms,
                    model_rms,
                    math.inf if error is None and model_rms > 0.0 else math.nan if error is None else error,
                    windows["coverage"][place],
                )
