"""Texts that others wrote, held within bounds: how long one may be, how much of one a message quotes."""

from __future__ import annotations

import errno
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

LONGEST_NAME: Final = 255
"""Characters of a name, as of a topic in ROS 2: of a machine, a test point, a column, a group of inputs."""

LONGEST_LINE: Final = 1000
"""Characters of a line of prose, as the source of a value."""

LARGEST_TEXT: Final = 1 << 20
"""Bytes of a file that people write by hand, a hundred times what any shipped one has: YAML takes seconds for it."""

LARGEST_TABLE: Final = 16 << 20
"""Bytes of a table that is held in memory: a week of a schedule at a row a second."""

LONGEST_MESSAGE: Final = 2000
"""Characters of a message; what it says first says what is wrong."""

_QUOTED: Final = 80
_LISTED: Final = 20


def shortened(text: str, most: int = LONGEST_MESSAGE) -> str:
    """Give a text; of a long one the beginning, and how long it is."""
    return text if len(text) <= most else f"{text[:most]}… ({len(text)} characters)"


def quoted(value: Any) -> str:
    """Quote a value that was given; of a long one the beginning, and how long it is."""
    return shortened(repr(value), _QUOTED)


def listed(names: Iterable[str], most: int = _LISTED, separator: str = ", ") -> str:
    """Names for a message, each once and in their order; of many the first, and how many more there are."""
    there = list(dict.fromkeys(names))
    more = f" and {len(there) - most} more" if len(there) > most else ""
    return (separator.join(shortened(name, LONGEST_LINE) for name in there[:most]) or "none") + more


def read_text(path: Path, encoding: str = "utf-8", largest: int = LARGEST_TEXT) -> str:
    """Read a text file that may be anybody's.

    Raises
    ------
    OSError
        It cannot be read, or is larger than `largest` bytes.
    UnicodeDecodeError
        No text of this encoding.
    """
    with path.open("rb") as file:
        data = file.read(largest + 1)
    if len(data) > largest:
        raise OSError(errno.EFBIG, f"larger than {largest >> 20} MiB", str(path))
    return data.decode(encoding).replace("\r\n", "\n").replace("\r", "\n")
