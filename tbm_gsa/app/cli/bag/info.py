"""`tbm-monitor bag info`: what a recording holds, and with `--scan` what is wrong with it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Annotated, TypeVar

import typer
from rich.text import Text

from tbm_gsa.app.cli.output import JSON_OPTION, add_row, narrow_table, print_json, progress_bar, results
from tbm_gsa.app.cli.shipped import MAPPING_OPTION, RECORDING_ARGUMENT, recording_path
from tbm_gsa.reading import Maybe, Part
from tbm_msgs_py.bags.bag import Bag, BagInfo
from tbm_msgs_py.bags.definitions import JOINT_STATE_TYPE, definition_hash
from tbm_msgs_py.base.errors import InputError, RecordingError
from tbm_msgs_py.base.texts import listed
from tbm_msgs_py.recordings.channels import LeftOut
from tbm_msgs_py.recordings.decoding import ACCELERATION_TYPES
from tbm_msgs_py.recordings.drives import DriveRecord
from tbm_msgs_py.recordings.recording_health import COUNTS, PointHealth, check_recording
from tbm_msgs_py.recordings.used import UsedSources

_SHOWN = 200  # topics and test points: a terminal takes a quarter of a minute for 60 000
APART_S = 1.0  # clocks that differ by more get a line of their own
_Row = TypeVar("_Row")


class TopicCount(Part):
    """Messages of one topic, also by type; `type` is that of most of them."""

    type: str
    types: dict[str, int]
    messages: int


class BagContents(Part):
    """What `bag info --json` prints; the duration is in s."""

    path: str
    messages: int
    lost: int
    truncated: bool
    damaged: int
    notes: tuple[str, ...]
    start_ns: int
    duration: float
    topics: dict[str, TopicCount]
    doubts: tuple[str, ...]

    @classmethod
    def of(cls, path: Path, found: BagInfo) -> BagContents:
        """Contents of the recording at a path."""
        types: dict[str, Counter[str]] = {}
        for topic, count in found.topics.items():
            types.setdefault(topic.name, Counter())[topic.type] += count
        topics = {
            name: TopicCount(type=max(sorted(by), key=by.__getitem__), types=dict(by), messages=by.total())
            for name, by in sorted(types.items())
        }
        return cls(
            path=str(path),
            messages=found.messages,
            lost=found.lost,
            truncated=found.truncated,
            damaged=found.damaged,
            notes=found.notes,
            start_ns=found.start_ns,
            duration=found.duration,
            topics=topics,
            doubts=(),
        )


class SensorHealth(Part):
    """Sums of the samples and faults of one test point; times in s, the drift of the clock in parts per million."""

    topic: str
    samples: int
    rate_hz: float
    gaps: int
    missing_s: float
    clipped: int
    stuck_s: dict[str, float]
    clock_offset: Maybe
    clock_drift: Maybe
    undecodable: int
    astray: int
    invalid: int
    duplicates: int
    late: int
    unstamped: int
    unmeasured: int
    disordered: int
    clock_steps: int

    @classmethod
    def of(cls, health: PointHealth) -> SensorHealth:
        """Health of a test point, as it is printed."""
        return cls(
            topic=health.topic,
            samples=health.samples,
            rate_hz=health.rate_hz,
            gaps=len(health.gaps),
            missing_s=health.missing_s,
            stuck_s=health.stuck_s,
            clock_offset=health.clock_offset,
            clock_drift=health.clock_drift,
            **health.counts(),
        )


class DriveHealth(Part):
    """Torque and speed of the drives: the share of the samples that hold a number, by drive; times in s."""

    topic: str
    samples: int
    rate_hz: float
    duration: float
    duplicates: int
    torque: dict[str, float]
    speed: dict[str, float]

    @classmethod
    def of(cls, topic: str, record: DriveRecord) -> DriveHealth:
        """Health of the drives of a recording."""
        return cls(
            topic=topic,
            samples=len(record.time),
            rate_hz=record.rate_hz,
            duration=float(record.time[-1]),
            duplicates=record.duplicates,
            torque=record.known("torque"),
            speed=record.known("speed"),
        )

    def line(self) -> str:
        """Return the health in one line: samples, rate, and the drives whose values are not all numbers."""
        parts = [f"{self.samples} samples", f"{self.rate_hz:.4g} Hz"]
        for what, shares in (("torque", self.torque), ("speed", self.speed)):
            lacking = [f"{name} {share:.0%}" for name, share in shares.items() if share < 1.0]
            parts.append(f"{what} of {len(shares)} drives" + (f" ({listed(lacking)})" if lacking else ""))
        return f"drives {self.topic}: " + ", ".join(
            [*parts, *[f"{self.duplicates} duplicates"] * bool(self.duplicates)]
        )


class ScannedBag(BagContents):
    """What `bag info --scan --json` prints: also the sensors by test point, and why others have no samples.

    What it was made from is none where nothing could be read.
    """

    points: dict[str, SensorHealth]
    problems: dict[str, str]
    left_out: tuple[LeftOut, ...]
    sources: UsedSources | None
    drives: DriveHealth | None = None


def info(
    bag: Annotated[Path, RECORDING_ARGUMENT],
    scan: Annotated[bool, typer.Option("--scan", help="Read it through for damage and faults of the sensors.")] = False,
    mapping: Annotated[Path | None, MAPPING_OPTION] = None,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """List the topics of a recording, its length, and what is missing."""
    if mapping is not None and not scan:
        raise InputError("--mapping: allowed only with --scan, which reads the sensors")
    bag = recording_path(bag)
    recording = Bag(bag)
    with progress_bar("reading") as progress:
        if scan:
            progress.add_task("", total=None)
        contents = recording.info(scan=scan)
        found = BagContents.of(bag, contents).model_copy(update={"doubts": tuple(_doubts(contents))})
        if scan:
            found = _scanned(found, bag, mapping)
    if json:
        print_json(found)
    else:
        _print_tables(found)


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


def _scanned(contents: BagContents, bag: Path, mapping: Path | None) -> ScannedBag:
    try:
        health = check_recording(bag, mapping)
    except RecordingError as error:
        if mapping is not None:
            raise
        return ScannedBag(**dict(contents), points={}, problems={"": str(error)}, sources=None, left_out=())
    reader = health.reader
    drives = reader.drives
    return ScannedBag(
        # Messages that are there and cannot be used are lost, too.
        **(dict(contents) | {"doubts": (*contents.doubts, *reader.doubts), "lost": max(contents.lost, reader.lost)}),
        points={point: SensorHealth.of(one) for point, one in health.points.items()},
        problems=health.problems,
        sources=reader.sources,
        left_out=tuple(reader.left_out),
        drives=None if drives is None else DriveHealth.of(reader.drive_mapping.topic, drives),
    )


def _print_tables(found: BagContents) -> None:
    truncated = ", truncated" if found.truncated else ""
    damaged = f", {found.damaged} damaged places" if found.damaged else ""
    results.print(Text(found.path))
    results.print(
        f"{found.messages} messages over {found.duration:.3f} s, {found.lost} lost{damaged}{truncated}", highlight=False
    )
    for note in found.notes:
        results.print(Text(note))
    table = narrow_table("", "topic", "type", ">messages")
    for name, topic in _first(found.topics):
        for kind, count in topic.types.items():
            add_row(table, name, kind, count)
    results.print(table)
    _print_rest("topics", len(found.topics))
    for name, topic in _first(found.topics):
        if len(topic.types) > 1:
            results.print(Text(f"{name}: {len(topic.types)} types, where ROS has one a topic; each is shown"))
    for doubt in found.doubts[:_SHOWN]:
        results.print(Text(doubt))
    _print_rest("doubts", len(found.doubts))
    if isinstance(found, ScannedBag):
        _print_points(found)


def _print_points(found: ScannedBag) -> None:
    columns = (">samples", ">rate (Hz)", ">gaps", ">(s)", ">clock (s)", ">(ppm)")
    table = narrow_table("\nsensors", "test point", *columns)
    for name, point in _first(found.points):
        clock = (f"{point.clock_offset:+.3f}", f"{point.clock_drift:+.2f}")
        add_row(table, name, point.samples, f"{point.rate_hz:.3f}", point.gaps, f"{point.missing_s:.3f}", *clock)
    if found.points:
        results.print(table)
    _print_rest("test points", len(found.points))
    for name, point in _first(found.points):
        faults = [f"{getattr(point, key)} {key}" for key in COUNTS if getattr(point, key)]
        faults += [f"{axis} stuck for {seconds:.1f} s" for axis, seconds in point.stuck_s.items()]
        if faults:
            results.print(Text(f"{name}: {', '.join(faults)}"))
    if found.drives is not None:
        results.print(Text(found.drives.line()))
    for line in (*map(str, found.left_out), *(found.sources.lines() if found.sources else ())):
        results.print(Text(line))
    offsets = {name: point.clock_offset for name, point in found.points.items()}
    if offsets and max(offsets.values()) - min(offsets.values()) > APART_S:
        early, late = min(offsets, key=offsets.__getitem__), max(offsets, key=offsets.__getitem__)
        results.print(Text(f"the clocks of {early} and {late} are {offsets[late] - offsets[early]:.3f} s apart"))
    for name, problem in _first(found.problems):
        results.print(Text(f"{name}: {problem}" if name else problem))


def _first(rows: dict[str, _Row]) -> list[tuple[str, _Row]]:
    """Rows that a table shows."""
    return list(islice(rows.items(), _SHOWN))


def _print_rest(what: str, count: int) -> None:
    if count > _SHOWN:
        results.print(f"and {count - _SHOWN} more {what}, which --json lists", highlight=False)
