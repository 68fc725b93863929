"""The history as a document: windows, what they come to at each point and axis, baselines."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np

from tbm_gsa.history.baseline import Baseline, sound_windows
from tbm_gsa.history.entries import Window
from tbm_gsa.history.store import History, Selection

_NUMBERS: Final = ("field_rms", "model_rms", "relative_error", "field_peak", "field_crest_factor", "field_kurtosis")


def history_document(history: History, selection: Selection, newest: int) -> dict[str, Any]:
    """Gather a selection.

    Returns
    -------
    dict
        ``path``; ``total``, the number of entries chosen; ``summary[{point, axis, machine, source, windows, first,
        last, error_mean, error_scatter, error_latest}]`` over all of them; ``windows[…]``, the newest ones;
        ``baselines[…]``. Times are ISO 8601 in UTC.
    """
    windows = history.windows(selection)
    return {
        "path": str(history.path),
        "total": len(windows),
        "summary": summarise(windows),
        "windows": [_window(window) for window in windows[max(0, len(windows) - newest) :]],
        "baselines": [baseline_document(baseline) for baseline in history.baselines()],
    }


def summarise(windows: Sequence[Window]) -> list[dict[str, Any]]:
    """Say what windows in the order of time come to, by point, axis, machine and kind of source."""
    groups: dict[tuple[str, str, str, str], list[Window]] = {}
    for window in windows:
        key = (window.entry.point, window.entry.axis, window.source.machine, window.source.kind)
        groups.setdefault(key, []).append(window)
    rows = []
    for (point, axis, machine, kind), members in sorted(groups.items()):
        known = np.array([member.entry.relative_error for member in sound_windows(members)])
        rows.append(
            {
                "point": point,
                "axis": axis,
                "machine": machine,
                "source": kind,
                "windows": len(members),
                "first": iso_time(members[0].entry.start_ns),
                "last": iso_time(members[-1].entry.start_ns),
                "error_mean": float(known.mean()) if known.size else None,
                "error_scatter": float(known.std(ddof=1)) if known.size > 1 else None,
                "error_latest": float(known[-1]) if known.size else None,
            }
        )
    return rows


def baseline_document(baseline: Baseline) -> dict[str, Any]:
    """Gather a baseline: ``points{point: {axis: {mean, scatter, windows}}}`` and where it comes from."""
    points: dict[str, dict[str, Any]] = {}
    for (point, axis), usual in baseline.usual.items():
        points.setdefault(point, {})[axis] = asdict(usual)
    return {
        "name": baseline.name,
        "machine": baseline.machine,
        "machine_sha256": baseline.machine_sha256,
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
