"""`tbm-monitor bag recover`: a clean recording from a damaged one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from tbm_gsa.app.cli.output import JSON_OPTION, print_json, progress_bar, results
from tbm_gsa.reading import Part
from tbm_msgs_py.bags.recovery import Recovery
from tbm_msgs_py.bags.recovery import recover as recover_recording
from tbm_msgs_py.base.texts import quoted


class RecoveryResult(Part):
    """What `bag recover --json` prints; `left_out` counts messages that are not CDR, by topic."""

    path: str
    out: str
    recovered: int
    lost: int
    damaged: int
    truncated: bool
    left_out: dict[str, int]
    encodings: dict[str, str]
    notes: tuple[str, ...]


def recover(
    bag: Annotated[Path, typer.Argument(help="Damaged recording: a rosbag2 folder or a file of one.")],
    out: Annotated[Path, typer.Option(help="New recording: a folder, or a file when it ends in .mcap.")],
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Write what can be read of a damaged recording to a new one."""
    with progress_bar("recovering") as progress:
        progress.add_task("", total=None)
        found = recover_recording(bag, out)
    if json:
        print_json(RecoveryResult(path=str(bag), out=str(out), **vars(found)))
    else:
        results.print(Text(_sentence(out, found)))


def _sentence(out: Path, found: Recovery) -> str:
    parts = [f"{out}: {found.recovered} messages recovered, {found.lost} lost"]
    if found.damaged or found.truncated:
        parts[0] += " or more"
    if found.damaged:
        parts.append(f"{found.damaged} damaged places")
    if found.truncated:
        parts.append("cut off before its end")
    parts += [
        f"{count} of {topic} left out: {quoted(found.encodings[topic])}, not CDR"
        for topic, count in found.left_out.items()
    ]
    return "\n".join([", ".join(parts), *found.notes])
