"""Faults: a line in the log when one begins, and a text on `/diagnostics` until it is over."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)

_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
REPEAT_S = 60.0  # until the same line is logged again
MOST_LINES = 5  # of one fault in that time


class FaultLog(Generic[Key]):
    """Faults by key. One that is over stays until it has been shown once, so that none is over unseen.

    Parameters
    ----------
    warn : callable
        Called with a line for the log.
    now : callable
        Seconds, monotonic.
    """

    def __init__(self, warn: Callable[[str], object], now: Callable[[], float] = time.monotonic) -> None:
        self._warn, self._now = warn, now
        self._standing: dict[Key, str] = {}
        self._over: set[Key] = set()
        self._logged: dict[tuple[Key, str], float] = {}

    def report(self, key: Key, text: str, where: str = "") -> None:
        """Add a fault; its line in the log begins with the place, which `/diagnostics` names elsewhere."""
        self._standing[key] = text
        self._over.discard(key)
        gist, now = _NUMBER.sub("#", text), self._now()  # another count is no other fault
        if now - self._logged.get((key, gist), -math.inf) <= REPEAT_S:
            return
        self._logged = {line: when for line, when in self._logged.items() if now - when <= REPEAT_S}
        if sum(logged == key for logged, _ in self._logged) < MOST_LINES:  # texts of others may all differ
            self._logged[key, gist] = now
            self._warn(f"{where}{text}")

    def update(self, key: Key, text: str) -> None:
        """Report a fault, or clear it where the text is empty."""
        if text:
            self.report(key, text)
        else:
            self.clear(key)

    def clear(self, key: Key) -> None:
        """Mark a fault as over."""
        if key in self._standing:
            self._over.add(key)

    def show(self) -> dict[Key, str]:
        """Faults for one message; those that are over are gone from the next."""
        shown = dict(self._standing)
        for key in self._over:
            del self._standing[key]
        self._over.clear()
        return shown
