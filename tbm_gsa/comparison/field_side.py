"""The recorded side: every point of a recording reduced piece by piece, and what was wrong with its data."""

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from tbm_gsa.comparison.levels import OperatingHistory
from tbm_gsa.comparison.offline import compared_band
from tbm_gsa.signals.clock import sampling_rate
from tbm_gsa.signals.conditioning import Frame
from tbm_gsa.signals.reduction import ReducedSignal, SignalReducer
from tbm_gsa.signals.settings import Settings
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.progress import ShareDone
from tbm_msgs_py.recordings.acceleration import AccelerationRecord
from tbm_msgs_py.recordings.clocks import clock_shifts
from tbm_msgs_py.recordings.drives import DriveRecord
from tbm_msgs_py.recordings.recording import NoSampleError, RecordingReader
from tbm_msgs_py.recordings.recording_health import PointHealth, RecordingHealth

LEAST_SAMPLES = 1000  # that a sampling rate is taken from, if there are as many


@dataclass(frozen=True, eq=False)
class FieldSide:
    """A recording, reduced.

    Attributes
    ----------
    signals : mapping of str to ReducedSignal
        By test point.
    health : mapping of str to PointHealth
        Of every recorded point.
    failed : mapping of str to str
        Points whose signal cannot be conditioned, with the reason.
    shifts : mapping of str to int
        How far the clock of a point is ahead of that of the others, ns, where it is another one.
    drives : DriveRecord or None
        Of a recording without any other sample: they say how long it is.
    """

    signals: Mapping[str, ReducedSignal]
    health: Mapping[str, PointHealth]
    failed: Mapping[str, str]
    shifts: Mapping[str, int]
    drives: DriveRecord | None = None

    @property
    def begin_ns(self) -> int:
        """Time of the first sample of all, on the clock of the others where a point has its own."""
        if self.drives is not None:
            return self.drives.start_ns
        return min(health.start_ns - self.shifts.get(point, 0) for point, health in self.health.items())

    @property
    def end_ns(self) -> int:
        """Time of the last sample of all, likewise."""
        if self.drives is not None:
            return self.drives.end_ns
        ends = {point: health.start_ns + round(health.duration * 1e9) for point, health in self.health.items()}
        return max(end - self.shifts.get(point, 0) for point, end in ends.items())


def reduce_field(
    reader: RecordingReader,
    points: Collection[str],
    settings: Settings,
    history: OperatingHistory | None = None,
    shifts: Mapping[str, int] | None = None,
    progress: ShareDone = lambda _: None,
) -> FieldSide:
    """Read a recording from beginning to end.

    Parameters
    ----------
    reader : RecordingReader
    points : collection of str
        Points to reduce; the others are counted only.
    settings : Settings
    history : OperatingHistory, optional
        Levels of operation, if they are known and several.
    shifts : mapping of str to int, optional
        Those of a reading before, without which levels cannot be told.
    progress : callable
        Called with the seconds of the recording that are done.
    """
    recorded = RecordingHealth(reader)
    known = shifts or {}
    intakes = {point: _Intake(reader.sensors[point].frame, settings, history, known.get(point, 0)) for point in points}
    signals: dict[str, ReducedSignal] = {}
    failed: dict[str, str] = {}
    for piece in _pieces(reader):
        recorded.add(piece)
        for point in intakes.keys() & piece.keys() - failed.keys():
            with _noted(failed, point):
                intakes[point].feed(piece[point])
        if recorded.points:
            progress(max(health.duration for health in recorded.points.values()))
    for point in [point for point in points if point not in failed]:
        with _noted(failed, point):
            signals[point] = intakes[point].finish()
    drives = None if recorded.points else reader.drives
    return FieldSide(signals, recorded.points, failed, clock_shifts(reader.clocks), drives)


def _pieces(reader: RecordingReader) -> Iterator[Mapping[str, AccelerationRecord]]:
    """Pieces of a recording; none of one that holds the drives alone."""
    try:
        yield from reader.pieces()
    except NoSampleError:
        if reader.drives is None:
            raise


@contextmanager
def _noted(failed: dict[str, str], point: str) -> Iterator[None]:
    """Note what is wrong with a point, which ends the reduction of this point only."""
    try:
        yield
    except InputError as error:
        failed[point] = str(error)


class _Intake:
    """Pieces of one point: the first ones wait until the sampling rate is known."""

    def __init__(self, frame: Frame, settings: Settings, history: OperatingHistory | None, shift_ns: int) -> None:
        self._frame, self._settings, self._history, self._shift_ns = frame, settings, history, shift_ns
        self._waiting: list[AccelerationRecord] = []
        self._origin_ns = 0
        self._reducer: SignalReducer | None = None

    def feed(self, record: AccelerationRecord) -> None:
        """Reduce the next piece."""
        self._waiting.append(record)
        if self._reducer or sum(len(one.time) for one in self._waiting) >= LEAST_SAMPLES:
            self._work_off()

    def finish(self) -> ReducedSignal:
        """Reduced signal."""
        if self._waiting:
            self._work_off()
        if self._reducer is None:
            raise InputError("no sample")
        return self._reducer.finish()

    def _work_off(self) -> None:
        reducer = self._reducer = self._reducer or self._begin()
        for record in self._waiting:
            reducer.feed(self._seconds(record), record.values)
        self._waiting = []

    def _begin(self) -> SignalReducer:
        self._origin_ns = self._waiting[0].start_ns
        rate = sampling_rate(np.concatenate([self._seconds(record) for record in self._waiting]))
        level_of = self._history.level_of(self._origin_ns - self._shift_ns) if self._history else None
        band = compared_band(rate, self._settings.model_rate_hz, self._settings)
        return SignalReducer(rate, band, self._frame, self._settings, level_of)

    def _seconds(self, record: AccelerationRecord) -> Array:
        """Return the times of a piece after the point's first sample, s."""
        return (record.start_ns - self._origin_ns) * 1e-9 + record.time
