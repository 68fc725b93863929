"""`tbm-monitor bag play`: a recording onto its topics."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from tbm_gsa.app.cli.bag.node import run_to_end
from tbm_gsa.app.cli.output import JSON_OPTION, LONGEST_S, print_json, results, split_names
from tbm_gsa.app.cli.processes import NodeCommand
from tbm_gsa.app.cli.shipped import RECORDING_ARGUMENT, recording_path
from tbm_gsa.reading import Part
from tbm_msgs_py.bags.bag import Bag
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.texts import listed


class PlayedMessages(Part):
    """What the player has done: messages played, lost, late and left out, rounds, and whether it came to the end."""

    played: int
    lost: int
    late: int
    left_out: dict[str, int]
    loops: int
    ended: bool


class PlayResult(PlayedMessages):
    """What `bag play --json` prints."""

    path: str
    rate: float


def play(
    bag: Annotated[Path, RECORDING_ARGUMENT],
    rate: Annotated[float, typer.Option(min=0.1, max=10.0, help="Speed, times real time.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Start again at the end, until Ctrl-C.")] = False,
    clock: Annotated[bool, typer.Option(help="Publish the recorded time on /clock.")] = True,
    start: Annotated[
        float, typer.Option(min=0.0, max=LONGEST_S, help="Recorded time left out at the beginning (s).")
    ] = 0.0,
    duration: Annotated[float, typer.Option(min=0.0, max=LONGEST_S, help="Recorded time played (s); 0: all.")] = 0.0,
    topics: Annotated[
        list[str] | None, typer.Option(help="Absolute topics: repeated, or with commas; else all.")
    ] = None,
    subscribers: Annotated[
        int, typer.Option(min=0, max=1000, help="Subscriptions to wait for, 5 s at most, before the first message.")
    ] = 1,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Play a recording as it was recorded: raw messages, their topics, their quality of service, and its clock."""
    bag = recording_path(bag)
    names = split_names("--topics", topics or ())
    recorded = {topic.name for topic in Bag(bag).info().topics}  # no recording is an error before a node starts
    for name in names:
        if name not in recorded:
            raise InputError(f"--topics {name}: not in {bag}, allowed: {listed(sorted(recorded))}")
    given: dict[str, object] = {"bag": str(bag), "rate": rate, "loop": loop, "clock": clock, "start": start}
    given |= {"duration": duration, "topics": list(names) or [""], "wait_for_subscribers": subscribers}
    played = run_to_end(NodeCommand("bag_player", given), PlayedMessages)
    if played is None:
        return
    if json:
        print_json(PlayResult(path=str(bag), rate=rate, **dict(played)))
    else:
        parts = [f"{bag}: {played.played} messages played"]
        parts += [f"{count} {what}" for count, what in ((played.lost, "lost"), (played.late, "late")) if count]
        parts += [f"{count} of {topic} left out" for topic, count in played.left_out.items()]
        parts += [] if played.ended else ["stopped before its end"]
        results.print(Text(", ".join(parts)))
