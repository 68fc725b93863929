"""`tbm-monitor bag record`: topics into a recording."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer
from rosbags.rosbag2.metadata import Metadata

from tbm_gsa.app.cli.bag.info import BagContents
from tbm_gsa.app.cli.bag.node import run_to_end
from tbm_gsa.app.cli.output import JSON_OPTION, LARGEST_MB, LONGEST_S, notes, print_json, results, split_names
from tbm_gsa.app.cli.processes import NodeCommand
from tbm_gsa.reading import Part
from tbm_msgs_py.bags import metadata
from tbm_msgs_py.bags.bag import BagInfo
from tbm_msgs_py.bags.batch import Topic
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.topics import absolute


class RecordedMessages(Part):
    """What the recorder has done: messages lost, recordings deleted for the quota, and why it ended early, if so."""

    lost: int
    deleted: tuple[str, ...]
    problem: str


class RecordResult(BagContents):
    """What `bag record --json` prints: contents and files of the recording, and those deleted for the quota."""

    files: tuple[str, ...]
    deleted: tuple[str, ...]


def record(
    out: Annotated[Path, typer.Option(help="New rosbag2 folder.")],
    topics: Annotated[list[str], typer.Option(help="Topics, relative to /tbm or absolute: repeated, or with commas.")],
    duration: Annotated[
        float, typer.Option(min=0.0, max=LONGEST_S, help="Ends after so long (s); 0: with Ctrl-C.")
    ] = 0.0,
    split_size: Annotated[
        float, typer.Option(min=0.0, max=LARGEST_MB, help="A further file after so much (MB); 0: never.")
    ] = 0.0,
    split_time: Annotated[
        float, typer.Option(min=0.0, max=LONGEST_S, help="A further file after so long (s); 0: never.")
    ] = 0.0,
    quota: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=LARGEST_MB,
            help="It and those beside it that were made with a quota take at most so much (MB); 0: no limit.",
        ),
    ] = 0.0,
    compress: Annotated[bool, typer.Option("--compress", help="Compress with zstd.")] = False,
    sim_time: Annotated[
        bool, typer.Option("--sim-time", help="Log on /clock instead of the computer's clock.")
    ] = False,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Record topics until Ctrl-C: raw messages, on the disk within half a second."""
    if os.path.lexists(out):
        raise RecordingError(f"{out}: exists already, allowed: a new name")
    names = split_names("--topics", topics)
    given: dict[str, object] = {"output": str(out), "topics": list(names), "duration": duration}
    given |= {"split_size": split_size, "split_time": split_time, "quota": quota, "use_sim_time": sim_time}
    given["compression"] = "zstd" if compress else "none"
    recorded = run_to_end(NodeCommand("bag_recorder", given), RecordedMessages)
    if recorded is None:
        return
    described = metadata.read(out)
    contents = BagContents.of(out, _info(described, recorded.lost))
    found = RecordResult(**dict(contents), files=tuple(described["relative_file_paths"]), deleted=recorded.deleted)
    silent = [name for name in dict.fromkeys(map(absolute, names)) if name not in found.topics]
    if silent:
        notes.print(f"warning: no message on {', '.join(silent)}", highlight=False)
    if json:
        print_json(found)
    else:
        count, files = len(found.topics), len(found.files)
        results.print(
            f"{out}: {found.messages} messages of {count} topic{'s' * (count != 1)} over "
            f"{found.duration:.3f} s in {files} file{'s' * (files > 1)}, {found.lost} lost",
            highlight=False,
        )


def _info(described: Metadata, lost: int) -> BagInfo:
    """Return the info that the metadata of a finished recording hold.

    The files hold the same, but their reader takes a second to load, or four to compile, and an end has three.
    """
    counts = [(topic["topic_metadata"], topic["message_count"]) for topic in described["topics_with_message_count"]]
    topics = {Topic(topic["name"], topic["type"]): count for topic, count in counts}
    start = described["starting_time"]["nanoseconds_since_epoch"]
    end = start + described["duration"]["nanoseconds"]
    return BagInfo(topics, start, end, described["message_count"], lost=lost, truncated=False)
