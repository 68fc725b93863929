"""Statuses of the analysis node on `/diagnostics`, `gsa_status` and `gsa_result`."""

from __future__ import annotations

import math
from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticStatus

from tbm_gsa.app.nodes.gsa_process import GsaStatus
from tbm_gsa.app.nodes.history_writer import HistoryWriter
from tbm_gsa.app.nodes.stream_health import Condition
from tbm_gsa.comparison import StreamCounters, WindowResult, dead_axes
from tbm_gsa.comparison.results import OperatingKind
from tbm_gsa.comparison.streams import Side
from tbm_gsa.comparison.units import unit_doubt
from tbm_gsa.sensitivity.results import NOT_DETERMINED, STRONGEST, OutputResult, SpectrumResult, StudyResult
from tbm_gsa.sensitivity.study.failures import WARNED
from tbm_msgs_py.nodes import messages

_QUANTITIES = ("model_rms", "field_rms", "relative_error", "field_crest_factor", "field_kurtosis")
_WHOLE = 0.9  # share of a window below which its holes are named
_OPERATION: dict[OperatingKind, str] = {
    "steady": "compared",
    "transient": "not compared: the operating point changes",
    "standstill": "not compared: the machine stands still",
}


def comparison_status(
    name: str,
    point: str,
    latest: WindowResult | None,
    counters: Mapping[Side, StreamCounters] | None,
    alarm: bool,
    health: Condition,
) -> DiagnosticStatus:
    """Comparison at one test point: the latest window, what was lost, and the alarm; the worst comes first."""
    values: dict[str, object] = {"alarm": int(alarm)}
    for source, counts in (counters or {}).items():
        values |= {f"{source}_{key}": value for key, value in vars(counts).items()}
    if latest is not None:
        values |= _figures(latest)
    values |= {f"{source}_rate_hz": rate for source, rate in health.rates.items()}
    level, text = _judge(latest, alarm, health)
    return messages.status(name, level, text, values, point)


def _judge(latest: WindowResult | None, alarm: bool, health: Condition) -> tuple[messages.Level, str]:
    if health.refused:
        return "error", "; ".join([*health.refused, *health.doubts, *health.silent])
    if health.silent:
        return "stale", "; ".join([*health.silent, *health.doubts])
    if latest is None:
        return "stale", "; ".join(["no window yet", *health.doubts])
    missing = [source for source in ("model", "field") if getattr(latest, f"{source}_coverage") == 0.0]
    if missing:
        return "stale", "; ".join([f"no signal of the {' and the '.join(missing)}", *health.doubts])
    notes = ["measured level over its threshold"] if alarm else []
    notes += [*health.doubts, *holes(latest)]
    if latest.operation == "steady":
        notes += [*dead_channels(latest), *filter(None, [unit_doubt(latest.field_rms, latest.model_rms)])]
    return ("warn" if notes else "ok", "; ".join(notes or [_OPERATION[latest.operation]]))


def _figures(latest: WindowResult) -> dict[str, float]:
    values = {
        f"{quantity}_{axis}": float(value)
        for quantity in _QUANTITIES
        for axis, value in zip("xyz", getattr(latest, quantity), strict=True)
    }
    return values | {"model_coverage": latest.model_coverage, "field_coverage": latest.field_coverage}


def holes(latest: WindowResult) -> list[str]:
    """Report the signals of which a window has less than its most part."""
    shares = {"model": latest.model_coverage, "field": latest.field_coverage}
    return [f"{source} covers {share:.0%} of the window" for source, share in shares.items() if share < _WHOLE]


def dead_channels(latest: WindowResult) -> list[str]:
    """Report the axes along which the sensor measures next to nothing."""
    axes = [axis for axis, dead in zip("xyz", dead_axes(latest), strict=True) if dead]
    return [f"field measures next to nothing along {', '.join(axes)}: a dead channel?"] if axes else []


def history_status(name: str, machine: str, history: HistoryWriter) -> DiagnosticStatus:
    """Whether the windows arrive in the history."""
    values: dict[str, object] = {"file": history.path, "written": history.written, "lost": history.lost}
    if history.problem:
        return messages.status(name, "warn", history.problem, values, machine)
    return messages.status(name, "ok", "written" if history.path else "not kept", values, machine)


def gsa_status(name: str, machine: str, status: GsaStatus, quality: Mapping[str, object]) -> DiagnosticStatus:
    """Where the sensitivity analysis stands, and what its surrogates were worth."""
    values: dict[str, object] = {
        "state": status.state,
        "step": status.step,
        "done": status.done,
        "total": status.total,
        "failed": status.failed,
    }
    paths = {"folder": status.folder, "report": status.report, "explanation_page": status.explanation_page}
    values |= {key: path for key, path in paths.items() if path is not None}
    values |= {"explanation": status.explanation} if status.explanation else {}
    values |= quality
    many = status.failed > WARNED * status.done
    level: messages.Level = "error" if status.state == "failed" else "warn" if many else "ok"
    text = f"{status.state}: {status.reason}" if status.reason else status.state
    text += f"; {status.failed} of {status.done} simulations failed" if many else ""
    return messages.status(name, level, text, values, machine)


def surrogate_quality(study: StudyResult) -> dict[str, object]:
    """Kind, ten-fold and test R² of every output's surrogate, and whether its indices are determined."""
    return {f"{key}_{name}": value for name, one in study.judged().items() for key, value in _quality(one).items()}


def _quality(output: OutputResult | SpectrumResult) -> dict[str, object]:
    """Quality of the surrogate of an output; NaN where no test points say anything."""
    return {
        "surrogate": output.surrogate,
        "r2_test": math.nan if output.r2_test is None else output.r2_test,
        "r2_cv": output.r2_cv,
        "determined": output.determined,
    }


def gsa_result_statuses(prefix: str, machine: str, study: StudyResult, status: GsaStatus) -> list[DiagnosticStatus]:
    """One status an output: its surrogate's quality and its strongest inputs; WARN where they are in doubt."""
    statuses = []
    failures = study.failure_summary
    doubts = [failures.text()] if failures is not None and failures.warned else []
    for name, output in study.judged().items():
        strongest = sorted(output.first, key=output.first.__getitem__, reverse=True)[:STRONGEST]
        values = _quality(output)
        values |= {f"first_{code}": output.first[code] for code in strongest}
        values |= {f"total_{code}": output.total[code] for code in strongest}
        values["report"] = status.report
        ranked = output.text() if isinstance(output, SpectrumResult) else ", ".join(strongest)
        found = ranked if output.determined else f"{NOT_DETERMINED}: R² {output.r2_cv:.2f}"
        level: messages.Level = "warn" if doubts or not output.determined else "ok"
        statuses.append(messages.status(f"{prefix} {name}", level, "; ".join([found, *doubts]), values, machine))
    statuses += [messages.status(f"{prefix} {name}", "error", why, {}, machine) for name, why in study.skipped.items()]
    return statuses
