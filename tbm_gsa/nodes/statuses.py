"""What the analysis node says on `/diagnostics`, `gsa_status` and `gsa_result`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from tbm_gsa.comparison import StreamCounters, WindowResult
from tbm_gsa.nodes.gsa_process import GsaStatus
from tbm_gsa.nodes.history_writer import HistoryWriter
from tbm_msgs_py.nodes import messages

_STRONGEST = 5


def comparison_status(
    point: str,
    latest: WindowResult | None,
    counters: Mapping[Any, StreamCounters] | None,
    alarm: bool,
    refused: str,
) -> DiagnosticStatus:
    """Comparison at one test point: the latest window, what was lost, and the alarm."""
    values: dict[str, Any] = {}
    for source, counts in (counters or {}).items():
        values |= {f"{source}_{name}": value for name, value in vars(counts).items()}
    name = f"tbm: comparison {point}"
    if latest is None:
        return messages.status(name, "stale", refused or "no window yet", values, point)
    for i, axis in enumerate("xyz"):
        values[f"model_rms_{axis}"] = float(latest.model_rms[i])
        values[f"field_rms_{axis}"] = float(latest.field_rms[i])
        values[f"relative_error_{axis}"] = float(latest.relative_error[i])
    values |= {"model_coverage": latest.model_coverage, "field_coverage": latest.field_coverage}
    if refused:
        return messages.status(name, "error", refused, values, point)
    missing = [source for source in ("model", "field") if getattr(latest, f"{source}_coverage") == 0.0]
    if missing:
        return messages.status(name, "stale", f"no signal of the {' and the '.join(missing)}", values, point)
    if alarm:
        return messages.status(name, "warn", "relative error over its threshold", values, point)
    return messages.status(name, "ok", "compared", values, point)


def history_status(history: HistoryWriter) -> DiagnosticStatus:
    """Whether the windows arrive in the history."""
    values: dict[str, Any] = {"file": history.path, "written": history.written, "lost": history.lost}
    if history.problem:
        return messages.status("tbm: history", "warn", history.problem, values)
    return messages.status("tbm: history", "ok", "written" if history.path else "not kept", values)


def gsa_status(status: GsaStatus) -> DiagnosticStatus:
    """Where the sensitivity analysis stands."""
    values: dict[str, Any] = {
        "state": status.state,
        "done": status.done,
        "total": status.total,
        "failed": status.failed,
    }
    paths = {"folder": status.folder, "report": status.report}
    values |= {key: path for key, path in paths.items() if path is not None}
    level: messages.Level = "error" if status.state == "failed" else "ok"
    text = f"{status.state}: {status.reason}" if status.reason else status.state
    return messages.status("tbm: sensitivity analysis", level, text, values)


def gsa_result_statuses(document: Mapping[str, Any], status: GsaStatus) -> list[DiagnosticStatus]:
    """One status an output: its surrogate's quality and its strongest inputs."""
    statuses = []
    for name, output in document["outputs"].items():
        strongest = sorted(output["first"], key=output["first"].__getitem__, reverse=True)[:_STRONGEST]
        values = {key: output[key] for key in ("surrogate", "r2_test", "r2_cv")}
        values |= {f"first_{code}": output["first"][code] for code in strongest}
        values |= {f"total_{code}": output["total"][code] for code in strongest}
        values["report"] = status.report
        statuses.append(messages.status(f"tbm: sensitivity of {name}", "ok", ", ".join(strongest), values))
    return statuses
