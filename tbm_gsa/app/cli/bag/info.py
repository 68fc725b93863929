"""`tbm-monitor bag info`: what a recording holds, and with `--scan` what is wrong with it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text

from tbm_gsa.app.cli.output import JSON_OPTION, add_row, narrow_table, notes, print_json, progress_bar, results
from tbm_gsa.app.cli.shipped import RECORDING_ARGUMENT, recording_path
from tbm_msgs_py.bags.bag import Bag, BagInfo
from tbm_msgs_py.bags.definitions import JOINT_STATE_TYPE, definition_hash
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.recordings.channels import LeftOut
from tbm_msgs_py.recordings.decoding import ACCELERATION_TYPES
from tbm_msgs_py.recordings.recording_health import COUNTS, PointHealth, check_recording
from tbm_msgs_py.recordings.used import UsedSources

_SHOWN = 200  # topics and test points: a terminal takes a quarter of a minute for 60 000
APART_S = 1.0  # clocks that differ by more get a line of their own


def info(
    bag: Annotated[Path, RECORDING_ARGUMENT],
    scan: Annotated[bool, typer.Option("--scan", help="Read it through for damage and faults of the sensors.")] = False,
    mapping: Annotated[
        Path | None, typer.Option(help="Mapping of topics to test points; default: mapping.yaml in or beside the bag.")
    ] = None,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """List the topics of a recording, its length, and what is missing."""
    bag = recording_path(bag)
    recording = Bag(bag)
    with progress_bar("reading") as progress:
        if scan:
            progress.add_task("", total=None)
        found = recording.info(scan=scan)
        document = info_document(bag, found) | {"doubts": [*_doubts(found)]}
        if recording.problem:
            notes.print(Text(recording.problem))
        if scan:
            scanned = _scanned(bag, mapping)
            document |= scanned | {"doubts": [*document["doubts"], *scanned["doubts"]]}
    if json:
        print_json(document)
    else:
        _print_tables(document)


def info_document(path: Path, found: BagInfo) -> dict[str, Any]:
    """Gather what `bag info --json` prints.

    Returns
    -------
    dict
        ``path``, ``messages``, ``lost``, ``truncated``, ``damaged``, ``start_ns``, ``duration`` (s) and
        ``topics{name: {type, types{type: messages}, messages}}``, ``type`` that of most messages; with ``--scan``
        ``points{point: {…}}``, the sums of `PointHealth`, and ``problems{point: reason}`` for those without samples.
    """
    types: dict[str, Counter[str]] = {}
    for topic, count in found.topics.items():
        types.setdefault(topic.name, Counter())[topic.type] += count
    return {
        "path": str(path),
        "messages": found.messages,
        "lost": found.lost,
        "truncated": found.truncated,
        "damaged": found.damaged,
        "start_ns": found.start_ns,
        "duration": found.duration,
        "topics": {
            name: {
                "type": max(sorted(counts), key=counts.__getitem__),
                "types": dict(counts),
                "messages": counts.total(),
            }
            for name, counts in sorted(types.items())
        },
    }


def _doubts(found: BagInfo) -> Iterator[str]:
    """Name topics of types that are read here whose messages cannot be decoded, or have several definitions."""
    definitions: dict[tuple[str, str], Counter[str]] = {}
    for topic, count in found.topics.items():
        if topic.type in (*ACCELERATION_TYPES, JOINT_STATE_TYPE):
            try:
                definitions.setdefault((topic.name, topic.type), Counter())[definition_hash(topic)] += count
            except RecordingError as error:
                yield f"topic {topic.name}: {count} messages cannot be read: {error}"
    for (name, kind), hashes in definitions.items():
        if len(hashes) > 1:
            counts = ", ".join(f"{count} of {found.removeprefix('RIHS01_')[:8]}" for found, count in hashes.items())
            yield f"topic {name}: {len(hashes)} definitions of {kind}: messages {counts}"


def _scanned(bag: Path, mapping: Path | None) -> dict[str, Any]:
    try:
        found = check_recording(bag, mapping)
    except RecordingError as error:
        if mapping is not None:
            raise
        return {"points": {}, "problems": {"": str(error)}, "doubts": []}
    reader = found.reader
    return {
        "points": {point: _health(health) for point, health in found.points.items()},
        "problems": found.problems,
        "sources": asdict(reader.sources),
        "left_out": [asdict(one) for one in reader.left_out],
        "doubts": reader.doubts,
    }


def _health(health: PointHealth) -> dict[str, Any]:
    return {
        "topic": health.topic,
        "samples": health.samples,
        "rate_hz": health.rate_hz,
        "gaps": len(health.gaps),
        "missing_s": health.missing_s,
        "clipped": health.clipped,
        "stuck_s": health.stuck_s,
        "clock_offset": health.clock_offset,
        "clock_drift": health.clock_drift,
        **asdict(health.faults),
    }


def _print_tables(document: dict[str, Any]) -> None:
    truncated = ", truncated" if document["truncated"] else ""
    damaged = f", {document['damaged']} damaged places" if document["damaged"] else ""
    results.print(Text(document["path"]))
    results.print(
        f"{document['messages']} messages over {document['duration']:.3f} s, "
        f"{document['lost']} lost{damaged}{truncated}",
        highlight=False,
    )
    table = narrow_table("", "topic", "type", ">messages")
    for name, topic in _first(document["topics"]):
        for kind, count in topic["types"].items():
            add_row(table, name, kind, count)
    results.print(table)
    _print_rest("topics", len(document["topics"]))
    for name, topic in _first(document["topics"]):
        if len(topic["types"]) > 1:
            results.print(Text(f"{name}: {len(topic['types'])} types, where ROS has one a topic; each is shown"))
    for doubt in document["doubts"][:_SHOWN]:
        results.print(Text(doubt))
    _print_rest("doubts", len(document["doubts"]))
    if "points" in document:
        _print_points(document)


def _print_points(document: dict[str, Any]) -> None:
    points = document["points"]
    columns = (">samples", ">rate (Hz)", ">gaps", ">(s)", ">clock (s)", ">(ppm)")
    table = narrow_table("\nsensors", "test point", *columns)
    for name, point in _first(points):
        add_row(
            table,
            name,
            point["samples"],
            f"{point['rate_hz']:.3f}",
            point["gaps"],
            f"{point['missing_s']:.3f}",
            f"{point['clock_offset']:+.3f}",
            f"{point['clock_drift']:+.2f}",
        )
    results.print(table)
    _print_rest("test points", len(points))
    for name, point in _first(points):
        faults = [f"{point[key]} {key}" for key in COUNTS if point[key]]
        faults += [f"{axis} stuck for {seconds:.1f} s" for axis, seconds in point["stuck_s"].items()]
        if faults:
            results.print(Text(f"{name}: {', '.join(faults)}"))
    for one in document.get("left_out", []):
        results.print(Text(str(LeftOut(**one))))
    for line in UsedSources(**document["sources"]).lines() if "sources" in document else []:
        results.print(Text(line))
    offsets = {name: point["clock_offset"] for name, point in points.items()}
    if offsets and max(offsets.values()) - min(offsets.values()) > APART_S:
        early, late = min(offsets, key=offsets.__getitem__), max(offsets, key=offsets.__getitem__)
        results.print(Text(f"the clocks of {early} and {late} are {offsets[late] - offsets[early]:.3f} s apart"))
    for name, problem in _first(document["problems"]):
        results.print(Text(f"{name}: {problem}" if name else problem))


def _first(rows: dict[str, Any]) -> list[tuple[str, Any]]:
    """Rows that a table shows."""
    return list(islice(rows.items(), _SHOWN))


def _print_rest(what: str, count: int) -> None:
    if count > _SHOWN:
        results.print(f"and {count - _SHOWN} more {what}, which --json lists", highlight=False)
