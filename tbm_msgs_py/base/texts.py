"""Texts of others, such as names in a recording or values of a file: held within bounds and fit for a terminal."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Final

LONGEST_NAME: Final = 255
"""Characters of a name, as of a topic in ROS 2: of a machine, a test point, a column, a group of inputs."""
LONGEST_LINE: Final = 1000
"""Characters of a line of prose, as the source of a value."""
LONGEST_MESSAGE: Final = 2000
"""Characters of a message; its beginning says what is wrong."""
_QUOTED: Final = 80
_LISTED: Final = 20


def shortened(text: str, most: int = LONGEST_MESSAGE) -> str:
    """Text as it is, or the beginning of a long one and its length."""
    return text if len(text) <= most else f"{text[:most]}… ({len(text)} characters)"


def quoted(value: object) -> str:
    """Value in quotes, or the beginning of a long one and its length."""
    return shortened(repr(value), _QUOTED)


def listed(names: Iterable[str], most: int = _LISTED, separator: str = ", ") -> str:
    """Names for a message, each once and in their order; of many the first, and how many more there are."""
    there = list(dict.fromkeys(names))
    more = f" and {len(there) - most} more" if len(there) > most else ""
    return (separator.join(shortened(name, LONGEST_LINE) for name in there[:most]) or "none") + more


def doubled(names: Iterable[str]) -> str:
    """First name that stands twice, fit for a message; empty where each stands once."""
    counts = Counter(names)
    return next((shortened(name, LONGEST_NAME) for name, count in counts.items() if count > 1), "")


def printable(text: str, keep: str = "") -> str:
    r"""Text with escapes such as ``\x1b`` for what a terminal would obey, or what would turn its line around.

    Control characters, those that change the direction of writing, and other characters without a glyph; the
    characters of `keep` stay as they are.
    """
    if text.isprintable():
        return text
    escaped = (one if one.isprintable() or one in keep else one.encode("unicode_escape").decode() for one in text)
    return "".join(escaped)


def number_reader(decimal: str = ".", thousands: str | None = None) -> Callable[[str], float | None]:
    """Make what reads a text in the stated format and no other: its finite number, or None.

    Digits, one decimal sign, an exponent; `float` alone takes underscores, digits of other scripts and words, too.
    """
    whole = r"\d+"
    if thousands is not None:
        whole = rf"(?:\d{{1,3}}(?:{re.escape(thousands)}\d{{3}})+|\d+)"
    point = re.escape(decimal)
    form = re.compile(rf"[+-]?(?:{whole}(?:{point}\d*)?|{point}\d+)(?:[eE][+-]?\d+)?", re.ASCII)

    def read(text: str) -> float | None:
        text = text.strip()
        if not form.fullmatch(text):
            return None
        value = float(text.replace(thousands or "", "").replace(decimal, "."))
        return value if math.isfinite(value) else None

    return read
