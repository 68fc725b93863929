"""A file of measurements becomes a recording: block topics of the contract, and the operating point."""

from __future__ import annotations

import heapq
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
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.files import write_whole
from tbm_msgs_py.base.operating_point import OperatingPoint
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.blocks import ACCELERATION
from tbm_msgs_py.importing.csv_file import CsvFile
from tbm_msgs_py.importing.description import Description, TimeColumn, same_unit
from tbm_msgs_py.importing.matlab_file import MatlabFile
from tbm_msgs_py.importing.mdf_file import MdfFile
from tbm_msgs_py.importing.measurement_file import MeasurementFile, library_warnings
from tbm_msgs_py.importing.tdms_file import TdmsFile
from tbm_msgs_py.importing.timing import RowTimes
from tbm_msgs_py.importing.wav_file import WavFile
from tbm_msgs_py.recordings import mapping
from tbm_msgs_py.recordings.mapping import contract_sensor

BLOCK_SAMPLES = topics.MODEL_BLOCK_SAMPLES
_OPENERS: dict[str, Callable[[Path, Description], MeasurementFile]] = {
    ".csv": lambda path, description: CsvFile(path, description.csv),
    ".txt": lambda path, description: CsvFile(path, description.csv),
    ".tdms": lambda path, _: TdmsFile(path),
    ".mf4": lambda path, _: MdfFile(path),
    ".wav": lambda path, _: WavFile(path),
    ".mat": lambda path, _: MatlabFile(path),
}


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
        Sensor axes written as 0.
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
    """Result of an import: streams by test point (and ``operating_point``), and what the user should look at."""

    streams: dict[str, ImportedStream]
    warnings: list[str]


class _Message(NamedTuple):
    """What is written in one step: a block of a point, or one operating point."""

    stamp_ns: int
    name: str
    times_ns: Integers
    values: Array


def import_recording(
    path: str | Path, description: Description, out: str | Path, progress: Callable[[int], None] | None = None
) -> Imported:
    """Write the columns of a file as a recording; nothing is left behind when the file is refused.

    Times are kept as they are: no sample is resampled, dropped or made up.

    Parameters
    ----------
    path : str or Path
        CSV, TDMS, MDF 4, WAV or MATLAB file.
    description : Description
        What its columns are.
    out : str or Path
        New rosbag2 folder, or a bare ``.mcap`` file.
    progress : callable, optional
        Called with the number of samples of every message written.
    """
    path, out = Path(path), Path(out)
    with library_warnings(path) as texts:
        imported = _import(path, description, out, progress)
    return Imported(imported.streams, [*imported.warnings, *texts])


def _open(path: Path, description: Description) -> MeasurementFile:
    opener = _OPENERS.get(path.suffix.lower())
    if opener is None:
        raise RecordingError(f"{path}: suffix {path.suffix or 'missing'}, allowed: {', '.join(_OPENERS)}")
    if not path.is_file():
        raise RecordingError(f"{path}: no such file, allowed: a file of measurements")
    return opener(path, description)


def _import(path: Path, description: Description, out: Path, progress: Callable[[int], None] | None) -> Imported:
    file = _open(path, description)
    stated = {topics.absolute(topics.field_block(name)): point.written() for name, point in description.points.items()}
    if out.suffix == ".mcap" and any(sensor != contract_sensor(sensor.point) for sensor in stated.values()):
        raise RecordingError(
            f"{out}: a bare file cannot say gravity, frame, axes, rotation and range, allowed: a new folder"
        )
    warnings = _check_units(file, description)
    streams = {name: _stream(name, entry.columns) for name, entry in description.streams.items()}
    groups = [streams] if file.shared_rows else [{name: stream} for name, stream in streams.items()]
    messages = [_messages(file, description, group) for group in groups]
    with BagWriter(out) as writer:
        for message in heapq.merge(*messages, key=lambda message: message.stamp_ns):
            _write(writer, streams[message.name].topic, message)
            if progress:
                progress(len(message.times_ns))
        if stated and out.suffix != ".mcap":
            content = mapping.TopicMapping(topics=stated).model_dump(mode="json", exclude_none=True)
            text = yaml.safe_dump(content, sort_keys=False)
            write_whole(out / mapping.FILE_NAME, text.encode())
    return Imported(streams, warnings)


def _stream(name: str, columns: Sequence[str | None]) -> ImportedStream:
    if name == topics.OPERATING_POINT:
        return ImportedStream(topics.absolute(topics.OPERATING_POINT))
    missing = [axis for axis, column in zip("xyz", columns, strict=True) if column is None]
    return ImportedStream(topics.absolute(topics.field_block(name)), unmeasured=missing)


def _check_units(file: MeasurementFile, description: Description) -> list[str]:
    """Refuse a missing full scale; warnings where the file states another unit than the user."""
    for name, point in description.points.items():
        if file.full_scale and point.full_scale is None:
            raise file.error(f"points.{name}.full_scale: missing, allowed: what full scale is in {point.units}")
    return [
        f"{file.path}: column {column}: the file says {label}, the description {unit}"
        for entry in description.streams.values()
        for column, unit in zip(entry.columns, entry.stated_units, strict=True)
        if column and (label := file.unit(column).strip()) and not same_unit(label, unit)
    ]


def _messages(
    file: MeasurementFile, description: Description, streams: dict[str, ImportedStream]
) -> Iterator[_Message]:
    """Messages of the streams of one time base, in the order of time."""
    entries = {name: description.streams[name] for name in streams}
    columns = list(dict.fromkeys(column for entry in entries.values() for column in entry.columns if column))
    time, start_ns = description.time, description.start_ns
    if description.start == "file":
        if file.start_ns is None:
            raise file.error("start: file: the file states no moment, allowed: a date and time with its zone")
        start_ns = file.start_ns
    clock = RowTimes(file, start_ns, description.rate, time.restart_gap if isinstance(time, TimeColumn) else None)
    for piece in file.pieces(columns, time):
        stamps = clock.stamps(piece.times_ns, len(piece.values))
        edges = clock.gaps_before(stamps)
        messages = []
        for name, entry in entries.items():
            # An axis that was not measured is 0.
            values = [piece.values[:, columns.index(c)] if c else np.zeros(len(stamps)) for c in entry.columns]
            scaled = np.column_stack([column * by for column, by in zip(values, entry.factors, strict=True)])
            messages += _batches(name, stamps, scaled, edges)
        yield from sorted(messages, key=lambda message: message.stamp_ns)
    for stream in streams.values():
        stream.samples, stream.gaps, stream.restarts = clock.rows, clock.gaps, clock.restarts
        if clock.step_ns:
            stream.rate_hz = NANOSECONDS / clock.step_ns
            stream.jitter = clock.jitter_ns / clock.step_ns


def _batches(name: str, stamps: Integers, values: Array, edges: NDArray[np.intp]) -> list[_Message]:
    """Messages of the rows of a piece: single operating points, blocks that end at a gap."""
    if name == topics.OPERATING_POINT:
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
    offsets = (message.times_ns - message.stamp_ns) / NANOSECONDS
    writer.write_block(topic, message.stamp_ns, ACCELERATION, offsets, message.values, frame_id=message.name)
