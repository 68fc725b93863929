"""The history as a document: windows, what they come to at each point and axis, baselines."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tbm_gsa.history.baseline import Baseline
from tbm_gsa.history.entries import Entry, Group, Window
from tbm_gsa.history.queries import Queries, Selection

_BY_SOURCE: Final = ("point", "axis", "machine", "kind")
_NUMBERS: Final = ("field_rms", "model_rms", "relative_error", "field_peak", "field_crest_factor", "field_kurtosis")


def history_document(history: Queries, selection: Selection, newest: int) -> dict[str, Any]:
    """Gather a selection; of the windows that are not listed one point and axis at a time is held.

    Returns
    -------
    dict
        ``path``; ``total``, the number of entries chosen; ``summary[{point, axis, machine, source, windows, first,
        last, error_mean, error_scatter, error_latest}]`` over all of them; ``windows[…]``, the newest ones;
        ``baselines[…]``. Times are ISO 8601 in UTC.
    """
    windows = history.windows(selection, newest)
    summary = [_row(group) for group in history.groups(_BY_SOURCE, selection)]
    return {
        "path": str(history.path),
        "total": sum(row["windows"] for row in summary),
        "summary": summary,
        "windows": [_window(window) for window in windows],
        "baselines": baselines_document(history)["baselines"],
    }


def baselines_document(history: Queries) -> dict[str, Any]:
    """Gather all baselines: ``path`` and ``baselines[…]``, the oldest first."""
    return {
        "path": str(history.path),
        "baselines": [baseline_document(baseline) for baseline in history.baselines()],
    }


def summarise(windows: Sequence[Window]) -> list[dict[str, Any]]:
    """Say what windows in the order of time come to, by point, axis, machine and kind of source."""
    members: dict[tuple[str, ...], list[Entry]] = {}
    for window in windows:
        key = (window.entry.point, window.entry.axis, window.source.machine, window.source.kind)
        members.setdefault(key, []).append(window.entry)
    return [_row(Group(key, *_columns(entries))) for key, entries in sorted(members.items())]


def _columns(entries: Sequence[Entry]) -> Iterator[NDArray[Any]]:
    for name in ("start_ns", "length_ns", "field_rms", "relative_error"):
        yield np.array([getattr(entry, name) for entry in entries])


def _row(group: Group) -> dict[str, Any]:
    point, axis, machine, kind = group.key
    errors = group.relative_error[group.sound()]
    return {
        "point": point,
        "axis": axis,
        "machine": machine,
        "source": kind,
        "windows": len(group.start_ns),
        "first": iso_time(int(group.start_ns[0])),
        "last": iso_time(int(group.start_ns[-1])),
        "error_mean": float(errors.mean()) if errors.size else None,
        "error_scatter": float(errors.std(ddof=1)) if errors.size > 1 else None,
        "error_latest": float(errors[-1]) if errors.size else None,
    }


def baseline_document(baseline: Baseline) -> dict[str, Any]:
    """Gather a baseline: ``points{point: {axis: {mean, scatter, windows}}}`` and where it comes from."""
    points: dict[str, dict[str, Any]] = {}
    for (point, axis), usual in baseline.usual.items():
        points.setdefault(point, {})[axis] = asdict(usual)
    return {
        "name": baseline.name,
        "machine": baseline.machine,
        "machine_sha256": baseline.machine_sha256,
        "source": baseline.kind,
        "created": iso_time(baseline.created_ns),
        "since": iso_time(baseline.since_ns),
        "until": iso_time(baseline.until_ns),
        "points": points,
    }


def iso_time(stamp_ns: int) -> str:
    """ISO 8601 in UTC, to the millisecond."""
    moment = datetime.fromtimestamp(stamp_ns // 1_000_000 / 1000.0, UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _window(window: Window) -> dict[str, Any]:
    entry, source = window.entry, window.source
    return {
        "start": iso_time(entry.start_ns),
        "start_ns": entry.start_ns,
        "length_s": entry.length_ns * 1e-9,
        "point": entry.point,
        "axis": entry.axis,
        **{name: _number(getattr(entry, name)) for name in _NUMBERS},
        "coverage": entry.coverage,
        "source": source.kind,
        "name": source.name,
        "machine": source.machine,
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
