"""Which blocks a stream consists of, when some are lost and others come from somebody else."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Generic, NamedTuple, TypeVar

# What does not continue the stream is believed when it goes on for so long, and the stream does not.
BELIEVED_NS = 150_000_000
MOST_RUNS = 16  # that wait, of as many publishers

Content = TypeVar("Content")


class Piece(NamedTuple, Generic[Content]):
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
    clock, or be somebody else's. When some that wait have followed each other for long enough (two blocks or more) and
    none continued the stream meanwhile, the stream goes on with those that begin nearest to where it had got: after a
    loss these are its own. As soon as a block does continue the stream, those that wait are dropped. So a second
    publisher, behind or ahead, changes nothing, and neither does a stray stamp.

    Parameters
    ----------
    longest_ns : int
        The longest gap; what begins later, or behind the end of the stream, jumps.
    jump_ns : int
        How long a jump has to go on.

    Attributes
    ----------
    dropped, dropped_samples : int
        Blocks that turned out not to belong to the stream, and the samples in them.
    """

    def __init__(self, longest_ns: int, jump_ns: int = BELIEVED_NS) -> None:
        self._longest, self._jump = longest_ns, jump_ns
        self._runs: list[list[Piece[Content]]] = []  # that wait; the one that grew last comes last
        self.dropped = self.dropped_samples = 0

    def take(self, piece: Piece[Content], end_ns: int | None) -> list[Piece[Content]]:
        """Blocks to go on with, in order, now that one has come.

        Parameters
        ----------
        piece : Piece
        end_ns : int or None
            Where the stream has got to; None where any block may begin it.
        """
        if end_ns is None or abs(piece.begin_ns - end_ns) < piece.slack_ns:
            self._drop(self._runs)
            return [piece]
        run = self._wait(piece, end_ns)
        length, enough = piece.end_ns - run[0].begin_ns, self._enough(run, end_ns)
        if len(run) < 2 or length < enough:
            return []
        # A single block may be the stream's own after a loss: the next one tells, if it comes soon.
        able = [other for other in self._runs if len(other) > 1 or length < 2 * enough]
        nearest = min(able, key=lambda run: abs(run[0].begin_ns - end_ns))
        if len(nearest) < 2:
            return []
        self._drop(run for run in self._runs if run is not nearest)
        return nearest

    def _enough(self, run: list[Piece[Content]], end_ns: int) -> int:
        """Length of time for which blocks have to follow each other to be believed."""
        return min(BELIEVED_NS, self._jump) if 0 <= run[0].begin_ns - end_ns <= self._longest else self._jump

    def _wait(self, piece: Piece[Content], end_ns: int) -> list[Piece[Content]]:
        """Add a block to those that it follows, unless it is nearer to the stream itself."""
        nearest = min(self._runs, key=lambda run: abs(piece.begin_ns - run[-1].end_ns), default=[])
        run = nearest if nearest and self._follows(piece, nearest[-1], end_ns) else []
        others = [other for other in self._runs if other is not run]
        run.append(piece)
        self._drop(others[: 1 - MOST_RUNS])
        self._runs = [*others[1 - MOST_RUNS :], run]
        return run

    def _follows(self, piece: Piece[Content], before: Piece[Content], end_ns: int) -> bool:
        gap = piece.begin_ns - before.end_ns
        within = -piece.slack_ns < gap <= self._longest and piece.end_ns > before.end_ns
        return within and abs(gap) < abs(piece.begin_ns - end_ns)

    def _drop(self, runs: Iterable[list[Piece[Content]]]) -> None:
        pieces = [piece for run in runs for piece in run]
        self.dropped += len(pieces)
        self.dropped_samples += sum(piece.samples for piece in pieces)
        self._runs = []
