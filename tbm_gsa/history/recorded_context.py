"""The context that a recording holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from tbm_gsa.history.context import ContextLog, read_context
from tbm_msgs_py import topics
from tbm_msgs_py.bags.bag import Bag
from tbm_msgs_py.bags.definitions import UNDECODABLE, other_encoding
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.blocks import stamp_to_ns
from tbm_msgs_py.recordings.channels import ChosenChannel

_NAME: Final = topics.absolute(topics.CONTEXT)
_TYPE: Final = topics.contract(topics.CONTEXT).type


def recorded_contexts(path: Path) -> tuple[ContextLog, str]:
    """Contexts of a recording, and what of them is not used, in a line.

    They hold from their header stamps on, or from their log times where these are 0 or of another clock.
    """
    bag, found = Bag(path), ContextLog()
    there = {topic: count for topic, count in bag.info().topics.items() if topic.name == _NAME}
    if not there:
        return found, ""
    problems: list[str] = []
    try:
        channel = ChosenChannel(_NAME, there, (_TYPE,))
        for message in bag.messages({_NAME}):
            if not channel.takes(message.topic, 1):
                continue
            try:
                if other := other_encoding(message.data):
                    raise ValueError(other)
                said: Any = channel.used.store.deserialize_cdr(message.data, _TYPE)
                context = read_context((pair.key, pair.value) for status in said.status for pair in status.values)
                doubt = found.add(stamp_to_ns(said.header.stamp), context, message.log_ns)
                problems += [doubt] if doubt else []
            except (InputError, *UNDECODABLE, AttributeError, TypeError) as error:
                problems.append(str(error) or type(error).__name__)
    except InputError as error:  # no channel that can be decoded
        problems.append(str(error))
    more = f", and {len(problems) - 1} more" if len(problems) > 1 else ""
    return found, f"context: {problems[0]}{more}" if problems else ""
