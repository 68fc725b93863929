"""What `/diagnostics` says of the drives: the latest window of the field's, beside the model's."""

from __future__ import annotations

from typing import Final

from diagnostic_msgs.msg import DiagnosticStatus

from tbm_gsa.comparison.drive_results import DrivesResult
from tbm_gsa.comparison.live_drives import DriveWindow
from tbm_gsa.comparison.results import OperatingKind
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.nodes import messages

SILENT_S: Final = 3.0
"""Beyond two windows, from which on the last one says nothing of now."""


def drives_status(
    name: str, machine: str, window: DriveWindow | None, kind: OperatingKind, age_s: float = 0.0
) -> DiagnosticStatus:
    """Comparison of the drives: WARN names what is not as the model has it, or why nothing is compared.

    Parameters
    ----------
    name, machine : str
    window : DriveWindow or None
        The latest.
    kind : {"steady", "transient", "standstill"}
        How the machine was driven in it.
    age_s : float
        Time since it was complete, s.
    """
    if window is None:
        return messages.status(name, "stale", "no window yet", {}, machine)
    if age_s > 2.0 * (window.end_ns - window.begin_ns) / NANOSECONDS + SILENT_S:
        return messages.status(name, "stale", f"no window of field and model for {age_s:.0f} s", {}, machine)
    if window.result is None:
        return messages.status(name, "warn", f"not compared: {window.problem}", {}, machine)
    values = _values(window.result)
    if kind != "steady":
        text = "the machine stands still" if kind == "standstill" else "the operating point changes"
        return messages.status(name, "ok", f"not compared: {text}", values, machine)
    notes = [*window.result.findings, *(f"{drive}: {why}" for drive, why in window.result.skipped.items())]
    return messages.status(name, "warn" if notes else "ok", "; ".join(notes) or "compared", values, machine)


def _values(result: DrivesResult) -> dict[str, object]:
    """Numbers that are known, by side and drive."""
    values: dict[str, object] = {
        f"{side}_{key}": value
        for side, found in (("field", result.field), ("model", result.model))
        for key, value in found.model_dump().items()
    }
    values |= {
        f"{name}_{side}_{key}": getattr(getattr(drive, side), key)
        for name, drive in result.drives.items()
        for side in ("field", "model")
        for key in ("torque", "share", "fluctuation", "speed")
    }
    return {key: value for key, value in values.items() if value is not None}
