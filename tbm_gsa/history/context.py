"""The context of a machine: ring, chainage, rock class and shift."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal, get_args

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.texts import LONGEST_LINE, doubled, listed, quoted
from tbm_msgs_py.recordings.faults import CLOCK_JUMP_NS

ContextKey = Literal["ring", "chainage", "rock_class", "shift"]
CONTEXT_KEYS: Final[tuple[ContextKey, ...]] = get_args(ContextKey)


@dataclass(frozen=True, slots=True)
class Context:
    """Where the machine is and who drives it, as the site says; None where it does not.

    Attributes
    ----------
    ring : int, optional
        Number of the ring being built.
    chainage : float, optional
        Along the tunnel, m.
    rock_class : str, optional
    shift : str, optional
    """

    ring: int | None = None
    chainage: float | None = None
    rock_class: str | None = None
    shift: str | None = None


UNKNOWN: Final = Context()
_MOST: Final = 10_000  # changes that are remembered
_MOST_RING: Final = 2**62
FARTHEST: Final = 1e9
"""Largest chainage either way, m."""


class ContextError(InputError):
    """A message that is no context, in one line."""


def read_context(pairs: Iterable[tuple[str, str]]) -> Context:
    """Context of texts by key; an empty text is not known."""
    pairs = list(pairs)
    if twice := doubled(key for key, _ in pairs):
        raise ContextError(f"{twice} twice, allowed: each once")
    if others := [key for key, _ in pairs if key not in CONTEXT_KEYS]:
        raise ContextError(f"keys {listed(map(quoted, others))}, allowed: {', '.join(CONTEXT_KEYS)}")
    said = {key: value.strip() for key, value in pairs if value.strip()}
    return Context(
        _ring(said.get("ring")),
        _chainage(said.get("chainage")),
        _text("rock_class", said.get("rock_class")),
        _text("shift", said.get("shift")),
    )


def _ring(text: str | None) -> int | None:
    if text is None:
        return None
    if not (text.removeprefix("-").isdecimal() and text.isascii() and len(text) < 20 and abs(int(text)) <= _MOST_RING):
        raise ContextError(f"ring {quoted(text)}, allowed: a whole number")
    return int(text)


def _chainage(text: str | None) -> float | None:
    try:
        value = None if text is None else float(text)
    except ValueError:
        value = math.nan
    if value is not None and not abs(value) <= FARTHEST:
        raise ContextError(f"chainage {quoted(text)}, allowed: a number of m, up to {FARTHEST:g}")
    return value


def _text(key: str, text: str | None) -> str | None:
    if text is not None and not (text.isprintable() and len(text) <= LONGEST_LINE):
        raise ContextError(f"{key} {quoted(text)}, allowed: up to {LONGEST_LINE} printable characters")
    return text


class ContextLog:
    """Contexts in the order of their stamps."""

    def __init__(self) -> None:
        self._stamps: list[int] = []
        self._contexts: list[Context] = []

    def add(self, stamp_ns: int, context: Context, now_ns: int) -> str:
        """Add a context that holds from a stamp on; why it holds from now on, where the stamp cannot be used.

        A stamp that jumps back begins anew.
        """
        doubt = ""
        if now_ns and not 0 < stamp_ns <= now_ns + CLOCK_JUMP_NS:
            ahead = (stamp_ns - now_ns) * 1e-9
            doubt = (
                f"{'the stamp is 0' if stamp_ns == 0 else f'the stamp is {ahead:.3f} s ahead'}: it holds from now on"
            )
            stamp_ns = now_ns
        keep = bisect_right(self._stamps, stamp_ns - 1)
        self._stamps[keep:], self._contexts[keep:] = [stamp_ns], [context]
        del self._stamps[:-_MOST], self._contexts[:-_MOST]
        return doubt

    def at(self, time_ns: int) -> Context:
        """Context at a time."""
        place = bisect_right(self._stamps, time_ns)
        return self._contexts[place - 1] if place else UNKNOWN
