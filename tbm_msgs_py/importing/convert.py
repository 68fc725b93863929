"""A file of measurements becomes a recording: block topics of the contract, and the operating point."""

from __future__ import annotations

import heapq
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from tbm_msgs_py import topics
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.drive_state import DriveState, drive_name
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.files import write_whole
from tbm_msgs_py.base.operating_point import LARGEST, OperatingPoint
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.blocks import ACCELERATION, LONGEST_S
from tbm_msgs_py.importing.description import (
    DRIVES,
    NO_POINTS,
    Description,
    OperatingColumns,
    PointColumns,
    StreamColumns,
)
from tbm_msgs_py.importing.measurement_file import library_warnings
from tbm_msgs_py.importing.sources import Sources, StampedRows
from tbm_msgs_py.recordings.mapping import FILE_NAME, TopicMapping, contract_sensor

BLOCK_SAMPLES = topics.MODEL_BLOCK_SAMPLES


@dataclass
class ImportedStream:
    """What became of one topic.

    Attributes
    ----------
    topic : str
        Absolute name.
    samples : int
        Rows written.
    rate_hz : float
        From the median step.
    jitter : float
        Largest deviation of a step from the median one, as a share of it; gaps do not count.
    gaps, restarts : int
        Steps of more than 1.5 median ones; times that began again.
    unmeasured : list of str
        Sensor axes written as 0; quantities of drives that are not written.
    """

    topic: str
    samples: int = 0
    rate_hz: float = 0.0
    jitter: float = 0.0
    gaps: int = 0
    restarts: int = 0
    unmeasured: list[str] = field(default_factory=list)


@dataclass
class Imported:
    """Result of an import: streams (test points, ``operating_point``, ``drives``), and what the user should look at."""

    streams: dict[str, ImportedStream]
    warnings: list[str]


class _Message(NamedTuple):
    """What is written in one step: a block of a point, one operating point, or one state of the drives."""

    stamp_ns: int
    name: str
    times_ns: Integers
    values: Array


def import_recording(
    path: str | Path | Sequence[str | Path],
    description: Description,
    out: str | Path,
    progress: Callable[[int], None] | None = None,
) -> Imported:
    """Write the columns of a file, or of several, as a recording; nothing is left behind when one is refused.

    Times are kept as they are: no sample is resampled, dropped or made up.

    Parameters
    ----------
    path : str, Path or sequence of them
        CSV, TDMS, MDF 4, WAV or MATLAB files.
    description : Description
        What their columns are.
    out : str or Path
        New rosbag2 folder, or a bare ``.mcap`` file.
    progress : callable, optional
        Called with the number of samples of every message written.
    """
    paths = [Path(path)] if isinstance(path, str | Path) else [Path(one) for one in path]
    with library_warnings([str(path) for path in paths]) as texts:
        imported = _import(Sources(paths, description), description, Path(out), progress)
    return Imported(imported.streams, [*imported.warnings, *texts])


def _import(sources: Sources, description: Description, out: Path, progress: Callable[[int], None] | None) -> Imported:
    stated = _mapping(description)
    bare = out.suffix == ".mcap"
    if bare and any(sensor != contract_sensor(sensor.point) for sensor in stated.topics.values()):
        raise RecordingError(
            f"{out}: a bare file cannot say gravity, frame, axes or more of a sensor, allowed: a new folder"
        )
    if bare and stated.drives:
        raise RecordingError(f"{out}: a bare file cannot say low_pass_hz of the drives, allowed: a new folder")
    other_units = sources.check_units()
    streams = {name: _stream(name, entry.columns) for name, entry in description.streams.items()}
    groups = [{name: streams[name] for name in group} for group in sources.groups()]
    merged = heapq.merge(*(_messages(sources, description, group) for group in groups), key=lambda m: m.stamp_ns)
    with BagWriter(out) as writer:
        for message in _with_constant(merged, description.operating_point, streams):
            _write(writer, streams[message.name].topic, message)
            if progress:
                progress(len(message.times_ns))
        if (stated.topics or stated.drives) and not bare:
            content = stated.model_dump(mode="json", exclude_none=True)
            text = yaml.safe_dump(content, sort_keys=False)
            write_whole(out / FILE_NAME, text.encode())
    return Imported(streams, other_units)


def _mapping(description: Description) -> TopicMapping:
    """How the recording is to be read."""
    points = {topics.absolute(topics.field_block(name)): point.written() for name, point in description.points.items()}
    return TopicMapping(topics=points, drives=description.drives.written() if description.drives else None)


def _stream(name: str, columns: Sequence[str | None]) -> ImportedStream:
    if name == topics.OPERATING_POINT:
        return ImportedStream(topics.absolute(topics.OPERATING_POINT))
    if name == DRIVES:
        return ImportedStream(topics.absolute(topics.FIELD_DRIVES), unmeasured=_unmeasured(columns))
    missing = [axis for axis, column in zip("xyz", columns, strict=True) if column is None]
    return ImportedStream(topics.absolute(topics.field_block(name)), unmeasured=missing)


def _unmeasured(columns: Sequence[str | None]) -> list[str]:
    """Name what no column holds of the torques, then the speeds of the drives."""
    count, found = len(columns) // 2, list[str]()
    for what, own in (("torque", columns[:count]), ("speed", columns[count:])):
        lacking = [f"{drive_name(number)} {what}" for number, column in enumerate(own, 1) if column is None]
        found += [what] if len(lacking) == count else lacking
    return found


def _messages(sources: Sources, description: Description, streams: dict[str, ImportedStream]) -> Iterator[_Message]:
    """Messages of the streams of one time base, in the order of time."""
    entries, below = {name: description.streams[name] for name in streams}, _BelowZero()
    rows = sources.rows([column for entry in entries.values() for column in entry.columns if column])
    for stamps, values in rows:
        edges = rows.clock.gaps_before(stamps)
        messages = []
        for name, entry in entries.items():
            scaled = _scaled(rows, values, entry)
            if isinstance(entry, OperatingColumns):
                below.add(rows, entry, scaled)
            messages += _batches(name, stamps, scaled, edges)
        yield from sorted(messages, key=lambda message: message.stamp_ns)
    below.warn()
    for stream in streams.values():
        stream.samples, stream.gaps, stream.restarts = rows.clock.rows, rows.clock.gaps, rows.clock.restarts
        if rows.clock.step_ns:
            stream.rate_hz = NANOSECONDS / rows.clock.step_ns
            stream.jitter = rows.clock.jitter_ns / rows.clock.step_ns


class _BelowZero:
    """Counts operating values below zero: about zero a machine stands still, else a sign is wrong."""

    def __init__(self) -> None:
        self._rows: dict[str, int] = {}
        self._first: dict[str, str] = {}

    def add(self, rows: StampedRows, entry: OperatingColumns, scaled: Array) -> None:
        """Add rows in SI units, (n, k)."""
        for column, values, factor, unit in zip(
            entry.columns, scaled.T, entry.factors, entry.stated_units, strict=True
        ):
            below = np.flatnonzero(values < 0.0)
            if column and len(below):
                value = f"{values[below[0]] / factor:g} {unit}"
                self._first.setdefault(column, f"{rows.place(int(below[0]))}, column {column}: {value}")
                self._rows[column] = self._rows.get(column, 0) + len(below)

    def warn(self) -> None:
        """Warn of each column."""
        for column, first in self._first.items():
            count = self._rows[column]
            more = f", and {count - 1} more rows below 0" if count > 1 else ", below 0"
            warnings.warn(f"{first}{more}: no comparison is made with such an operating point", stacklevel=2)


def _scaled(rows: StampedRows, values: Array, entry: StreamColumns) -> Array:
    """Values of a stream in SI units, (n, k); refuses those that its message cannot hold."""
    pairs = list(zip(entry.columns, entry.constants, strict=True))
    parts = [
        values[:, rows.columns.index(column)] if column else np.full(len(values), constant)
        for column, constant in pairs
    ]
    largest = float(np.finfo(np.float32).max) if isinstance(entry, PointColumns) else LARGEST
    with np.errstate(over="ignore"):
        scaled = np.column_stack(parts) * entry.factors
    stated = np.array([column is not None or math.isfinite(constant) for column, constant in pairs])
    too_large = np.argwhere(stated & ~(np.abs(scaled) <= largest))
    if len(too_large):
        row, column = too_large[0]
        raise RecordingError(
            f"{rows.place(row)}, column {entry.columns[column]}: {parts[column][row]:g} {entry.stated_units[column]}, "
            f"allowed: up to {largest:.3g} in SI units"
        )
    return np.asarray(scaled, np.float64)


def _with_constant(
    messages: Iterator[_Message], operating: OperatingColumns | None, streams: dict[str, ImportedStream]
) -> Iterator[_Message]:
    """Messages, and before the first of them an operating point that is constant: it is in force from then on."""
    if operating is None or any(operating.columns):
        yield from messages
        return
    first = next(messages)
    values = np.array([operating.constants]) * operating.factors
    streams[topics.OPERATING_POINT].samples = 1
    yield _Message(first.stamp_ns, topics.OPERATING_POINT, np.array([first.stamp_ns]), values)
    yield first
    yield from messages


def _batches(name: str, stamps: Integers, values: Array, edges: NDArray[np.intp]) -> list[_Message]:
    """Messages of the rows of a piece: single joint states, blocks that end at a gap or would last too long."""
    slow = np.flatnonzero(np.diff(stamps) >= LONGEST_S * NANOSECONDS / BLOCK_SAMPLES) + 1
    edges = np.union1d(edges, slow)
    if name in NO_POINTS:
        starts = list(range(len(stamps)))
    else:
        starts = [
            first
            for begin, end in zip([0, *edges], [*edges, len(stamps)], strict=True)
            for first in range(int(begin), int(end), BLOCK_SAMPLES)
        ]
    ends = [*starts[1:], len(stamps)]
    return [
        _Message(int(stamps[first]), name, stamps[first:end], values[first:end])
        for first, end in zip(starts, ends, strict=True)
    ]


def _write(writer: BagWriter, topic: str, message: _Message) -> None:
    if message.name == topics.OPERATING_POINT:
        speed, torque, thrust, *advance = map(float, message.values[0])
        point = OperatingPoint(speed, torque, thrust, advance=advance[0] if advance else 0.0)
        writer.write_operating_point(message.stamp_ns, point)
        return
    if message.name == DRIVES:
        torques, speeds = np.split(message.values[0], 2)
        writer.write_drives(message.stamp_ns, DriveState(tuple(torques.tolist()), tuple(speeds.tolist())))
        return
    offsets = (message.times_ns - message.stamp_ns) / NANOSECONDS
    writer.write_block(topic, message.stamp_ns, ACCELERATION, offsets, message.values, frame_id=message.name)
