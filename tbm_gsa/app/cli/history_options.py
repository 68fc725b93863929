"""Options of the commands that read the history: its file, and a span of time."""

from __future__ import annotations

import re
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from tbm_dynamics import Machine, load_machine
from tbm_gsa.app.cli.output import named
from tbm_gsa.provenance import machine_sha256
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.units import NANOSECONDS

HISTORY_HELP = "History file; default: $TBM_HISTORY, else tbm_monitor/history.sqlite in the user's data folder."
_UNITS = {"s": 1, "m": 60, "h": 3600, "d": 86400}

File = Annotated[Path | None, typer.Option("--history", help=HISTORY_HELP, dir_okay=False)]
Since = Annotated[
    str | None, typer.Option(help="From this time on: ISO 8601 (UTC unless it says), or 30m, 12h, 7d before now.")
]
Until = Annotated[str | None, typer.Option(help="Before this time, written like --since.")]
Of = Annotated[
    str | None,
    typer.Option(
        "--machine",
        metavar="<name|file>",
        help="Of this machine only: its name, its file, or 8 or more digits of its SHA-256.",
    ),
]


def machine_file(machine: str | None) -> Machine | None:
    """Machine of a file; None for a name, for the history has machines that are not shipped."""
    return load_machine(machine) if machine is not None and Path(machine).is_file() else None


def name_or_digest(machine: str | None) -> str | None:
    """Name of a machine, or the digest of the one of a file."""
    described = machine_file(machine)
    return machine if described is None else machine_sha256(described)


def span_of(since: str | None, until: str | None) -> tuple[int | None, int | None]:
    """Begin and end of a span of time in ns since the epoch; None where an option is not stated."""
    begin, end = _stamp("--since", since), _stamp("--until", until)
    if begin is not None and end is not None and begin >= end:
        raise InputError(f"--since {since} --until {until}: allowed: a time before another")
    return begin, end


def _stamp(option: str, text: str | None) -> int | None:
    """Time in ns since the epoch."""
    if text is None:
        return None
    ago = re.fullmatch(r"(\d{1,6})([smhd])", text)
    try:
        if ago:
            stamp = time.time_ns() - int(ago[1]) * _UNITS[ago[2]] * NANOSECONDS
        else:
            moment = datetime.fromisoformat(text)
            stamp = round((moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp() * NANOSECONDS)
        if abs(stamp) >= 1 << 63:  # of a history, as of ROS
            raise ValueError
    except (ValueError, OverflowError):
        raise InputError(
            f"{option} {text}: allowed: ISO 8601 such as 2026-01-31T12:00, 1678 to 2262, or 30m, 12h, 7d"
        ) from None
    return stamp


def refuse_options(context: typer.Context, command: str) -> None:
    """Refuse options of a list before a command of its group, which would not see them."""
    for name in context.params:
        if named(context, name):
            raise InputError(f"{command} --{name} … {context.invoked_subcommand}: allowed: options behind the command")
