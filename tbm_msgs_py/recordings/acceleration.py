"""The acceleration of one test point, or a piece of it: what reading a recording returns."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.recordings.faults import Clock, FaultCounts, find_gaps, stuck_axes
from tbm_msgs_py.recordings.mapping import SensorMapping
from tbm_msgs_py.recordings.timeline import DecodedStream


@dataclass(frozen=True)
class AccelerationRecord:
    """Acceleration of one test point, or a piece of it. What the faults mean is in docs/recordings.md.

    Attributes
    ----------
    topic, point : str
        Where it comes from.
    start_ns : int
        Header time of the first sample, ns since the epoch.
    time : ndarray (n,)
        Header time after `start_ns`, s, strictly increasing.
    values : ndarray (n, 3)
        Machine axes x, y, z, m/s².
    gaps : list of (float, float)
        Times of the last sample before and the first after each hole, s; in a piece the first hole may begin before
        `start_ns`, at a negative time.
    rate_hz : float
        Mean sample rate outside the gaps; 0 for fewer than two samples.
    clipped : int
        Samples at the stated range.
    gravity, frame : str
        As the mapping states: ``included`` or ``removed``, ``fixed`` or ``rotating``.
    stuck : tuple of (str, float, float)
        Sensor axis and times, s, of each interval in which it holds one value.
    faults : FaultCounts
        What was dropped or put right.
    clock : Clock
        Header stamps against log times.
    """

    topic: str
    point: str
    start_ns: int
    time: Array
    values: Array
    gaps: list[tuple[float, float]]
    rate_hz: float
    clipped: int = 0
    gravity: str = "removed"
    frame: str = "fixed"
    stuck: tuple[tuple[str, float, float], ...] = ()
    faults: FaultCounts = field(default_factory=FaultCounts)
    clock: Clock = field(default_factory=Clock)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.time[-1])


def acceleration_record(topic: str, sensor: SensorMapping, stream: DecodedStream) -> AccelerationRecord:
    """Turn samples of a sensor into machine axes and m/s², and find what is wrong with them."""
    start, values = int(stream.times_ns[0]), stream.values
    time = np.asarray((stream.times_ns - start) * 1e-9, np.float64)
    gaps, rate = find_gaps(time, None if stream.before_ns is None else (stream.before_ns - start) * 1e-9)
    clipped = 0
    if sensor.range is not None:
        clipped = int(np.count_nonzero((np.abs(values) >= sensor.range * (1 - 1e-6)).any(axis=1)))
    used = {axis[-1] for axis in sensor.axes if axis is not None}  # what is not measured may well hold one value
    held = (("xyz"[axis], first, last) for axis, first, last in stuck_axes(time, values, rate))
    return AccelerationRecord(
        topic=topic,
        point=sensor.point,
        start_ns=start,
        time=time,
        values=values @ sensor.matrix().T,
        gaps=gaps,
        rate_hz=rate,
        clipped=clipped,
        gravity=sensor.gravity,
        frame=sensor.frame,
        stuck=tuple(one for one in held if one[0] in used),
        faults=stream.faults,
        clock=stream.clock,
    )
