"""Stand-in for `tbm_msgs_py.recording.open_recording` over `read_recording`: everything in memory at once."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from tbm_msgs_py.bags.mapping import Mapping as TopicMapping
from tbm_msgs_py.bags.mapping import SensorMapping, contract_sensor
from tbm_msgs_py.recording import AccelerationRecord, find_gaps, read_recording


class RecordingReader:
    """A recording in pieces."""

    def __init__(self, path: str | Path, mapping: TopicMapping | str | Path | None = None) -> None:
        self._recording = read_recording(path, mapping)
        self.operating_point = self._recording.operating_point
        self.messages, self.lost = self._recording.messages, self._recording.lost
        self.truncated, self.sha256 = self._recording.truncated, self._recording.sha256

    @property
    def points(self) -> Mapping[str, SensorMapping]:
        """Mapped points that are in the recording."""
        return {
            point: contract_sensor(point).model_copy(update={"frame": record.frame, "gravity": record.gravity})
            for point, record in self._recording.points.items()
        }

    def pieces(self, length_s: float = 60.0) -> Iterator[Mapping[str, AccelerationRecord]]:
        """Consecutive stretches of header time."""
        records = self._recording.points
        begin = min(record.start_ns for record in records.values())
        place, first = 0, dict.fromkeys(records, True)
        while True:
            piece = {}
            for point, record in records.items():
                offset = (record.start_ns - begin) * 1e-9
                inside = slice(*np.searchsorted(record.time + offset, [place * length_s, (place + 1) * length_s]))
                if inside.stop > inside.start:
                    time = record.time[inside]
                    start = record.start_ns + round(float(time[0]) * 1e9)
                    gaps, rate = find_gaps(time - time[0])
                    counts = {} if first[point] else {"duplicates": 0, "invalid": 0, "undecodable": 0, "clipped": 0}
                    first[point] = False
                    piece[point] = replace(
                        record, start_ns=start, time=time - time[0], values=record.values[inside], gaps=gaps,
                        rate_hz=rate, **counts,
                    )
            yield piece
            place += 1
            if all((r.start_ns - begin) * 1e-9 + r.time[-1] < place * length_s for r in records.values()):
                return


def open_recording(path: str | Path, mapping: TopicMapping | str | Path | None = None) -> RecordingReader:
    """Open a recording."""
    return RecordingReader(path, mapping)
