"""The recorded side: every point of a recording reduced piece by piece, and what was wrong with its data."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np

from tbm_gsa.comparison.levels import OperatingHistory
from tbm_gsa.comparison.model_run import MODEL_RATE_HZ
from tbm_gsa.comparison.offline import compared_band
from tbm_gsa.signals.clock import sampling_rate
from tbm_gsa.signals.conditioning import Frame
from tbm_gsa.signals.reduction import ReducedSignal, SignalReducer
from tbm_gsa.signals.settings import Settings
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.recordings.health import PointHealth, Tally
from tbm_msgs_py.recordings.recording import AccelerationRecord, RecordingReader

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
    """

    signals: Mapping[str, ReducedSignal]
    health: Mapping[str, PointHealth]
    failed: Mapping[str, str]

    @property
    def begin_ns(self) -> int:
        """Header time of the first sample of all."""
        return min(health.start_ns for health in self.health.values())

    @property
    def end_ns(self) -> int:
        """Header time of the last sample of all."""
        return max(health.start_ns + round(health.duration * 1e9) for health in self.health.values())


def reduce_field(
    reader: RecordingReader,
    points: Collection[str],
    settings: Settings,
    history: OperatingHistory | None = None,
    progress: Callable[[float], None] = lambda _: None,
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
    progress : callable
        Called with the seconds of the recording that are done.
    """
    tally = Tally(reader)
    intakes = {point: _Intake(reader.points[point].frame, settings, history) for point in points}
    for piece in reader.pieces():
        tally.add(piece)
        for point, record in piece.items():
            if point in intakes:
                intakes[point].feed(record)
        if tally.points:
            progress(max(health.duration for health in tally.points.values()))
    signals = {point: intakes[point].finish() for point in points}
    return FieldSide(
        {point: signal for point, signal in signals.items() if isinstance(signal, ReducedSignal)},
        tally.finish(),
        {point: signal for point, signal in signals.items() if isinstance(signal, str)},
    )


class _Intake:
    """Pieces of one point: the first ones wait until the sampling rate is known."""

    def __init__(self, frame: Frame, settings: Settings, history: OperatingHistory | None) -> None:
        self._frame, self._settings, self._history = frame, settings, history
        self._waiting: list[AccelerationRecord] = []
        self._origin_ns = 0
        self._reducer: SignalReducer | None = None
        self._failure = ""

    def feed(self, record: AccelerationRecord) -> None:
        """Take the next piece; one that does not fit ends the reduction of this point only."""
        if self._failure:
            return
        self._waiting.append(record)
        if self._reducer is None and sum(len(one.time) for one in self._waiting) < LEAST_SAMPLES:
            return
        try:
            self._work_off()
        except InputError as error:
            self._failure = str(error)

    def finish(self) -> ReducedSignal | str:
        """Give the reduced signal, or why there is none."""
        try:
            if self._waiting and not self._failure:
                self._work_off()
            if self._reducer and not self._failure:
                return self._reducer.finish()
        except InputError as error:
            self._failure = str(error)
        return self._failure or "no sample"

    def _work_off(self) -> None:
        if self._reducer is None:
            self._begin()
        for record in self._waiting:
            self._reducer.feed(self._seconds(record), record.values)  # type: ignore[union-attr]
        self._waiting = []

    def _begin(self) -> None:
        self._origin_ns = self._waiting[0].start_ns
        rate = sampling_rate(np.concatenate([self._seconds(record) for record in self._waiting]))
        level_of = self._history.level_of(self._origin_ns) if self._history else None
        band = compared_band(rate, MODEL_RATE_HZ, self._settings)
        self._reducer = SignalReducer(rate, band, self._frame, self._settings, level_of)

    def _seconds(self, record: AccelerationRecord) -> np.ndarray:
        """Give the times of a piece after the point's first sample, s."""
        return (record.start_ns - self._origin_ns) * 1e-9 + record.time
