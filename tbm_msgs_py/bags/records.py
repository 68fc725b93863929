"""The records of an MCAP file or chunk, walked over in compiled code, damaged or not.

A record is an opcode (1 byte), the length of its body (8 bytes) and the body (mcap.dev/spec). One walk finds the
messages among some bytes as four rows of numbers; nothing is made for a single message. Where no record can
begin, the walk searches for the next place from which three records follow one another.

A body may be longer than its fields: all records but Message and Footer "may be extended by adding new fields at the
end", and opcodes that the specification does not know yet are stepped over.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numba import njit

from tbm_msgs_py.base.arrays import Bytes, Integers

HEAD = 9  # bytes before the body of a record
MESSAGE_HEAD = 22  # bytes of a message's body before its data
CHUNK_HEAD = 40  # bytes of a chunk's body, without the name of its compression and the records
LONGEST = 1 << 28  # bytes of the longest body that is read; attachments are skipped and may be longer

MORE, FOOTER, CUT = 0, 1, 2  # why a walk ended: more bytes are needed, the footer, the end of the bytes

# Least bytes of a body by opcode.
_LEAST = np.array([0, 8, 20, 14, 16, 22, 40, 6, 64, 36, 48, 46, 8, 20, 17, 4], np.int64)
# Records whose body is needed; the others are stepped over.
_WANTED = np.isin(
    np.arange(16),
    (
        Opcode.SCHEMA,
        Opcode.CHANNEL,
        Opcode.MESSAGE,
        Opcode.CHUNK,
        Opcode.MESSAGE_INDEX,
        Opcode.CHUNK_INDEX,
        Opcode.STATISTICS,
    ),
)
_MESSAGE, _CHUNK, _FOOTER = int(Opcode.MESSAGE), int(Opcode.CHUNK), int(Opcode.FOOTER)
_LONGEST_CODEC = 64  # bytes of the name of a chunk's compression
_LOOKED_AT = HEAD + CHUNK_HEAD + _LONGEST_CODEC  # bytes by which a record is judged
_CHAIN = 3  # records that have to follow one another for a search to end there
_MAGIC = 8  # bytes after the footer
COMPILED = {"cache": True, "nogil": True, "error_model": "numpy"}


class Walk(NamedTuple):
    """What a walk found.

    Attributes
    ----------
    messages : ndarray (4, n)
        Channel, log time in ns, place and size in bytes of the data of each message.
    others : ndarray (3, m)
        Opcode, place and size of the body of each other record that matters.
    stop : int
        Where the first record begins that was not taken.
    state : int
        ``MORE``, ``FOOTER`` or ``CUT``.
    searching : bool
        The walk ended while it searched for the next record.
    damaged, lost : int
        Places that were not records; messages known to be lost there.
    """

    messages: Integers
    others: Integers
    stop: int
    state: int
    searching: bool
    damaged: int
    lost: int


def walk(data: Bytes, first: int, end: int, limit: int, *, searching: bool = False) -> Walk:
    """Walk over the records that begin in ``data[first:end]``.

    Parameters
    ----------
    data : ndarray of uint8
        Bytes.
    first, end : int
        Where the first record begins, and the bytes that are there.
    limit : int
        Where the records end, `end` or behind it when the rest is yet to be read.
    searching : bool
        Of the walk before this one.
    """
    return Walk(*_walk(data, first, end, limit, searching))


def gather(data: Bytes, starts: Integers, width: int) -> Bytes:
    """Copy `width` bytes from each start, (n, width)."""
    out = np.empty((len(starts), width), np.uint8)
    _gather(data, starts, out)
    return out


def join(data: Bytes, starts: Integers, sizes: Integers) -> Bytes:
    """Copy `sizes` bytes from each start, one behind the other."""
    out = np.empty(int(sizes.sum()), np.uint8)
    _join(data, starts, sizes, out)
    return out


@njit(**COMPILED)  # type: ignore[untyped-decorator]
def number(data: Bytes, at: int, size: int, big: bool = False) -> np.int64:
    """Unsigned number of `size` bytes, as int64, little-endian by default; compiled."""
    value, place = np.int64(0), np.uintp(at)
    for i in range(size):
        value |= np.int64(data[place + np.uintp(i)]) << (8 * (size - 1 - i if big else i))
    return value


@njit(**COMPILED)  # type: ignore[untyped-decorator]
def _chunk_length(data: Bytes, at: int, end: int) -> int:
    """Bytes that the fields of a chunk come to by the lengths in them; -1 where they cannot be a chunk's."""
    if at + HEAD + CHUNK_HEAD > end:
        return -1
    name = number(data, at + HEAD + 28, 4)
    if name > _LONGEST_CODEC or at + HEAD + CHUNK_HEAD + name > end:
        return -1
    size = number(data, at + HEAD + 32 + name, 8)
    return CHUNK_HEAD + name + size if 0 <= size <= LONGEST else -1


@njit(**COMPILED)  # type: ignore[untyped-decorator]
def _can_follow(data: Bytes, at: int, end: int, limit: int) -> bool:
    """Whether a record of any opcode, or the end, can be at a place; taken for granted where no bytes are yet."""
    if at == limit:
        return True
    if at + HEAD > end:
        return end < limit
    length = number(data, at + 1, 8)
    least = _LEAST[data[at]] if data[at] <= 15 else 0
    return bool(data[at] != 0 and least <= length <= limit - at - HEAD)


@njit(**COMPILED)  # type: ignore[untyped-decorator]
def _fits(data: Bytes, at: int, end: int, limit: int) -> bool:
    """Whether a record of the specification can begin at a place."""
    if at + HEAD > end:
        return False
    opcode = data[at]
    if opcode == 0 or opcode > 15:
        return False
    length = number(data, at + 1, 8)
    if length < _LEAST[opcode] or (opcode == _FOOTER and length != _LEAST[opcode]):
        return False
    if (length > LONGEST and _WANTED[opcode]) or length > limit - at - HEAD:
        return False
    if opcode != _CHUNK:
        return True
    own = _chunk_length(data, at, end)
    # Two lengths that differ: the chunk is extended, or the first is wrong and nothing follows where it says.
    return bool(own == length or (0 <= own < length and _can_follow(data, at + HEAD + length, end, limit)))


@njit(**COMPILED)  # type: ignore[untyped-decorator]
def _is_cut_chunk(data: Bytes, at: int, end: int, limit: int) -> bool:
    """Whether a chunk begins at a place whose records go on behind the last byte."""
    if data[at] != _CHUNK:
        return False
    own = _chunk_length(data, at, end)
    return bool(0 <= own <= number(data, at + 1, 8) <= 2 * LONGEST and own > limit - at - HEAD)


@njit(**COMPILED)  # type: ignore[untyped-decorator]
def _begins(data: Bytes, at: int, end: int, limit: int) -> int:
    """1 where records certainly begin, 0 where not, -1 where more bytes have to be seen."""
    place = at
    for count in range(_CHAIN):
        if count > 0 and place == limit:
            return 1
        if place + _LOOKED_AT > end and end < limit:
            return -1
        if not _fits(data, place, end, limit):
            return 0
        if data[place] == _CHUNK and _chunk_length(data, place, end) == number(data, place + 1, 8):
            return 1
        if data[place] == _FOOTER:
            return 1 if limit - place == HEAD + _LEAST[_FOOTER] + _MAGIC else 0
        place += HEAD + number(data, place + 1, 8)
    return 1


@njit(**COMPILED)  # type: ignore[untyped-decorator]
def _search(data: Bytes, first: int, end: int, limit: int) -> tuple[int, int]:
    """Place of the next record from `first` on, and what `_begins` says there; (-1, 0) without one."""
    for place in range(first, end - HEAD + 1):
        if data[place] == 0 or data[place] > 15:
            continue
        verdict = _begins(data, place, end, limit)
        if verdict != 0:
            return place, verdict
    return -1, 0


@njit(**COMPILED)  # type: ignore[untyped-decorator]
def _foreign(data: Bytes, at: int, end: int, limit: int) -> int:
    """Whether a record of an opcode that the specification leaves open stands there: one that fits follows.

    1 or 0, and -1 where more bytes have to be seen.
    """
    place = at
    for _ in range(_CHAIN):
        if place == limit or (place + HEAD <= end and data[place] <= 15):
            return int(place > at and (place == limit or _fits(data, place, end, limit)))
        if place + HEAD > end:
            return -1 if end < limit else 0
        length = number(data, place + 1, 8)
        if length < 0 or length > min(limit - place - HEAD, LONGEST):
            return 0
        place += HEAD + length
    return 1


@njit(**COMPILED)  # type: ignore[untyped-decorator]
def _walk(  # noqa: PLR0912, PLR0915 one loop
    data: Bytes, first: int, end: int, limit: int, searching: bool
) -> tuple[Integers, Integers, int, int, bool, int, int]:
    messages = np.empty((4, (end - first) // (HEAD + MESSAGE_HEAD) + 1), np.int64)
    others = np.empty((3, (end - first) // HEAD + 1), np.int64)
    n, m, at, previous, state, damaged, lost = 0, 0, first, -1, CUT, 0, 0
    while at < limit:
        if at >= end or (end < limit and at + _LOOKED_AT > end):
            state = MORE
            break
        if not searching:
            known = _fits(data, at, end, limit)
            foreign = 0 if known else _foreign(data, at, end, limit)
            if foreign < 0:
                state = MORE
                break
            if known or foreign:
                opcode, length = data[at], number(data, at + 1, 8)
                if opcode == _FOOTER:
                    state = FOOTER
                    break
                body = at + HEAD
                if known and _WANTED[opcode]:
                    if body + length > end or (opcode == _CHUNK and end < min(limit, body + length + HEAD)):
                        state = MORE
                        break
                    if opcode == _MESSAGE:
                        log = number(data, body + 6, 8)
                        if log < 0:  # beyond what a signed number of ns can be
                            lost += 1
                        else:
                            messages[0, n] = number(data, body, 2)
                            messages[1, n] = log
                            messages[2, n] = body + MESSAGE_HEAD
                            messages[3, n] = length - MESSAGE_HEAD
                            n += 1
                    else:
                        others[0, m], others[1, m], others[2, m] = opcode, body, length
                        m += 1
                # A message may have been too long by its damage: then the search begins within it.
                previous = at if opcode == _MESSAGE else -1
                at = body + length
                continue
            if _is_cut_chunk(data, at, end, limit):
                state = CUT if end == limit else MORE
                break
        start = at if searching or previous < 0 else previous
        place, verdict = _search(data, start + (0 if searching else 1), end, limit)
        if place < 0 and end == limit:
            break
        damaged += not searching
        searching = verdict != 1
        if place < 0:
            at, state = max(at, end - _LOOKED_AT + 1), MORE
            break
        if place < at and n > 0 and previous >= 0 and messages[2, n - 1] == previous + HEAD + MESSAGE_HEAD:
            n -= 1
            lost += 1
        at, previous = place, -1
        if searching:
            state = MORE
            break
    return messages[:, :n].copy(), others[:, :m].copy(), at, state, searching, damaged, lost


# Unsigned indices: numba asks of every signed one whether it counts from the end, which keeps copies from being fast.
@njit(**COMPILED)  # type: ignore[untyped-decorator]
def _gather(data: Bytes, starts: Integers, out: Bytes) -> None:
    width = np.uintp(out.shape[1])
    for k in range(len(starts)):
        at = np.uintp(starts[k])
        for i in range(width):
            out[k, i] = data[at + np.uintp(i)]


@njit(**COMPILED)  # type: ignore[untyped-decorator]
def _join(data: Bytes, starts: Integers, sizes: Integers, out: Bytes) -> None:
    place = np.uintp(0)
    for k in range(len(starts)):
        at, size = np.uintp(starts[k]), np.uintp(sizes[k])
        for i in range(size):
            out[place + np.uintp(i)] = data[at + np.uintp(i)]
        place += size
