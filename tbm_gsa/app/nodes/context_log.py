"""The context while it arrives: ring, chainage, rock class and shift, each from a time on."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable

from diagnostic_msgs.msg import DiagnosticArray

from tbm_gsa.history import CONTEXT_KEYS, UNKNOWN, Context
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.texts import LONGEST_LINE, doubled, listed, quoted
from tbm_msgs_py.nodes import messages
from tbm_msgs_py.recordings.faults import CLOCK_JUMP_NS

_MOST = 10_000  # changes that are remembered
_MOST_RING = 2**62


class ContextError(InputError):
    """A message that is no context, in one line."""


def context_from(message: DiagnosticArray) -> tuple[int, Context]:
    """Stamp (ns) and context of a message.

    Raises
    ------
    InputError
        A key that there is not or twice, a value that is none of it, a stamp that is no ROS time.
    """
    stamp_ns = messages.stamp_to_ns(message.header.stamp)
    return stamp_ns, read_context([(pair.key, pair.value) for status in message.status for pair in status.values])


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
    if value is not None and not math.isfinite(value):
        raise ContextError(f"chainage {quoted(text)}, allowed: a number, m")
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
