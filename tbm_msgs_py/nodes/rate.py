"""How many samples pass in a second of wall time."""

from __future__ import annotations

import time


class Rate:
    """Counts samples."""

    def __init__(self) -> None:
        self._count, self._since = 0, time.monotonic()

    def add(self, samples: int) -> None:
        """Count samples."""
        self._count += samples

    def mean(self) -> float:
        """Return the samples per second of wall time since the last call."""
        now = time.monotonic()
        rate = self._count / max(now - self._since, 1e-9)
        self._count, self._since = 0, now
        return rate
