"""In which order the messages of a recording are read whose log times go back from one chunk or file to the next."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np

from tbm_msgs_py.bags.batch import MessageBatch
from tbm_msgs_py.base.arrays import Integers
from tbm_msgs_py.recordings.decoding import decode_samples
from tbm_msgs_py.recordings.timeline import LATENESS_NS


def follows_log(batches: Iterable[MessageBatch], topics: Collection[tuple[str, str]]) -> bool:
    """Whether header stamps are in better order by log time than as they were written.

    They are where chunks or files stand in another order than they were recorded in; they are not where the clock of
    the recorder was set back. The first message of each chunk is looked at.

    Parameters
    ----------
    batches : iterable of MessageBatch
        The recording in file order.
    topics : collection of (str, str)
        Names and types of the topics that matter.
    """
    found: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for chunk in (chunk for batch in batches for chunk in batch.chunks() if len(chunk)):
        for topic, messages in chunk.by_topic():
            if (key := (topic.name, topic.type)) in topics:
                first = MessageBatch(messages.data, messages.messages[:, :1], messages.topics, (1,))
                decoded = decode_samples(topic.type, first)
                found.setdefault(key, []).extend(zip(decoded.log_ns.tolist(), decoded.stamps_ns.tolist(), strict=True))
    as_written = sum(_late(np.array([stamp for _, stamp in pairs], np.int64)) for pairs in found.values())
    by_log = sum(_late(np.array([stamp for _, stamp in sorted(pairs)], np.int64)) for pairs in found.values())
    return by_log < as_written


def _late(stamps: Integers) -> int:
    """Stamps that are behind an earlier one by more than a piece waits for."""
    return int(np.count_nonzero(stamps < np.maximum.accumulate(stamps) - LATENESS_NS))
