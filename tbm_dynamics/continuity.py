"""Which blocks a stream consists of, when some are lost and others come from somebody else."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

NANOSECONDS = 1_000_000_000
# What does not continue the stream is believed when it goes on for so long, and the stream does not.
BELIEVED_S = 0.15


class Samples(NamedTuple):
    """Consecutive samples (n, c) of which the first belongs to a stamp (ns)."""

    stamp_ns: int
    values: np.ndarray


class Continuity:
    """Admits blocks to a stream.

    A block that continues the stream is admitted at once. Any other one waits: it may follow a loss, or a jump of the
    clock, or be somebody else's. When those that wait follow each other for `BELIEVED_S` (two blocks or more) and none
    continues the stream meanwhile, the stream goes on with them; as soon as one does, they are dropped. So a second
    publisher, behind or ahead, changes nothing, and neither does a stray stamp.

    Parameters
    ----------
    step_ns : int
        Between two samples.
    longest_ns : int
        The longest gap within what waits.

    Attributes
    ----------
    dropped : int
        Blocks that turned out not to belong to the stream.
    """

    def __init__(self, step_ns: int, longest_ns: int) -> None:
        self._step = step_ns
        self._longest = longest_ns
        self._waiting: list[Samples] = []
        self.dropped = 0

    def take(self, block: Samples, end_ns: int | None) -> list[Samples]:
        """Blocks to go on with, in order, now that `block` has come.

        Parameters
        ----------
        block : Samples
        end_ns : int or None
            Where the stream has got to; None where any block may begin it.
        """
        if end_ns is None or 2 * abs(block.stamp_ns - end_ns) < self._step:
            self._forget()
            return [block]
        if self._waiting and not -self._step < 2 * (block.stamp_ns - self._end(self._waiting[-1])) <= 2 * self._longest:
            self._forget()
        self._waiting.append(block)
        if len(self._waiting) < 2 or self._end(block) - self._waiting[0].stamp_ns < BELIEVED_S * NANOSECONDS:
            return []
        believed, self._waiting = self._waiting, []
        return believed

    def _end(self, block: Samples) -> int:
        return block.stamp_ns + len(block.values) * self._step

    def _forget(self) -> None:
        self.dropped += len(self._waiting)
        self._waiting = []
