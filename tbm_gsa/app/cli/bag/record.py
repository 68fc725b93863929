"""`tbm-monitor bag record`: topics into a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rosbags.rosbag2.metadata import Metadata

from tbm_gsa.app.cli.bag.info import info_document
from tbm_gsa.app.cli.bag.node import run_to_end
from tbm_gsa.app.cli.output import JSON_OPTION, notes, print_json, results
from tbm_gsa.app.cli.processes import NodeCommand
from tbm_msgs_py.bags import metadata
from tbm_msgs_py.bags.bag import BagInfo
from tbm_msgs_py.bags.batch import Topic
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.topics import absolute


def record(
    out: Annotated[Path, typer.Option(help="New rosbag2 folder.")],
    topics: Annotated[list[str], typer.Option(help="Topics, relative to /tbm or absolute: repeated, or with commas.")],
    duration: Annotated[float, typer.Option(min=0.0, help="Ends after so long (s); 0: with Ctrl-C.")] = 0.0,
    split_size: Annotated[float, typer.Option(min=0.0, help="A further file after so much (MB); 0: never.")] = 0.0,
    split_time: Annotated[float, typer.Option(min=0.0, help="A further file after so long (s); 0: never.")] = 0.0,
    quota: Annotated[
        float,
        typer.Option(
            min=0.0, help="It and those beside it that were made with a quota take at most so much (MB); 0: no limit."
        ),
    ] = 0.0,
    compress: Annotated[bool, typer.Option("--compress", help="Compress with zstd.")] = False,
    sim_time: Annotated[
        bool, typer.Option("--sim-time", help="Log on /clock instead of the computer's clock.")
    ] = False,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Record topics until Ctrl-C: raw messages, on the disk within half a second."""
    if out.exists():
        raise RecordingError(f"{out}: exists already, allowed: a new name")
    names = [name.strip() for given in topics for name in given.split(",") if name.strip()]
    given: dict[str, object] = {"output": str(out), "topics": names or [""], "duration": duration}
    given |= {"split_size": split_size, "split_time": split_time, "quota": quota, "use_sim_time": sim_time}
    given["compression"] = "zstd" if compress else "none"
    summary = run_to_end(NodeCommand("bag_recorder", given))
    if summary is None:
        return
    described = metadata.read(out)
    document = info_document(out, _info(described)) | {
        "files": described["relative_file_paths"],
        "lost": summary["lost"],
        "deleted": summary["deleted"],
    }
    silent = [name for name in dict.fromkeys(map(absolute, names)) if name not in document["topics"]]
    if silent:
        notes.print(f"warning: no message on {', '.join(silent)}", highlight=False)
    if json:
        print_json(document)
    else:
        count, files = len(document["topics"]), len(document["files"])
        results.print(
            f"{out}: {document['messages']} messages of {count} topic{'s' * (count != 1)} over "
            f"{document['duration']:.3f} s in {files} file{'s' * (files > 1)}, {document['lost']} lost",
            highlight=False,
        )


def _info(described: Metadata) -> BagInfo:
    """Return the info that the metadata of a finished recording hold.

    The files hold the same, but their reader takes a second to load, or four to compile, and an end has three.
    """
    counts = [(topic["topic_metadata"], topic["message_count"]) for topic in described["topics_with_message_count"]]
    topics = {Topic(topic["name"], topic["type"]): count for topic, count in counts}
    start = described["starting_time"]["nanoseconds_since_epoch"]
    end = start + described["duration"]["nanoseconds"]
    return BagInfo(topics, start, end, described["message_count"], lost=0, truncated=False)
