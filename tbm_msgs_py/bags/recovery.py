"""What can be read of a damaged recording, written anew: whole, in order of log time, with an index."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.typesys import get_types_from_idl, get_types_from_msg
from rosbags.typesys.store import Typestore

from tbm_msgs_py.bags.bag import Bag
from tbm_msgs_py.bags.batch import Topic
from tbm_msgs_py.bags.marks import SYNTHETIC, is_synthetic
from tbm_msgs_py.bags.qos import offered_quality
from tbm_msgs_py.bags.samples import typestore
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.base.errors import RecordingError

UNKNOWN_HASH = "RIHS01_" + 64 * "0"  # of a definition that the library cannot parse
_IDL = "=" * 80 + "\nIDL: "  # how a definition in IDL begins


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
    """

    recovered: int
    lost: int
    damaged: int
    truncated: bool
    left_out: dict[str, int]


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
    described: dict[Topic, dict[str, Any]] = {}
    recovered = 0
    with BagWriter(out, custom_data=SYNTHETIC if is_synthetic(bag.path) else None) as writer:
        for topic, log_ns, data in bag.messages():
            if topic.encoding != "cdr":
                left_out[topic.name] += 1
                continue
            if topic not in described:
                described[topic] = {"quality": offered_quality(topic.qos), "definition": _definition(topic)}
            writer.write(topic.name, topic.type, log_ns, data, **described[topic])
            recovered += 1
        if not recovered:
            raise RecordingError(f"{bag.path}: no message could be read, allowed: at least one to recover")
    return Recovery(recovered, bag.lost + left_out.total(), bag.damaged, bag.truncated, dict(left_out))


def _definition(topic: Topic) -> tuple[str, str] | None:
    """Definition and hash as they were recorded; None for those of the library."""
    if topic.type in typestore().types:
        known, _ = typestore().generate_msgdef(topic.type, ros_version=2)
        if topic.definition in ("", known):
            return None
    return topic.definition, topic.type_hash or _hash(topic)


def _hash(topic: Topic) -> str:
    store = Typestore()
    try:
        if topic.definition.startswith(_IDL):
            store.register(get_types_from_idl(topic.definition))
        else:
            store.register(get_types_from_msg(topic.definition, topic.type))
        return str(store.hash_rihs01(topic.type))
    except Exception:  # noqa: BLE001  the parser and the hash fail in many ways at a definition that is damaged
        return UNKNOWN_HASH
