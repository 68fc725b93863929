"""The drives of a comparison as tables for the terminal."""

from __future__ import annotations

from rich.text import Text

from tbm_gsa.app.cli.output import add_row, narrow_table, results
from tbm_gsa.comparison.drive_results import DriveSide, DrivesResult, SharingSide


def print_drives(drives: DrivesResult) -> None:
    """Print torque, share, fluctuation and speed of every drive, the model first, and of all of them together."""
    title = f"\ndrives, 0 to {drives.high_hz:.3g} Hz, windows of {drives.window_s:.3g} s: model | measured"
    table = narrow_table(title, "drive", ">torque, kN·m", ">error", ">share", ">fluctuation", ">rad/s")
    for name, drive in drives.drives.items():
        sides = (drive.model, drive.field)
        cells = [" | ".join(map(_torque, sides)), _percent(drive.relative_error)]
        for key, form in (("share", ".3f"), ("fluctuation", ".3f"), ("speed", ".4g")):
            cells.append(" | ".join(_number(getattr(side, key), form) for side in sides))
        add_row(table, name.removeprefix("drive_"), *cells)
    results.print(table)
    for what, side in (("model", drives.model), ("measured", drives.field)):
        results.print(Text(f"{what}: {_sharing(side)}"))
    filtered = "not stated" if drives.low_pass_hz is None else f"{drives.low_pass_hz:g} Hz, the model's too"
    results.print(
        Text(f"{drives.topic}: {drives.samples} samples at a level, {drives.rate_hz:.4g} Hz, filter {filtered}")
    )
    for line in (*drives.findings, *(f"{name}: {reason}" for name, reason in drives.skipped.items())):
        results.print(Text(line))


def _sharing(side: SharingSide) -> str:
    numbers = {
        "sharing factor": _number(side.sharing_factor, ".3f"),
        "lowest share": _number(side.least_share, ".3f"),
        "scatter": _percent(side.scatter),
        "correlation": _number(side.correlation, ".2f"),
        "fluctuation of the sum": _percent(side.fluctuation),
    }
    return ", ".join([f"{side.running} drives run", *(f"{name} {value}" for name, value in numbers.items())])


def _torque(side: DriveSide) -> str:
    value = _number(None if side.torque is None else side.torque / 1e3, ".4g")
    return value if side.running or side.torque is None else f"{value} off"


def _number(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{value:.1%}"
