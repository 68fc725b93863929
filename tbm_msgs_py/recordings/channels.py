"""Which messages of a topic name go together: those of one type, one definition and one frame; the rest is named."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from rosbags.typesys.store import Typestore

from tbm_msgs_py.bags.batch import Topic
from tbm_msgs_py.bags.definitions import definition_hash, recorded_types
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.texts import LONGEST_NAME, shortened

_MOST = 20  # kinds of messages that are left out and get a line of their own, by topic
_OTHERS = "others"


@dataclass(frozen=True)
class LeftOut:
    """Messages of a topic that are not used.

    Attributes
    ----------
    topic : str
        Name.
    what : str
        What they have in common, such as their type.
    messages : int
        How many.
    reason : str
        Why, and what is used instead.
    """

    topic: str
    what: str
    messages: int
    reason: str

    def __str__(self) -> str:
        return f"topic {self.topic}: {self.messages} messages left out, {self.what}: {self.reason}"


class Channel(NamedTuple):
    """Messages that agree: their type, the hash of its definition, and the definitions to decode them by."""

    type: str
    hash: str
    store: Typestore

    def __str__(self) -> str:
        return f"{self.type}, definition {self.hash.removeprefix('RIHS01_')[:8]}"


class ChosenChannel:
    """The messages of one topic name that are used, and the count of the others.

    Parameters
    ----------
    name : str
        Of the topic.
    channels : mapping of Topic to int
        Every channel of that name, and its messages.
    allowed : collection of str
        Types that can be used.

    Attributes
    ----------
    used : Channel
        That with the most messages.

    Raises
    ------
    RecordingError
        No channel can be decoded: why not.
    """

    def __init__(self, name: str, channels: Mapping[Topic, int], allowed: Collection[str]) -> None:
        self._name, self._allowed = name, allowed
        self._left_out: Counter[tuple[str, str]] = Counter()
        self._known: dict[Topic, Channel | str] = {}
        counts: Counter[Channel] = Counter()
        for topic, count in channels.items():
            found = self._channel(topic)
            if isinstance(found, Channel):
                counts[found] += count
        if not counts:
            reasons = dict.fromkeys(str(self._channel(topic)) for topic in channels)
            raise RecordingError(f"topic {name}: {'; '.join(reasons)}")
        self.used = max(counts, key=counts.__getitem__)

    def takes(self, topic: Topic, messages: int) -> bool:
        """Whether messages of a channel are used; those of any other are counted."""
        found = self._channel(topic)
        if found == self.used:
            return True
        if isinstance(found, Channel):
            self.leave_out(str(found), f"{self.used} is used", messages)
        else:
            self.leave_out(topic.type or "no type", found, messages)
        return False

    def leave_out(self, what: str, reason: str, messages: int) -> None:
        """Count messages that are not used."""
        key = shortened(what, LONGEST_NAME), reason
        self._left_out[key if key in self._left_out or len(self._left_out) < _MOST else (_OTHERS, "as above")] += (
            messages
        )

    @property
    def left_out(self) -> list[LeftOut]:
        """What is not used, so far."""
        return [LeftOut(self._name, what, count, reason) for (what, reason), count in self._left_out.items()]

    def _channel(self, topic: Topic) -> Channel | str:
        """Type and definition of a channel, or why it cannot be used."""
        if topic not in self._known:
            try:
                if topic.type not in self._allowed:
                    raise RecordingError(f"type {topic.type or 'unknown'}, allowed: {', '.join(self._allowed)}")
                self._known[topic] = Channel(topic.type, definition_hash(topic), recorded_types(topic))
            except RecordingError as error:
                self._known[topic] = str(error)
        return self._known[topic]
