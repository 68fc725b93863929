"""A recording on disk: a rosbag2 folder or a bare `.mcap`, its topics, and its messages in log-time order."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tbm_msgs_py.bags.batch import MessageBatch, RawMessage, Topic, rebatched
from tbm_msgs_py.bags.chunks import UnpackingBudget, UnpackingError
from tbm_msgs_py.bags.folder import find_files
from tbm_msgs_py.bags.mcap_file import McapFile
from tbm_msgs_py.bags.ordering import in_order
from tbm_msgs_py.bags.summary import ChunkPlace, Summary
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.texts import quoted

_OVERLAP_NS = 1_000_000_000  # by which chunks of a file that follows time may overlap
_NOTES = 20  # lines that a recording is worth
_Placed = tuple[int, ChunkPlace]  # a part and the number of its file


@dataclass(frozen=True)
class BagInfo:
    """What a recording holds.

    Attributes
    ----------
    topics : dict
        Message count of each topic.
    start_ns, end_ns : int
        First and last log time; both 0 when the recording is empty.
    messages, lost : int
        Messages that can be read, and messages known to be missing.
    truncated : bool
        A file ends before its recording does.
    damaged : int
        Places that are no part of a recording; `lost` is a lower bound when there are any.
    notes : tuple of str
        What was found that the counts do not explain, such as codecs that are not read; of many the beginning.
    """

    topics: dict[Topic, int]
    start_ns: int
    end_ns: int
    messages: int
    lost: int
    truncated: bool
    damaged: int = 0
    notes: tuple[str, ...] = ()

    @property
    def duration(self) -> float:
        """Seconds from the first to the last message."""
        return (self.end_ns - self.start_ns) * 1e-9


class Bag:
    """A recording on disk, opened for reading.

    Parameters
    ----------
    path : str or Path
        rosbag2 folder or bare MCAP file.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        found = find_files(self.path)
        self.files = [McapFile(file) for file in found.paths]
        self.problem = found.problem
        self._declared = found.declared
        self._read_through = False  # by the last reading
        self._parts: list[_Placed] | None = None  # of the last reading that was one through

    @property
    def lost(self) -> int:
        """Messages of the last reading that could not be read.

        A declared count that was not reached counts too, once the reading has come to the end.
        """
        known = sum(file.lost for file in self.files)
        if not self._read_through:
            return known
        return max(known, (self.declared or 0) - sum(file.messages for file in self.files))

    @property
    def damaged(self) -> int:
        """Places of the last reading that were no part of a recording; damaged metadata is one."""
        return sum(file.damaged for file in self.files) + int(bool(self.problem))

    @property
    def truncated(self) -> bool:
        """A file of the last reading ended before its recording."""
        return any(file.truncated for file in self.files)

    @property
    def declared(self) -> int | None:
        """Message count that the recording states about itself, if it does."""
        counts = [file.declared for file in self.files]
        return self._declared or (sum(c for c in counts if c is not None) if None not in counts else None)

    def sha256(self) -> str:
        """Digest of the MCAP files, in order."""
        digest = hashlib.sha256()
        for file in self.files:
            with file.path.open("rb") as stream:
                while block := stream.read(1 << 20):
                    digest.update(block)
        return digest.hexdigest()

    @property
    def notes(self) -> list[str]:
        """What the last reading found that the counts do not explain, metadata first; of many the beginning."""
        several = len(self.files) > 1
        found = [f"{file.path.name}: {note}" if several else note for file in self.files for note in file.notes]
        return [*([self.problem] if self.problem else []), *found][:_NOTES]

    def nothing_read(self) -> RecordingError:
        """Error that says why not a single message could be read, as far as that is known."""
        return RecordingError(
            f"{self.path}: no message could be read{''.join(f'; {note}' for note in self.notes[:1])}, "
            "allowed: a recording with at least one message"
        )

    def batches(self) -> Iterator[MessageBatch]:
        """All messages in file order, as arrays."""
        problem: RecordingError | None = None
        self._read_through, self._parts = False, None
        for file in self.files:
            file.restart()  # one that is not reached holds nothing of the reading before
        budget = UnpackingBudget()
        for file in self.files:
            try:
                yield from file.batches(budget)
            except UnpackingError:
                raise
            except RecordingError as error:  # one of several files is none
                problem = error
                file.damage(str(error))
        self._read_through = True
        self._parts = [(number, part) for number, file in enumerate(self.files) for part in file.parts]
        if problem is not None and not any(file.messages for file in self.files):
            raise problem

    def batches_in_order(self) -> Iterator[MessageBatch]:
        """All messages in log-time order, as arrays: more work than in file order."""
        yield from rebatched(self.messages(scan=True))

    def is_disordered(self) -> bool:
        """Whether log times go back in the order of the files, as far as an index or the last reading tells."""
        parts = self._parts if self._parts is not None else self._indexed()
        starts = np.array([part.start_ns for _, part in parts or () if part.end_ns], np.int64)
        return bool((starts < np.maximum.accumulate(starts) - _OVERLAP_NS).any())

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int = 0,
        *,
        scan: bool = False,
        folder: Path | None = None,
    ) -> Iterator[RawMessage]:
        """Messages in log-time order, lazily, whatever the layout of the files.

        Where the index names all chunks they are read as it says, those before the start not at all; else the
        recording is read through first. A message is out of order only where the index states a wrong time.

        Parameters
        ----------
        topics : collection of str, optional
            Topic names; default all.
        start_ns : int
            Log time of the first message wanted.
        scan : bool
            Read through first in any case, and believe no index.
        folder : Path, optional
            Where messages are put that wait and do not fit into memory; default the system's temporary folder.
        """
        indexed = None if scan else self._indexed()
        if indexed is not None:
            parts, readers = [placed for placed in indexed if placed[1].end_ns >= start_ns], self.files
        else:
            if self._parts is None:
                for _ in self.batches():
                    pass
            parts, readers = self._parts or [], [file.again() for file in self.files]
        budget = UnpackingBudget()

        def read(place: int) -> Iterator[RawMessage]:
            number, part = parts[place]
            for batch in readers[number].read_part(part, budget):
                keep = batch.messages[1] >= start_ns
                if topics is not None:
                    channels = [channel for channel, topic in batch.topics.items() if topic.name in topics]
                    keep &= np.isin(batch.messages[0], channels)
                yield from batch.where(keep).raw()

        yield from in_order([part.start_ns for _, part in parts], read, folder)
        if indexed is not None:
            self._read_through = len(parts) == len(indexed)

    def _indexed(self) -> list[_Placed] | None:
        """Parts by the indices of all files; None when one has none that names all of it."""
        self._read_through, self._parts = False, None
        try:
            found = [file.index() for file in self.files]
        except RecordingError:  # reading it through says which file is none
            return None
        if None in found:
            return None
        return [(number, part) for number, parts in enumerate(found) for part in parts or ()]

    def info(self, *, scan: bool = False) -> BagInfo:
        """Topics, counts and times: from the index when the recording is whole, else by reading it through.

        Parameters
        ----------
        scan : bool
            Read it through in any case: damage in the middle does not show in the index.
        """
        summaries = [None if scan else _summary(file) for file in self.files]
        if None in summaries:
            return self._scan()
        topics: Counter[Topic] = Counter()
        known = [summary for summary in summaries if summary is not None and summary.messages]
        for summary in known:
            topics.update(summary.topics)
        messages = sum(summary.messages for summary in known)
        return BagInfo(
            dict(topics),
            min((summary.start_ns for summary in known), default=0),
            max((summary.end_ns for summary in known), default=0),
            messages,
            max(0, (self._declared or 0) - messages),
            truncated=False,
            damaged=int(bool(self.problem)),
            notes=self._notes_on(topics),
        )

    def _scan(self) -> BagInfo:
        topics: Counter[Topic] = Counter()
        start, end = 2**63, 0
        for batch in self.batches():
            topics.update(batch.counts())
            if len(batch):
                start, end = min(start, int(batch.messages[1].min())), max(end, int(batch.messages[1].max()))
        count = sum(topics.values())
        return BagInfo(
            dict(topics),
            start if count else 0,
            end,
            count,
            self.lost,
            self.truncated,
            self.damaged,
            self._notes_on(topics),
        )

    def _notes_on(self, topics: Iterable[Topic]) -> tuple[str, ...]:
        """Collect the notes, those on topics that are nothing of ROS 2 included."""
        others = (
            f"topic {t.name}: message encoding {quoted(t.encoding)}, read is cdr" for t in topics if t.encoding != "cdr"
        )
        return (*self.notes, *others)[:_NOTES]


def _summary(file: McapFile) -> Summary | None:
    """Read what the end of a file states; None of one that is none, too, which reading it through tells."""
    try:
        return file.summary()
    except RecordingError:
        return None
