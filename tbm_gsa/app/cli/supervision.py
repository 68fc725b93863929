"""The nodes that a command has started: their processes, and what they report on `/diagnostics`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

import typer

from tbm_gsa.app.cli.output import notes
from tbm_gsa.app.cli.processes import NodeCommand, NodeProcesses
from tbm_msgs_py.topics import status_name

if TYPE_CHECKING:
    from tbm_gsa.app.nodes.watch import Watch

ACTIVE_STATUSES = frozenset({"tbm: loads", "tbm: dynamics", "tbm: history"})
"""Statuses that the nodes of a machine publish once a second while they are active."""

_SILENT_S = 10.0  # of a node that reports once a second, and less often while it compiles


def watch(points: Iterable[str]) -> Watch:
    """Watch over the running system.

    Raises
    ------
    click.UsageError
        There is no ROS 2 here.
    """
    try:
        from tbm_gsa.app.nodes.watch import Watch  # noqa: PLC0415 - only these commands need ROS
    except ImportError as error:
        raise typer.BadParameter(
            f"ROS 2 is not installed here ({error}); install ros-jazzy-rclpy or source a workspace"
        ) from None
    return Watch(points)


class Supervision:
    """Prints a line when a node is ready, when it is not as it should be, and when it is again.

    Parameters
    ----------
    processes : NodeProcesses
    diagnostics : mapping of str to (level, text, values)
        Latest ones on `/diagnostics`, by the name of the status; a new tuple for each message.
    clock : callable
        Seconds.
    """

    def __init__(
        self,
        processes: NodeProcesses,
        diagnostics: Mapping[str, tuple[int, str, Mapping[str, str]]],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._processes, self._diagnostics, self._clock = processes, diagnostics, clock
        self._reported: dict[str, str] = {}
        self._received: dict[str, tuple[object, float]] = {}  # the last status of a node, and when it was first seen
        self._checked = clock()

    def start(self, command: NodeCommand) -> None:
        """Start a node."""
        self._processes.start(command)
        self._reported[command.name] = ""

    def check(self) -> None:
        """Print what has changed; raise `RunError` if a node has ended."""
        self._processes.check()
        now = self._clock()
        if now - self._checked > _SILENT_S / 2.0:  # this process was stopped itself meanwhile
            self._received.clear()
        self._checked = now
        for name, reported in self._reported.items():
            text = self._text(name, now) or reported
            if text != reported:
                self._reported[name] = text
                notes.print(f"{name}: {text}", highlight=False)

    def _text(self, name: str, now: float) -> str:
        """Return the text of a node, or that it is silent, as one that is stopped or hangs; empty before its first."""
        status = self._diagnostics.get(status_name(name))
        if status is None:
            return ""
        before, since = self._received.get(name, (None, now))
        if status is not before:
            self._received[name] = status, now
        elif now - since > _SILENT_S:
            return f"has said nothing for {_SILENT_S:g} s"
        return status[1]
