"""Topics of the channels of one MCAP file, by its schema and channel records."""

from __future__ import annotations

import struct
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from tbm_msgs_py.bags.batch import Topic

DAMAGED = (struct.error, McapError, ValueError, OverflowError)  # what the library raises at a record that is damaged


class ChannelTable:
    """Topics by channel; the first description of a channel counts.

    Attributes
    ----------
    topics : dict
        Topic of each channel that is described with its schema.
    unfinished : dict
        Topics of channels whose schema has not come; their type is not known.
    """

    def __init__(self) -> None:
        self.topics: dict[int, Topic] = {}
        self.unfinished: dict[int, Topic] = {}
        self._schemas: dict[int, Schema] = {}
        self._waiting: dict[int, list[Channel]] = {}  # by the schema that has not come

    def add(self, opcode: int, body: bytes) -> str:
        """Add a schema or a channel; what is wrong with it, empty when nothing is.

        Raises
        ------
        struct.error, McapError, ValueError, OverflowError
            The record is damaged.
        """
        stream = ReadDataStream(BytesIO(body))
        if opcode == Opcode.SCHEMA:
            return self._add_schema(Schema.read(stream))
        if opcode == Opcode.CHANNEL:
            return self._add_channel(Channel.read(stream))
        return ""

    def _add_schema(self, schema: Schema) -> str:
        if schema.id == 0:  # not valid, to be ignored
            return ""
        before = self._schemas.get(schema.id)
        self._schemas[schema.id] = schema
        for channel in self._waiting.pop(schema.id, ()):
            self._add_channel(channel)
        if before is None or before == schema:
            return ""
        return f"schema {schema.id} is {before.name} and again {schema.name} with another text"

    def _add_channel(self, channel: Channel) -> str:
        schema = self._schemas.get(channel.schema_id)
        topic = Topic(
            channel.topic,
            schema.name if schema else "",
            channel.message_encoding,
            channel.metadata.get("offered_qos_profiles", ""),
            schema.data.decode("utf-8", "replace") if schema else "",
            channel.metadata.get("topic_type_hash", ""),
            schema.encoding if schema else "",
        )
        if schema is None and channel.schema_id:
            self.unfinished.setdefault(channel.id, topic)
            self._waiting.setdefault(channel.schema_id, []).append(channel)
            return ""
        before = self.topics.setdefault(channel.id, topic)
        if (before.name, before.type, before.encoding) == (topic.name, topic.type, topic.encoding):
            return ""
        return (
            f"channel {channel.id} is {before.name} ({before.type}, {before.encoding}) and again "
            f"{topic.name} ({topic.type}, {topic.encoding}); its messages count as the first"
        )
