"""What can be read of a damaged recording, written anew: whole, in order of log time, with an index."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from tbm_msgs_py.bags.bag import Bag
from tbm_msgs_py.bags.batch import Topic
from tbm_msgs_py.bags.definitions import recorded_definition
from tbm_msgs_py.bags.metadata import SYNTHETIC, is_synthetic
from tbm_msgs_py.bags.qos import offered_qos
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.texts import listed, quoted
from tbm_msgs_py.topics import QoS


@dataclass(frozen=True)
class Recovery:
    """What became of a recording.

    Attributes
    ----------
    recovered, lost : int
        Messages written; messages known to have been there that are not.
    damaged : int
        Places that were no part of a recording; `lost` is a lower bound when there are any.
    truncated : bool
        A file ended before its recording.
    left_out : dict
        Messages, by topic, that are not CDR and have no place in a recording of ROS 2; they count as lost.
    encodings : dict
        What those are encoded in, by topic.
    notes : tuple of str
        What was found in the recording that the counts do not explain.
    """

    recovered: int
    lost: int
    damaged: int
    truncated: bool
    left_out: dict[str, int]
    encodings: dict[str, str]
    notes: tuple[str, ...]


def recover(path: str | Path, out: str | Path) -> Recovery:
    """Write a clean recording from what can be read of a damaged one.

    Parameters
    ----------
    path : str or Path
        rosbag2 folder or bare MCAP file.
    out : str or Path
        New rosbag2 folder, or a new bare file when it ends in ``.mcap``.

    Raises
    ------
    RecordingError
        No message can be read, or `out` cannot be written; nothing is left of it then.
    """
    bag = Bag(path)
    left_out: Counter[str] = Counter()
    encodings: dict[str, str] = {}
    described: dict[Topic, tuple[QoS | None, tuple[str, str] | None]] = {}
    recovered = 0
    with BagWriter(out, custom_data=SYNTHETIC if is_synthetic(bag.path) else None) as writer:
        # What waits for its turn and does not fit into memory is put where the result will be: there is room for that.
        for topic, log_ns, data in bag.messages(scan=True, folder=writer.path.parent):
            if topic.encoding != "cdr":
                left_out[topic.name] += 1
                encodings[topic.name] = topic.encoding
                continue
            if topic not in described:
                described[topic] = offered_qos(topic.qos), recorded_definition(topic)
            qos, definition = described[topic]
            writer.write(topic.name, topic.type, log_ns, data, qos=qos, definition=definition)
            recovered += 1
        if not recovered:
            if encodings:
                others = listed(f"{name} in {quoted(encoding)}" for name, encoding in encodings.items())
                raise RecordingError(f"{bag.path}: topics {others}, allowed: message encoding cdr")
            raise bag.nothing_read()
    return Recovery(
        recovered,
        bag.lost + left_out.total(),
        bag.damaged,
        bag.truncated,
        dict(left_out),
        encodings,
        tuple(bag.notes),
    )
