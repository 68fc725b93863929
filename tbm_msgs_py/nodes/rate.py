"""How many samples pass in a second of wall time."""

from __future__ import annotations

import time


class Rate:
    """Counts samples; a look gives their rate since the look before."""

    def __init__(self) -> None:
        self._count, self._since = 0, time.monotonic()

    def count(self, samples: int) -> None:
        """Take note of samples."""
        self._count += samples

    def look(self) -> float:
        """Give the samples per second of wall time since the last look."""
        now = time.monotonic()
        rate = self._count / max(now - self._since, 1e-9)
        self._count, self._since = 0, now
        return rate
