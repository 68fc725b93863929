"""TDMS files of LabVIEW: channels ``group/channel``, each with its own time base, read a piece at a time."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.importing.description import TimeBase, TimeColumn
from tbm_msgs_py.importing.measurement_file import MeasurementFile, Rows, library


class TdmsFile(MeasurementFile):
    """A TDMS file; the channels of one test point share their length and increment."""

    kind = "a TDMS"
    shared_rows = False
    clocks = ("file", "column")

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        nptdms: Any = library("nptdms")
        # Its warnings go into the result; it would print them too.
        library("nptdms.log").log_manager.console_handler.setLevel(logging.CRITICAL)
        with self.reading():
            self._file = nptdms.TdmsFile.open(path)
        self._channels = {f"{g.name}/{c.name}": c for g in self._file.groups() for c in g.channels()}

    @property
    def start_ns(self) -> int | None:
        """Earliest start that a waveform states."""
        return min(
            (start for channel in self._channels.values() if (start := _start_ns(channel)) is not None), default=None
        )

    def unit(self, column: str) -> str:
        """Return the unit that the file states."""
        return str(self._channel(column).properties.get("unit_string", ""))

    def _pieces(self, columns: Sequence[str], time: TimeBase) -> Iterator[Rows]:
        clock = time if isinstance(time, TimeColumn) else None
        channels = [self._channel(column) for column in (*columns, *([clock.column] if clock else []))]
        if time != "file":
            return self.in_pieces(columns, channels, clock)
        offset, increment = self._base(columns, channels)
        return self.in_pieces(columns, channels, ticks=lambda rows: (offset + increment * rows) * NANOSECONDS)

    def _base(self, columns: Sequence[str], channels: Sequence[Any]) -> tuple[float, float]:
        """Offset and increment (s) that all channels state, the offset after the earliest start of the file."""
        bases = set()
        for column, channel in zip(columns, channels, strict=True):
            increment = float(channel.properties.get("wf_increment", 0.0))
            if increment <= 0.0:
                raise self.error(f"time: file: channel {column} has no wf_increment, allowed: a time channel or a rate")
            offset = float(channel.properties.get("wf_start_offset", 0.0))
            own, earliest = _start_ns(channel), self.start_ns
            if own is not None and earliest is not None:
                offset += (own - earliest) / NANOSECONDS
            bases.add((offset, increment))
        if len(bases) > 1:
            raise self.error(f"channels {', '.join(columns)} state different times, allowed: the same")
        return bases.pop()

    def _channel(self, column: str) -> Any:
        if column not in self._channels:
            raise self.no_column(column, sorted(self._channels))
        return self._channels[column]


def _start_ns(channel: Any) -> int | None:
    """Start that the waveform of a channel states, ns since the epoch."""
    start = channel.properties.get("wf_start_time")
    return None if start is None else int(np.datetime64(start, "ns").astype(np.int64))
