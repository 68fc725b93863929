"""TDMS files of LabVIEW: channels ``group/channel``, each with its own time base, read a piece at a time."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.importing.description import TimeColumn
from tbm_msgs_py.importing.extra import library, reading
from tbm_msgs_py.importing.source import PIECE_ROWS, Piece, nanoseconds, no_column, require_finite


class TdmsFile:
    """A TDMS file; the channels of one test point share their length and increment."""

    shared_rows = False
    full_scale = False

    def __init__(self, path: Path) -> None:
        self.path = path
        nptdms: Any = library("nptdms")
        # Its warnings go into the result; it would print them too.
        library("nptdms.log").log_manager.console_handler.setLevel(logging.CRITICAL)
        with reading(path, "a TDMS"):
            self._file = nptdms.TdmsFile.open(path)
        self._channels = {f"{g.name}/{c.name}": c for g in self._file.groups() for c in g.channels()}

    @property
    def start_ns(self) -> int | None:
        """Earliest start that a waveform states."""
        starts = [c.properties["wf_start_time"] for c in self._channels.values() if "wf_start_time" in c.properties]
        return min((int(np.datetime64(start, "ns").astype(np.int64)) for start in starts), default=None)

    def row(self, index: int) -> str:
        """Name a row for a message."""
        return f"sample {index + 1}"

    def unit(self, column: str) -> str:
        """Give the unit that the file states."""
        return str(self._channel(column).properties.get("unit_string", ""))

    def pieces(self, columns: Sequence[str], time: TimeColumn | str | None) -> Iterator[Piece]:
        """Rows of these channels, see `Source`."""
        clock = [time.column] if isinstance(time, TimeColumn) else []
        channels = [self._channel(column) for column in (*columns, *clock)]
        lengths = {len(channel) for channel in channels}
        if len(lengths) > 1:
            raise RecordingError(
                f"{self.path}: channels {', '.join((*columns, *clock))} have {' and '.join(map(str, sorted(lengths)))} "
                "samples, allowed: channels of the same length"
            )
        base = self._base(columns, channels) if time == "file" else None
        for first in range(0, max(lengths), PIECE_ROWS):
            rows = [_numbers(self.path, channel, first) for channel in channels]
            values = np.column_stack(rows).astype(np.float64)
            require_finite(self.path, [*columns, *clock], values, first)
            times = None
            if isinstance(time, TimeColumn):
                times = self._times(rows[-1], time)
                values = values[:, :-1]
            elif base:
                times = np.rint((base[0] + base[1] * np.arange(first, first + len(values))) * NANOSECONDS)
                times = times.astype(np.int64)
            yield Piece(values, times)

    def _times(self, rows: NDArray[np.generic], time: TimeColumn) -> NDArray[np.int64]:
        if time.unit == "datetime":
            raise RecordingError(f"{self.path}: time: unit datetime, allowed: s, ms, us or ns in a TDMS file")
        return nanoseconds(rows, time.unit)

    def _base(self, columns: Sequence[str], channels: Sequence[Any]) -> tuple[float, float]:
        """Offset and increment (s) that all channels state, the offset after the earliest start of the file."""
        bases = set()
        for column, channel in zip(columns, channels, strict=True):
            increment = float(channel.properties.get("wf_increment", 0.0))
            if increment <= 0.0:
                raise RecordingError(
                    f"{self.path}: time: file: channel {column} has no wf_increment, allowed: a time channel or a rate"
                )
            offset = float(channel.properties.get("wf_start_offset", 0.0))
            if "wf_start_time" in channel.properties and self.start_ns is not None:
                own = int(np.datetime64(channel.properties["wf_start_time"], "ns").astype(np.int64))
                offset += (own - self.start_ns) / NANOSECONDS
            bases.add((offset, increment))
        if len(bases) > 1:
            raise RecordingError(f"{self.path}: channels {', '.join(columns)} state different times, allowed: the same")
        return bases.pop()

    def _channel(self, column: str) -> Any:
        if column not in self._channels:
            no_column(self.path, column, sorted(self._channels))
        return self._channels[column]


def _numbers(path: Path, channel: Any, first: int) -> NDArray[np.generic]:
    with reading(path, "a TDMS"):
        rows = np.asarray(channel[first : first + PIECE_ROWS])
    if rows.dtype.kind not in "iuf":
        raise RecordingError(f"{path}: column {channel.path}: {rows.dtype}, allowed: real numbers")
    return rows
