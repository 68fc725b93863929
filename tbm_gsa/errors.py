"""The errors of this package that are lines for a user; one of a library is a fault of the program."""

from collections.abc import Iterable

_MOST_LISTED = 12


class InputError(ValueError):
    """What was given cannot be used: what, where and what is allowed, in one line."""


class RunError(RuntimeError):
    """What was started did not come to its end: what and why, in one line."""


def listed(names: Iterable[str]) -> str:
    """Names for a message, each once and in their order: the first dozen, and how many more there are."""
    known = list(dict.fromkeys(names))
    left_out = len(known) - _MOST_LISTED
    return ", ".join(known[:_MOST_LISTED]) + (f" and {left_out} more" if left_out > 0 else "") or "none"
