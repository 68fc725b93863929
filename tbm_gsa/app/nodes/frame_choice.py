"""Which frame of a topic is used while several arrive: two sensors are no sensor of twice the rate."""

from __future__ import annotations

import time
from collections.abc import Callable

from tbm_gsa.app.nodes.stream_health import SILENCE_S
from tbm_msgs_py.base.texts import listed

_MOST = 20  # frames of a topic that are remembered


class FrameChoice:
    """The frame of one topic that is used: that of the mapping, else the one that came first, until it is silent.

    Parameters
    ----------
    stated : str or None
        Frame that the mapping names.
    now : callable
        Seconds, monotonic.
    """

    def __init__(self, stated: str | None, now: Callable[[], float] = time.monotonic) -> None:
        self._stated, self._now = stated, now
        self._used: str | None = stated
        self._seen: dict[str, float] = {}

    def takes(self, frame: str) -> bool:
        """Whether a message with this ``frame_id``, which came now, is used."""
        if self._used is None or (frame != self._used and self._stated is None and self._silent(self._used)):
            self._used = frame
        if frame == self._used or frame in self._seen or len(self._seen) < _MOST:
            self._seen[frame] = self._now()
        return frame == self._used

    def problem(self) -> str:
        """Name the frames that are not used; empty where there are none now."""
        self._seen = {frame: last for frame, last in self._seen.items() if not self._silent(frame)}
        others = [repr(frame) for frame in self._seen if frame != self._used]
        if not others:
            return ""
        return f"frame_id {listed(others)} beside {self._used!r}, which alone is used: allowed: one sensor a topic"

    def _silent(self, frame: str) -> bool:
        return self._now() - self._seen.get(frame, -SILENCE_S) > SILENCE_S
