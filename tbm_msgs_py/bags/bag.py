"""A recording on disk: a rosbag2 folder or a bare `.mcap`, its topics, and its messages in log-time order."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from tbm_msgs_py.bags.batch import MessageBatch, RawMessage, Topic
from tbm_msgs_py.bags.chunks import UnpackingBudget, UnpackingError
from tbm_msgs_py.bags.folder import find_files
from tbm_msgs_py.bags.mcap_file import McapFile
from tbm_msgs_py.base.errors import RecordingError


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
    """

    topics: dict[Topic, int]
    start_ns: int
    end_ns: int
    messages: int
    lost: int
    truncated: bool
    damaged: int = 0

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
        return sum(file.damaged for file in self.files) + bool(self.problem)

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

    def batches(self) -> Iterator[MessageBatch]:
        """All messages in file order, as arrays."""
        problem: RecordingError | None = None
        self._read_through = False
        for file in self.files:
            file.restart()  # one that is not reached holds nothing of the reading before
        budget = UnpackingBudget()
        for file in self.files:
            try:
                yield from file.batches(budget)
            except UnpackingError:
                raise
            except RecordingError as error:  # one of several files is none
                problem, file.damaged = error, 1
        self._read_through = True
        if problem is not None and not any(file.messages for file in self.files):
            raise problem

    def messages(self, topics: Collection[str] | None = None, start_ns: int = 0) -> Iterator[RawMessage]:
        """Messages in log-time order, lazily.

        Parameters
        ----------
        topics : collection of str, optional
            Topic names; default all.
        start_ns : int
            Log time of the first message wanted.
        """
        held: list[RawMessage] = []
        for chunk in (chunk for batch in self.batches() for chunk in batch.chunks() if len(chunk)):
            # Neighbouring chunks may overlap in time: one chunk is held back and merged with the next.
            first = int(chunk.messages[1].min())
            held.sort(key=lambda message: message.log_ns)
            yield from (message for message in held if message.log_ns < first)
            held = [message for message in held if message.log_ns >= first]
            held += [m for m in chunk.raw() if m.log_ns >= start_ns and (topics is None or m.topic.name in topics)]
        yield from sorted(held, key=lambda message: message.log_ns)

    def info(self, *, scan: bool = False) -> BagInfo:
        """Topics, counts and times: from the index when the recording is whole, else by reading it through.

        Parameters
        ----------
        scan : bool
            Read it through in any case: damage in the middle does not show in the index.
        """
        summaries = [None if scan else file.summary() for file in self.files]
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
            damaged=bool(self.problem),
        )

    def _scan(self) -> BagInfo:
        topics: Counter[Topic] = Counter()
        start, end = 2**63, 0
        for batch in self.batches():
            topics.update(batch.counts())
            if len(batch):
                start, end = min(start, int(batch.messages[1].min())), max(end, int(batch.messages[1].max()))
        count = sum(topics.values())
        return BagInfo(dict(topics), start if count else 0, end, count, self.lost, self.truncated, self.damaged)
