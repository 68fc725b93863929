"""From the messages of one topic to samples, whatever their type."""

from __future__ import annotations

from tbm_msgs_py.bags.batch import Stretch
from tbm_msgs_py.bags.samples import BLOCK_TYPE, Samples
from tbm_msgs_py.recordings.clouds import decode_blocks
from tbm_msgs_py.recordings.vectors import VECTOR_OFFSETS, decode_vectors

ACCELERATION_TYPES = (*VECTOR_OFFSETS, BLOCK_TYPE)


def decode_samples(message_type: str, messages: Stretch) -> Samples:
    """Decode the messages of topics of one of `ACCELERATION_TYPES`."""
    _, log_ns, at, sizes = messages.messages
    if message_type == BLOCK_TYPE:
        return decode_blocks(messages.data, log_ns, at, sizes)
    return decode_vectors(message_type, messages.data, log_ns, at, sizes)
