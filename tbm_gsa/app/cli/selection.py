"""What the commands of the history have in common: where it is, and which of its windows are meant."""

from __future__ import annotations

import re
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from tbm_dynamics import Machine, load_machine
from tbm_gsa.history import KINDS, Selection
from tbm_gsa.provenance import machine_sha256
from tbm_msgs_py.base.errors import InputError

HISTORY_HELP = "History file; default: $TBM_HISTORY, else tbm_monitor/history.sqlite in the user's data folder."
_UNITS = {"s": 1, "m": 60, "h": 3600, "d": 86400}

File = Annotated[Path | None, typer.Option("--history", help=HISTORY_HELP, dir_okay=False)]
Point = Annotated[str | None, typer.Option(help="This test point only.")]
Since = Annotated[
    str | None, typer.Option(help="From this time on: ISO 8601 (UTC unless it says), or 30m, 12h, 7d before now.")
]
Until = Annotated[str | None, typer.Option(help="Before this time, written like --since.")]
Origin = Annotated[
    str | None,
    typer.Option("--source", help=f"{', '.join(KINDS)}, or a part of the recording's path or of the node's name."),
]
Of = Annotated[
    str | None,
    typer.Option(
        "--machine",
        metavar="<name|file>",
        help="Windows of this machine only: its name, its file, or 8 or more digits of its SHA-256.",
    ),
]


def selection(
    point: str | None, since: str | None, until: str | None, source: str | None, machine: str | None
) -> Selection:
    """Give the selection that the options state."""
    described = _machine_file(machine)
    if described is not None:
        machine = machine_sha256(described)
    return Selection(point, _stamp("--since", since), _stamp("--until", until), source, machine)


def machine_name(machine: str | None) -> str | None:
    """Name of a machine that is given by its name or its file."""
    described = _machine_file(machine)
    return machine if described is None else described.name


def _machine_file(machine: str | None) -> Machine | None:
    """Machine of a file; None for a name, for the history has machines that are not shipped."""
    if machine is None or not Path(machine).is_file():
        return None
    return load_machine(machine)


def _stamp(option: str, text: str | None) -> int | None:
    """Time in ns since the epoch."""
    if text is None:
        return None
    ago = re.fullmatch(r"(\d{1,6})([smhd])", text)
    if ago:
        return time.time_ns() - int(ago[1]) * _UNITS[ago[2]] * 1_000_000_000
    try:
        moment = datetime.fromisoformat(text)
        return round((moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp() * 1e9)
    except (ValueError, OverflowError):
        raise InputError(f"{option} {text}: allowed: ISO 8601 such as 2026-01-31T12:00, or 30m, 12h, 7d") from None
