"""Texts of others, such as names in a recording or messages of the network, on their way to a terminal or a log."""

from __future__ import annotations


def printable(text: str, keep: str = "") -> str:
    r"""Show what a terminal would obey, or what would turn its line around, as an escape such as ``\x1b``.

    Control characters, those that change the direction of writing, and whatever else has no shape of its own.

    Parameters
    ----------
    text : str
    keep : str
        Characters that stay as they are.
    """
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() or one in keep else _escape(one) for one in text)


def _escape(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
