"""The records of one chunk: decompressed within bounds and checked."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import zstandard
from isal import isal_zlib  # zlib's checksum, five times as fast

from tbm_msgs_py.bags.records import LONGEST
from tbm_msgs_py.base.arrays import Bytes
from tbm_msgs_py.base.errors import InputError, RecordingError
from tbm_msgs_py.base.texts import quoted

_HEAD = struct.Struct("<QQQII")  # first and last log time, size of the records, their CRC, length of the name
_STEP = 1 << 20  # bytes that are decompressed at a time: no frame grows further than a chunk may


DENSEST = 256
"""Bytes that a byte of a chunk may stand for: the most that LZ4 can say, many times what any measurement comes to."""

SPARE = 1 << 30
"""Bytes that the chunks of one reading may unpack to beyond that, for silence and black pictures: seconds of work."""


class ChunkError(InputError):
    """A chunk that cannot be trusted, in one line."""


class UnpackingBudget:
    """What the chunks of one reading may still unpack to beyond `DENSEST` times what is stored.

    A few bytes can stand for a chunk of the largest size: without a limit, a small file of many takes minutes.
    """

    def __init__(self) -> None:
        self._left = SPARE

    def spend(self, stored: int, size: int) -> None:
        """Subtract a chunk before it is unpacked; an `UnpackingError` when nothing is left."""
        self._left -= max(0, size - DENSEST * stored)
        if self._left < 0:
            raise UnpackingError(
                f"unpacks to far more than it holds, allowed: chunks of up to {DENSEST} times what is stored, "
                f"and {SPARE >> 20} MiB beyond that"
            )


class UnpackingError(RecordingError):
    """A recording that unpacks to far more than it holds."""


class ChunkRecords(NamedTuple):
    """Records of a chunk: `data` from `first` to `end`; `whole` when all that it states are there.

    `problem` says what about the chunk is wrong and costs no message.
    """

    data: Bytes
    first: int
    end: int
    whole: bool
    problem: str


def chunk_records(data: Bytes, first: int, end: int, budget: UnpackingBudget) -> ChunkRecords:
    """Open the chunk whose body is ``data[first:end]``, cut off or not.

    A chunk that is whole and does not have the stated size or checksum is a `ChunkError`: some of it is wrong, and
    nothing says which part. One that was cut is read as far as it goes. Bytes behind the records, be they extensions
    of the chunk or of its frame, are none of them.
    """
    _, _, size, crc, name = _HEAD.unpack(data[first : min(end, first + _HEAD.size)].tobytes())
    start = first + _HEAD.size + name + 8
    if start > end or size > LONGEST:
        raise ChunkError(f"{size} bytes, allowed: up to {LONGEST}")
    compression = data[first + _HEAD.size : start - 8].tobytes().decode("utf-8", "replace")
    stored = int.from_bytes(data[start - 8 : start].tobytes(), "little")
    whole = end - start >= stored
    end = min(end, start + stored)
    if compression:
        budget.spend(end - start, size)
        data = _decompressed(data[start:end].tobytes(), compression, size)
        start, end = 0, len(data)
    there, end = end - start, min(end, start + size)
    certain = bool(crc) and isal_zlib.crc32(data[start:end]) == crc
    if whole and not certain and (crc or there < size):
        raise ChunkError(f"{there} bytes, stated are {size}" + (" and another checksum" if crc else ""))
    problem = f"more than the {size} bytes that it states" if there > size else ""
    if whole and there < size:
        problem = f"{there} bytes with the right checksum, stated are {size}"
    return ChunkRecords(data, start, end, whole, problem)


def _decompressed(stored: bytes, compression: str, size: int) -> Bytes:
    """Up to `size` bytes, and one more where there are more; fewer when the frame is cut or damaged."""
    if compression == "zstd":
        return unzipped(stored, size + 1)
    if compression == "lz4":
        return _read(_lz4_reader(stored), size + 1)
    raise ChunkError(unknown_codec(compression))


def unknown_codec(compression: str) -> str:
    """Say that a compression is not read; empty for one that is."""
    return "" if compression in ("", "zstd", "lz4") else f"compression {quoted(compression)}, allowed: none, zstd, lz4"


def unzipped(stored: bytes, most: int) -> Bytes:
    """Up to `most` bytes of a zstd frame; fewer when it is cut or damaged."""
    return _read(zstandard.ZstdDecompressor().stream_reader(stored).read, most)


def _read(read: Callable[[int], bytes], room: int) -> Bytes:
    parts = []
    while room:
        try:
            part = read(min(room, _STEP))
        except (zstandard.ZstdError, RuntimeError, MemoryError):
            break
        if not part:
            break
        parts.append(part)
        room -= len(part)
    return np.frombuffer(b"".join(parts), np.uint8)


def _lz4_reader(stored: bytes) -> Callable[[int], bytes]:
    """Reader of a frame; the library's own file object gives nothing of the last blocks of a cut one."""
    frame = lz4.frame.LZ4FrameDecompressor()
    rest = [stored]

    def read(count: int) -> bytes:
        return b"" if frame.eof else bytes(frame.decompress(rest.pop() if rest else b"", max_length=count))

    return read
