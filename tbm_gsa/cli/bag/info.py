"""`tbm-monitor bag info`: what a recording holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from tbm_gsa.cli.output import JSON_OPTION, print_json, results
from tbm_msgs_py.bags import Bag, BagInfo


def info(
    bag: Annotated[Path, typer.Argument(help="Recording: a rosbag2 folder or an .mcap file.")],
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """List the topics of a recording, its length, and what is missing."""
    document = info_document(bag, Bag(bag).info())
    if json:
        print_json(document)
    else:
        _print_tables(document)


def info_document(path: Path, found: BagInfo) -> dict[str, Any]:
    """Gather what `bag info --json` prints.

    Returns
    -------
    dict
        ``path``, ``messages``, ``lost``, ``truncated``, ``start_ns``, ``duration`` (s) and
        ``topics{name: {type, messages}}``.
    """
    topics = {topic.name: {"type": topic.type, "messages": count} for topic, count in found.topics.items()}
    return {
        "path": str(path),
        "messages": found.messages,
        "lost": found.lost,
        "truncated": found.truncated,
        "start_ns": found.start_ns,
        "duration": found.duration,
        "topics": dict(sorted(topics.items())),
    }


def _print_tables(document: dict[str, Any]) -> None:
    truncated = ", truncated" if document["truncated"] else ""
    results.print(Text(document["path"]))
    results.print(
        f"{document['messages']} messages over {document['duration']:.3f} s, {document['lost']} lost{truncated}",
        highlight=False,
    )
    table = Table()
    for heading in ("topic", "type", "messages"):
        table.add_column(heading, justify="right" if heading == "messages" else "left")
    for name, topic in document["topics"].items():
        table.add_row(Text(name), Text(topic["type"]), str(topic["messages"]))
    results.print(table)
