"""Whether a node keeps up with a stream of blocks."""

from __future__ import annotations

import time

_SILENCE_S = 2.0  # wall time without a block that is a fault, beside three times the block's length


class RealTimePacer:
    """Work and age of the blocks since the last call of `figures`.

    Attributes
    ----------
    blocks : int
        Since the node was configured.
    """

    def __init__(self) -> None:
        self.blocks = 0
        self._length = 0.0
        self._came = time.monotonic()
        self._figures = {"real_time_factor": 0.0, "block_work_ms": 0.0, "block_age_ms": 0.0}
        self._fresh()

    def _fresh(self) -> None:
        self._count, self._stream, self._busy, self._age = 0, 0.0, 0.0, 0.0

    def add(self, length: float, busy: float, age: float) -> None:
        """Count a block: its length, the work it took, and how long after its end it was done with, all in s."""
        self.blocks += 1
        self._count += 1
        self._length, self._came = length, time.monotonic()
        self._stream += length
        self._busy += busy
        self._age = max(self._age, age)

    def silent(self) -> float:
        """Seconds since the last block, if that is too long; else 0."""
        waited = time.monotonic() - self._came
        return waited if waited > max(_SILENCE_S, 3.0 * self._length) else 0.0

    def figures(self) -> dict[str, float]:
        """Real-time factor, mean work and largest age of the blocks since the last call; the last ones without any."""
        if self._count:
            self._figures = {
                "real_time_factor": self._stream / self._busy,
                "block_work_ms": 1e3 * self._busy / self._count,
                "block_age_ms": 1e3 * self._age,
            }
            self._fresh()
        return self._figures
