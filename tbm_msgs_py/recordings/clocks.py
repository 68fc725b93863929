"""One check of clocks for every topic: whether header stamps fit those of the sensors, by the log times of both."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tbm_msgs_py.base.arrays import Array, Flags, Integers
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.recordings.faults import CLOCK_JUMP_NS

_END = 9  # messages whose median stands for one end of a batch: some may be astray


class ClockTrack:
    """Header stamps of a topic against their log times, two points for every batch of messages."""

    def __init__(self) -> None:
        self._points: list[tuple[float, float]] = []  # log time and stamp, ns

    def __bool__(self) -> bool:
        return bool(self._points)

    def add(self, stamps_ns: Integers, log_ns: Integers) -> None:
        """Add messages (m,) in file order."""
        for part in (slice(None, _END), slice(-_END, None)) if len(stamps_ns) else ():
            self._points.append((float(np.median(log_ns[part])), float(np.median(stamps_ns[part]))))

    @property
    def offset_ns(self) -> float:
        """Median of stamp minus log time."""
        log, stamps = self._columns()
        return float(np.median(stamps - log)) if len(log) else 0.0

    @property
    def spans_ns(self) -> tuple[float, float]:
        """Time that the log times span, and the one that the stamps do."""
        log, stamps = self._columns()
        return (float(np.ptp(log)), float(np.ptp(stamps))) if len(log) else (0.0, 0.0)

    @property
    def dated(self) -> bool:
        """Whether the log times say when a message came; in some files they are all the same."""
        log, stamps = self._columns()
        return not len(log) or bool(np.ptp(log) > CLOCK_JUMP_NS or np.ptp(stamps) <= CLOCK_JUMP_NS)

    def stamps_at(self, log_ns: Integers) -> Integers:
        """Stamps that messages logged at these times would have by this clock."""
        log, stamps = self._columns()
        order = np.argsort(log, kind="stable")
        offsets: Array = np.interp(log_ns.astype(np.float64), log[order], (stamps - log)[order])
        return log_ns + np.rint(offsets).astype(np.int64)

    def fits(self, stamps_ns: Integers, log_ns: Integers) -> Flags:
        """Which messages (m,) have a stamp of this clock, within `CLOCK_JUMP_NS`."""
        if self.dated:
            away = np.abs(stamps_ns - self.stamps_at(log_ns))
        else:
            _, stamps = self._columns()
            away = np.maximum(stamps.min() - stamps_ns, stamps_ns - stamps.max())
        return np.asarray(away <= CLOCK_JUMP_NS, np.bool_)

    def _columns(self) -> tuple[Array, Array]:
        columns = np.array(self._points, np.float64).reshape(-1, 2)
        return columns[:, 0], columns[:, 1]


def reference_clock(tracks: Mapping[str, ClockTrack]) -> str | None:
    """Test point whose clock is nearest to the log times; None where none has a message."""
    return min(
        (point for point, track in tracks.items() if track), key=lambda p: abs(tracks[p].offset_ns), default=None
    )


def clock_shifts(tracks: Mapping[str, ClockTrack]) -> dict[str, int]:
    """How far each clock is ahead of the reference, ns; 0 of those that agree with it within `CLOCK_JUMP_NS`."""
    reference = reference_clock(tracks)
    if reference is None:
        return {}
    own = tracks[reference].offset_ns
    ahead = {point: round(track.offset_ns - own) if track else 0 for point, track in tracks.items()}
    return {point: shift if abs(shift) > CLOCK_JUMP_NS else 0 for point, shift in ahead.items()}


def clock_doubts(tracks: Mapping[str, ClockTrack]) -> list[str]:
    """Say which test points are placed by their log times, and whose clocks run at another speed, one line each."""
    reference = reference_clock(tracks)
    spans = ((point, *track.spans_ns) for point, track in tracks.items() if track.dated)
    return [
        f"test point {point}: its header stamps span {stamps / NANOSECONDS:.3f} s, its log times "
        f"{log / NANOSECONDS:.3f} s: one of the two clocks is wrong"
        for point, log, stamps in spans
        if abs(stamps - log) > max(CLOCK_JUMP_NS, min(stamps, log))
    ] + [
        f"test point {point}: its clock is {abs(shift) / NANOSECONDS:.3f} s {'ahead of' if shift > 0 else 'behind'} "
        f"that of {reference}: placed beside it by the log times"
        for point, shift in clock_shifts(tracks).items()
        if shift
    ]
