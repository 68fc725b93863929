"""Recordings that are no plain MCAP: files and messages that rosbag2 compressed with zstd, and SQLite storage.

A file is unpacked into a temporary MCAP file, so that there is one reader; a message where it is met.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing, suppress
from pathlib import Path
from tempfile import NamedTemporaryFile, TemporaryFile
from typing import IO, NamedTuple

import numpy as np
import zstandard
from mcap.writer import CompressionType, Writer

from tbm_msgs_py.bags.batch import MessageBatch
from tbm_msgs_py.bags.chunks import DENSEST, ChunkError, UnpackingBudget, UnpackingError, unzipped
from tbm_msgs_py.bags.definitions import typestore
from tbm_msgs_py.bags.records import LONGEST
from tbm_msgs_py.base.arrays import Bytes
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.texts import quoted

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
SQLITE_MAGIC = b"SQLite format 3\0"
_STEP = 1 << 20
_DATABASE = "a database that rosbag2 wrote"


class Unpacked(NamedTuple):
    """A temporary MCAP file, what was wrong with what it was made of, and what else is to be known of that."""

    file: IO[bytes]
    problem: str
    note: str = ""


def unpacked(path: Path, budget: UnpackingBudget) -> Unpacked | None:
    """MCAP file made of a compressed one or of a SQLite database, read as far as they go; None for any other."""
    with path.open("rb") as file:
        head = file.read(len(SQLITE_MAGIC))
    if head == SQLITE_MAGIC:
        return _of_database(path, path)
    if not head.startswith(ZSTD_MAGIC):
        return None
    with NamedTemporaryFile(prefix="tbm_monitor.") as plain:
        problem = _decompress(path, plain, budget)
        plain.seek(0)
        if plain.read(len(SQLITE_MAGIC)) == SQLITE_MAGIC:
            made = _of_database(Path(plain.name), path)
            return made._replace(problem=made.problem or problem)
        return Unpacked(os.fdopen(os.dup(plain.fileno()), "rb", buffering=0), problem)


def _decompress(path: Path, out: IO[bytes], budget: UnpackingBudget) -> str:
    with path.open("rb") as packed:
        reader, read = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True), 0
        try:
            while block := reader.read(_STEP):
                budget.spend(packed.tell() - read, len(block))
                read = packed.tell()
                out.write(block)
        except zstandard.ZstdError as error:
            out.flush()
            return f"zstd: {error} before its end"
        except UnpackingError as error:
            raise UnpackingError(f"{path}: {error}") from None
    out.flush()
    return ""


def _of_database(path: Path, name: Path) -> Unpacked:
    """MCAP file of the messages of a rosbag2 database, in order of time; errors call it by a name."""
    out, problem = TemporaryFile(prefix="tbm_monitor."), ""  # noqa: SIM115 - the reader's
    topics: dict[int, _StoredTopic] = {}
    writer = Writer(out, chunk_size=_STEP, compression=CompressionType.NONE)
    writer.start("ros2")
    room = DENSEST * path.stat().st_size  # a database that goes in circles has more
    with closing(_connected(path, name)) as database:
        try:
            topics = dict(_topics(database))
            channels = {number: _channel(writer, topic) for number, topic in topics.items()}
            for number, log_ns, data in database.execute(
                "SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id"
            ):
                room -= 1 + (len(data) if isinstance(data, bytes) else 0)
                if room < 0:
                    problem = "SQLite: more messages than the file can hold"
                    break
                if number in channels and isinstance(data, bytes) and isinstance(log_ns, int) and log_ns >= 0:
                    writer.add_message(channels[number], log_ns, data, log_ns)
                else:
                    problem = problem or "SQLite: a message of no topic or of no time"
        except (sqlite3.Error, OverflowError) as error:
            problem = f"SQLite: {error}"
    writer.finish()
    assumed = any(topic.assumed for topic in topics.values())
    return Unpacked(out, problem, "SQLite: no definitions, read as ROS 2 Jazzy defines the types" if assumed else "")


def _connected(path: Path, name: Path) -> sqlite3.Connection:
    """Database opened to read: with its log of a recorder that was killed, as it is where that cannot be opened."""
    error: sqlite3.Error | None = None
    for mode in ("mode=ro", "immutable=1"):
        database = sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", uri=True)
        try:
            database.execute("PRAGMA trusted_schema = OFF")
            # What is computed instead of stored may be without an end.
            views = database.execute(
                "SELECT name FROM sqlite_master WHERE name IN ('topics', 'messages', 'message_definitions') "
                "AND (type != 'table' OR sql LIKE 'CREATE VIRTUAL%')"
            ).fetchall()
        except sqlite3.Error as refused:
            database.close()
            error = refused
        else:
            if not views:
                return database
            database.close()
            raise RecordingError(f"{name}: SQLite: {quoted(views[0][0])} is no table, allowed: {_DATABASE}")
    raise RecordingError(f"{name}: SQLite: {error}, allowed: {_DATABASE}")


class _StoredTopic(NamedTuple):
    name: str
    type: str
    encoding: str
    qos: str
    type_hash: str
    definition_encoding: str
    definition: str
    assumed: bool
    """The definition is that of ROS 2 Jazzy, for the database has none."""


def _topics(database: sqlite3.Connection) -> Iterator[tuple[int, _StoredTopic]]:
    """Topics with their definitions; before ROS 2 Iron rosbag2 stored none, and a type is known by its name alone."""
    definitions: dict[str, tuple[str, str]] = {}
    stored = False
    with suppress(sqlite3.Error):
        for kind, encoding, text in database.execute(
            "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        ):
            definitions[str(kind)] = str(encoding), str(text)
            stored = True
    columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
    extra = [name if name in columns else f"'' AS {name}" for name in ("offered_qos_profiles", "type_description_hash")]
    rows = database.execute(f"SELECT id, name, type, serialization_format, {', '.join(extra)} FROM topics")  # noqa: S608
    for number, *texts in rows.fetchall():
        name, kind, encoding, qos, type_hash = map(str, texts)
        assumed = not stored and kind in typestore().types
        standard = ("ros2msg", typestore().generate_msgdef(kind, ros_version=2)[0] if assumed else "")
        yield number, _StoredTopic(name, kind, encoding, qos, type_hash, *definitions.get(kind, standard), assumed)


def _channel(writer: Writer, topic: _StoredTopic) -> int:
    schema = writer.register_schema(topic.type, topic.definition_encoding, topic.definition.encode())
    described = {"offered_qos_profiles": topic.qos, "topic_type_hash": topic.type_hash}
    return int(writer.register_channel(topic.name, topic.encoding, schema, described))


def with_unzipped(batch: MessageBatch, channels: Collection[int], budget: UnpackingBudget) -> MessageBatch:
    """Batch with the messages of some channels decompressed; without those that do not decompress."""
    messages = batch.messages.copy()
    parts, place, keep = [batch.data], len(batch.data), np.ones(len(batch), np.bool_)
    for k in np.flatnonzero(np.isin(messages[0], list(channels))).tolist():
        at, size = int(messages[2, k]), int(messages[3, k])
        try:
            data = unzipped_message(batch.data[at : at + size].tobytes(), budget)
        except (ChunkError, zstandard.ZstdError):
            keep[k] = False
            continue
        parts.append(data)
        messages[2:, k] = place, len(data)
        place += len(data)
    return MessageBatch(np.concatenate(parts), messages, batch.topics, batch.ends).where(keep)


def unzipped_message(stored: bytes, budget: UnpackingBudget) -> Bytes:
    """Decompress one message; a `ChunkError` or `ZstdError` when it is not whole."""
    size = zstandard.frame_content_size(stored)
    most = size if size >= 0 else DENSEST * len(stored)
    if most > LONGEST:
        raise ChunkError(f"{most} bytes, allowed: up to {LONGEST}")
    budget.spend(len(stored), most)
    data = unzipped(stored, most)
    if size >= 0 and len(data) != size:
        raise ChunkError(f"{len(data)} bytes, stated are {size}")
    return data
