"""WAV files: channels ``1``, ``2`` ... as shares of full scale, at the rate of the file, read a piece at a time."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.texts import quoted
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.importing.layout import FileLayout, TimeBase
from tbm_msgs_py.importing.measurement_file import PIECE_ROWS, MeasurementFile, Rows

_WHOLE_NUMBERS, _FLOATS, _EXTENSIBLE = 1, 3, 0xFFFE
_WIDTHS: Final = {_WHOLE_NUMBERS: (1, 2, 3, 4, 8), _FLOATS: (4, 8)}  # bytes of a reading
_MOST_OF_RIFF: Final = 2**32  # bytes
_MOST_CHUNKS: Final = 10_000
_LARGE: Final = (b"RF64", b"BW64")  # EBU Tech 3306 and ITU-R BS.2088: sizes of 64 bits in a ds64 chunk
# Identifiers of samples behind their first two bytes, which are a format: Microsoft's, and that of B-format.
_SUBFORMATS: Final = (bytes.fromhex("000000001000800000aa00389b71"), bytes.fromhex("00002107d3118644c8c1ca000000"))
_BEXT: Final = slice(320, 338)  # date and time of the first sample, by EBU Tech 3285: 2026-03-01, 08:00:00


@dataclass(frozen=True)
class _Format:
    """What the ``fmt`` chunk states: tag, readings a row, rows a second, bytes of row and reading, spare bits of it."""

    tag: int
    channels: int
    rate: int
    row: int
    width: int
    spare: int


@dataclass(frozen=True)
class _WavChannel:
    """Readings of a channel, its bytes (n, width), as shares of full scale."""

    data: NDArray[np.uint8]
    tag: int

    def __len__(self) -> int:
        return len(self.data)

    def __getitem__(self, rows: slice) -> Array:
        data = np.ascontiguousarray(self.data[rows])
        width = data.shape[1]
        if self.tag == _FLOATS:
            return np.asarray(data.view(f"<f{width}")[:, 0], dtype=np.float64)
        if width == 1:  # the only one without a sign
            return np.asarray((data[:, 0] - 128.0) / 128.0)
        whole = np.zeros((len(data), 4 if width <= 4 else 8), np.uint8)
        whole[:, -width:] = data  # left-aligned, so that the sign is in its place
        return np.asarray(whole.view(f"<i{whole.shape[1]}")[:, 0] / 2.0 ** (8 * whole.shape[1] - 1), np.float64)


class WavFile(MeasurementFile):
    """A WAV file (RIFF, RF64 or BW64) of whole numbers or floats; its channels are numbered from 1."""

    kind = "a WAV"
    full_scale = True
    clocks = ("file",)

    def __init__(self, path: Path, layout: FileLayout) -> None:
        super().__init__(path, layout)
        self._bytes: NDArray[np.uint8] = (
            np.memmap(path, np.uint8, "r") if path.stat().st_size else np.empty(0, np.uint8)
        )
        head = self._bytes[:12].tobytes()
        if head[:4] not in (b"RIFF", *_LARGE) or head[8:] != b"WAVE":
            raise self.error("not a WAV file: does not begin with RIFF, RF64 or BW64 and WAVE, allowed: one of those")
        self._chunks = self._walk(head[:4] in _LARGE)
        self._format = self._read_format()
        self._data = self._rows()

    @property
    def start_ns(self) -> int | None:
        """Start that a ``bext`` chunk states, in the zone that is stated."""
        if b"bext" not in self._chunks:
            return None
        text = self._chunk(b"bext")[_BEXT].tobytes().decode("latin-1")
        numbers = re.fullmatch(r"(\d{4}).(\d\d).(\d\d)(\d\d).(\d\d).(\d\d)", text, re.ASCII)
        try:
            clock = datetime.strptime("".join(numbers.groups()), "%Y%m%d%H%M%S") if numbers else None
        except ValueError:
            clock = None
        if clock is None:
            raise self.error(f"start: file: {quoted(text)} in its bext chunk, allowed: a date and a time")
        return self.local_start(clock)

    def _walk(self, large: bool) -> dict[bytes, tuple[int, int]]:
        """First byte and size of each chunk; that of the data may end behind the file."""
        chunks: dict[bytes, tuple[int, int]] = {}
        at, whole = 12, len(self._bytes)
        for _ in range(_MOST_CHUNKS):
            if at + 8 > whole:
                break
            name, size = struct.unpack("<4sI", self._bytes[at : at + 8].tobytes())
            if name in (b"data", b"fmt ") and name in chunks:
                raise self.error(f"two {name.decode().strip()} chunks, allowed: one")
            if name == b"data" and large and size == 0xFFFFFFFF and b"ds64" in chunks:
                first, length = chunks[b"ds64"]
                size = int.from_bytes(self._bytes[first : first + length][8:16].tobytes(), "little")
            chunks.setdefault(name, (at + 8, size))
            at += 8 + size + size % 2
            if name == b"data" and at < whole and not self._is_chunk(at):
                self._say_what_follows(size, whole - at)
        return chunks

    def _say_what_follows(self, size: int, behind: int) -> None:
        """Refuse a header that was never finished, and name bytes behind the data that are no chunk."""
        if not size:
            raise self.error(
                f"its header says 0 bytes of data, and {behind} bytes follow: it was not finished, allowed: a header "
                "that says how many there are"
            )
        whole = len(self._bytes)
        cause = f": {whole} bytes are more than a RIFF header can say, RF64 can" if whole > _MOST_OF_RIFF else ""
        self.warn(f"{behind} bytes behind the {size} of the data are no chunk, and left out{cause}")

    def _is_chunk(self, at: int) -> bool:
        """Whether a chunk that ends in the file begins at a byte."""
        if at + 8 > len(self._bytes):
            return False
        name, size = struct.unpack("<4sI", self._bytes[at : at + 8].tobytes())
        return bool(name.isascii() and name.decode().isprintable() and at + 8 + size <= len(self._bytes))

    def _chunk(self, name: bytes) -> NDArray[np.uint8]:
        at, size = self._chunks[name]
        return self._bytes[at : at + size]

    def _read_format(self) -> _Format:
        for name in (b"fmt ", b"data"):
            if name not in self._chunks:
                raise self.error(f"no {name.decode().strip()} chunk, allowed: a WAV file that is not damaged")
        head = self._chunk(b"fmt ")[:40].tobytes()
        if len(head) < 16:
            raise self.error(f"a fmt chunk of {len(head)} bytes, allowed: 16 or more")
        tag, channels, rate, _, row, bits = struct.unpack_from("<HHIIHH", head)
        valid = bits
        if tag == _EXTENSIBLE:
            if len(head) < 40 or head[26:] not in _SUBFORMATS:
                raise self.error("format 65534 without the identifier of its samples' format, allowed: that of 1 or 3")
            valid, tag = struct.unpack_from("<H", head, 18)[0] or bits, struct.unpack_from("<H", head, 24)[0]
        if tag not in _WIDTHS:
            raise self.error(f"format {tag}, allowed: 1 (whole numbers) or 3 (floats), or 65534 with one of them")
        if not 0 < rate <= NANOSECONDS:
            raise self.error(f"its header says {rate} samples per second, allowed: 1 to {NANOSECONDS:.0f}")
        width = -(-bits // 8)
        if width not in _WIDTHS[tag] or not channels or row != width * channels:
            raise self.error(
                f"{channels} channels of {bits} bits in {row} bytes, allowed: 1, 2, 3, 4 or 8 bytes, floats 4 or 8, "
                "for each channel"
            )
        if valid > bits:
            raise self.error(f"{valid} valid bits of {bits}, allowed: as many or fewer")
        return _Format(tag, channels, rate, row, width, 8 * width - valid)

    def _rows(self) -> NDArray[np.uint8]:
        """Bytes of the readings, (n, channels, width); a warning where the file ends before its data."""
        at, stated = self._chunks[b"data"]
        there = min(stated, len(self._bytes) - at)
        rows = there // self._format.row
        if stated % self._format.row or there < stated:
            self.warn(f"{stated} bytes of data in its header, {rows} whole rows of {self._format.row} bytes are there")
        data = self._bytes[at : at + rows * self._format.row].reshape(rows, self._format.channels, self._format.width)
        spare = self._format.spare
        mask = ((1 << spare) - 1).to_bytes(self._format.width, "little") if spare else b""
        if mask and (data[:PIECE_ROWS] & np.frombuffer(mask, np.uint8)).any():
            self.warn(
                f"the lowest {spare} bits of readings are set, which its header says are none: aligned otherwise?"
            )
        return data

    def _pieces(self, columns: Sequence[str], time: TimeBase) -> Iterator[Rows]:
        there = [str(k + 1) for k in range(self._format.channels)]
        for column in columns:
            if column not in there:
                raise self.no_column(column, there)
        channels = [_WavChannel(self._data[:, there.index(column)], self._format.tag) for column in columns]
        self.compare_rate(self._format.rate, columns[0])
        ticks = (lambda rows: rows * (NANOSECONDS / self._format.rate)) if time else None
        return self.in_pieces(columns, channels, ticks=ticks)
