"""What the commands of the history have in common: where it is, and which of its windows are meant."""

from __future__ import annotations

import re
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from tbm_gsa.history import KINDS, Selection
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
        "--machine", help="Windows of this machine only: its name, or 8 or more digits of its file's SHA-256."
    ),
]


def selection(
    point: str | None, since: str | None, until: str | None, source: str | None, machine: str | None
) -> Selection:
    """Give the selection that the options state."""
    return Selection(point, _stamp("--since", since), _stamp("--until", until), source, machine)


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
