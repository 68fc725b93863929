"""Callbacks whose errors do not end the process: no message of others ends a node."""

from __future__ import annotations

import functools
import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from tbm_msgs_py.nodes.fault_log import FaultLog

if TYPE_CHECKING:
    from tbm_msgs_py.nodes.managed import ManagedNode


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
                # After SIGINT publishing fails at any line: that is the shutdown, not a fault.
                if self._node.context.ok():
                    self._report(_name(callback), error)
                return args[-1] if args else None

        return guarded

    def _report(self, name: str, error: Exception) -> None:
        self.failed += 1
        text = " ".join(f"unexpected error in {name}: {type(error).__name__}: {error}".split())
        self._faults.report(name, text)
        self._faults.clear(name)  # an event: shown once
        self._node.get_logger().debug(traceback.format_exc())

    def show(self) -> list[str]:
        """Return the errors since the last call."""
        return list(self._faults.show().values())


def _name(callback: Callable[..., Any]) -> str:
    while isinstance(callback, functools.partial):
        callback = callback.func
    return getattr(callback, "__name__", type(callback).__name__).strip("_")
