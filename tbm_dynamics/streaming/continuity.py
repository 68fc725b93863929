"""Which blocks a stream consists of, when some are lost and others come from another publisher."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Generic, NamedTuple, TypeVar

# Length of a sequence of blocks off the stream from which on it is the stream, if none continued it meanwhile.
CONFIRMED_NS = 150_000_000
MOST_SEQUENCES = 16  # that wait, of as many publishers

Content = TypeVar("Content")


class StreamBlock(NamedTuple, Generic[Content]):
    """A block of a stream.

    Attributes
    ----------
    begin_ns, end_ns : int
        From the first sample to where the next block is to begin.
    slack_ns : float
        By less than which it may begin earlier or later than the one before it ends.
    samples : int
    content
    """

    begin_ns: int
    end_ns: int
    slack_ns: float
    samples: int
    content: Content


class Continuity(Generic[Content]):
    """Admits blocks to a stream.

    A block that continues the stream is admitted at once. Any other one waits: it may follow a loss, or a jump of the
    clock, or be of another publisher. When a sequence of waiting blocks (two or more) is long enough and none continued
    the stream meanwhile, the stream goes on with the sequence that begins nearest to its end: after a loss that is its
    own. As soon as a block does continue the stream, all that wait are dropped. So a second publisher, behind or ahead,
    changes nothing, and neither does a stray stamp.

    Parameters
    ----------
    longest_ns : int
        The longest gap; a block that begins later, or before the end of the stream, jumps.
    jump_ns : int
        How long a sequence after a jump has to be.

    Attributes
    ----------
    dropped, dropped_samples : int
        Blocks that turned out not to belong to the stream, and the samples in them.
    """

    def __init__(self, longest_ns: int, jump_ns: int = CONFIRMED_NS) -> None:
        self._longest, self._jump = longest_ns, jump_ns
        self._waiting: list[list[StreamBlock[Content]]] = []  # sequences; the one that grew last comes last
        self.dropped = self.dropped_samples = 0

    def add(self, block: StreamBlock[Content], end_ns: int | None) -> list[StreamBlock[Content]]:
        """Add a block that has come; returns the blocks to go on with, in order.

        Parameters
        ----------
        block : StreamBlock
        end_ns : int or None
            End of the stream so far; None where any block may begin it.
        """
        if end_ns is None or abs(block.begin_ns - end_ns) < block.slack_ns:
            self._drop(self._waiting)
            return [block]
        sequence = self._wait(block, end_ns)
        length, enough = block.end_ns - sequence[0].begin_ns, self._enough(sequence, end_ns)
        if len(sequence) < 2 or length < enough:
            return []
        # A single block may be the stream's own after a loss: the next one decides, if it comes soon.
        able = [other for other in self._waiting if len(other) > 1 or length < 2 * enough]
        nearest = min(able, key=lambda sequence: abs(sequence[0].begin_ns - end_ns))
        if len(nearest) < 2:
            return []
        self._drop(other for other in self._waiting if other is not nearest)
        return nearest

    def _enough(self, sequence: list[StreamBlock[Content]], end_ns: int) -> int:
        """Length of time (ns) from which on a sequence continues the stream."""
        return min(CONFIRMED_NS, self._jump) if 0 <= sequence[0].begin_ns - end_ns <= self._longest else self._jump

    def _wait(self, block: StreamBlock[Content], end_ns: int) -> list[StreamBlock[Content]]:
        """Add a block to the sequence that it follows, unless it is nearer to the stream itself."""
        nearest = min(self._waiting, key=lambda sequence: abs(block.begin_ns - sequence[-1].end_ns), default=[])
        sequence = nearest if nearest and self._follows(block, nearest[-1], end_ns) else []
        others = [other for other in self._waiting if other is not sequence]
        sequence.append(block)
        self._drop(others[: 1 - MOST_SEQUENCES])
        self._waiting = [*others[1 - MOST_SEQUENCES :], sequence]
        return sequence

    def _follows(self, block: StreamBlock[Content], before: StreamBlock[Content], end_ns: int) -> bool:
        gap = block.begin_ns - before.end_ns
        within = -block.slack_ns < gap <= self._longest and block.end_ns > before.end_ns
        return within and abs(gap) < abs(block.begin_ns - end_ns)

    def _drop(self, sequences: Iterable[list[StreamBlock[Content]]]) -> None:
        blocks = [block for sequence in sequences for block in sequence]
        self.dropped += len(blocks)
        self.dropped_samples += sum(block.samples for block in blocks)
        self._waiting = []
