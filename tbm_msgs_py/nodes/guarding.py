"""Callbacks whose errors do not end the process: no message of others ends a node."""

from __future__ import annotations

import functools
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from tbm_msgs_py.nodes.fault_log import FaultLog

if TYPE_CHECKING:
    from tbm_msgs_py.nodes.managed import ManagedNode

UNEXPECTED: Final = "unexpected error in"
FAILING: Final = "fails every time"
"""In the log, by which a command that waits for the node knows that it waits in vain."""
CALLS, SECONDS = 20, 5.0  # that failed in a row, and for how long at least, until a timer is said to fail every time


@dataclass
class _Streak:
    """Calls of a timer that failed, one after the other, and the time of the first."""

    calls: int = 0
    since: float = 0.0
    said: bool = False

    def add(self) -> bool:
        """Add a call; whether now is the time to say that it fails every time."""
        now = time.monotonic()
        self.since = self.since if self.calls else now
        self.calls += 1
        due = not self.said and self.calls >= CALLS and now - self.since >= SECONDS
        self.said |= due
        return due


class Guard:
    """Wraps the callbacks of a node.

    Parameters
    ----------
    node : ManagedNode
        May still be in the making.

    Attributes
    ----------
    failed : int
        Callbacks that raised unexpected errors, since the start.
    """

    def __init__(self, node: ManagedNode[Any]) -> None:
        self.failed = 0
        self._node = node
        self._faults: FaultLog[str] = FaultLog(lambda text: node.get_logger().error(text))

    def __call__(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a callback; one that fails returns its last argument, which is the response of a service."""

        @functools.wraps(callback)
        def guarded(*args: Any) -> Any:
            try:
                return callback(*args)
            except Exception as error:  # noqa: BLE001 - of whatever kind
                self._report(_name(callback), error)
                return args[-1] if args else None

        return guarded

    def timer(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Wrap the callback of a timer, which no message of others calls: one that fails every time is said to."""
        streak = _Streak()

        @functools.wraps(callback)
        def guarded() -> None:
            nonlocal streak
            try:
                callback()
            except Exception as error:  # noqa: BLE001 - of whatever kind
                text = self._report(_name(callback), error)
                if text and streak.add():
                    self._node.get_logger().fatal(f"{text}; it {FAILING}")
            else:
                streak = _Streak()

        return guarded

    def _report(self, name: str, error: Exception) -> str:
        """Report an error, and return its text; none after SIGINT: publishing fails then, which is the shutdown."""
        if not self._node.context.ok():
            return ""
        self.failed += 1
        text = " ".join(f"{UNEXPECTED} {name}: {type(error).__name__}: {error}".split())
        self._faults.report(name, text)
        self._faults.clear(name)  # an event: shown once
        self._node.get_logger().debug(traceback.format_exc())
        return text

    def show(self) -> list[str]:
        """Return the errors since the last call."""
        return list(self._faults.show().values())


def _name(callback: Callable[..., Any]) -> str:
    while isinstance(callback, functools.partial):
        callback = callback.func
    return getattr(callback, "__name__", type(callback).__name__).strip("_")
