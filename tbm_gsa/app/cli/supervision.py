"""The nodes that a command has started: their processes, and what they report on `/diagnostics`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

import typer

from tbm_gsa.app.cli.output import notes
from tbm_gsa.app.cli.processes import NodeCommand, NodeProcesses
from tbm_msgs_py.base.errors import NodeFailure
from tbm_msgs_py.nodes.guarding import UNEXPECTED
from tbm_msgs_py.topics import status_name

if TYPE_CHECKING:
    from tbm_gsa.app.nodes.watch import Watch

ACTIVE_STATUSES = frozenset({"tbm: loads", "tbm: dynamics", "tbm: history"})
"""Statuses that the nodes of a machine publish once a second while they are active."""

_SILENT_S = 10.0  # of a node that reports once a second, and less often while it compiles
_FAILING = 10  # statuses in a row with errors, in which what the command waits for has not gone on


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

    It ends a wait in vain: nothing goes on, and a node says time after time that it fails.

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
        self._failed: dict[str, int] = {}  # its statuses in a row with errors, without progress
        self._checked, self._progress = clock(), 0.0

    def start(self, command: NodeCommand) -> None:
        """Start a node."""
        self._processes.start(command)
        self._reported[command.name] = ""

    def running(self, name: str) -> bool:
        """Whether a node is still there, see `NodeProcesses.running`."""
        return self._processes.running(name)

    def check(self, progress: float = 0.0, ending: str = "") -> None:
        """Print what has changed.

        Parameters
        ----------
        progress : float
            Changes while what the command waits for goes on.
        ending : str
            Node that may have ended.

        Raises
        ------
        RunError
            A node has ended.
        NodeFailure
            One does no work.
        """
        self._processes.check(ending)
        now = self._clock()
        if progress != self._progress:
            self._progress = progress
            self._failed.clear()
        if now - self._checked > _SILENT_S / 2.0:  # this process was stopped itself meanwhile
            self._received.clear()
        self._checked = now
        for name, reported in self._reported.items():
            if name == ending and not self.running(name):
                continue
            text = self._text(name, now) or reported
            if text != reported:
                self._reported[name] = text
                notes.print(f"{name}: {text}", highlight=False)
            if self._failed.get(name, 0) >= _FAILING:
                raise NodeFailure(f"{name}: {text}, time after time; its log: {self._processes.log(name)}")

    def _text(self, name: str, now: float) -> str:
        """Return the text of a node, or that it is silent, as one that is stopped or hangs; empty before its first."""
        status = self._diagnostics.get(status_name(name))
        if status is None:
            return ""
        before, since = self._received.get(name, (None, now))
        if status is not before:
            self._received[name] = status, now
            self._failed[name] = self._failed.get(name, 0) + 1 if UNEXPECTED in status[1] else 0
        elif now - since > _SILENT_S:
            return f"has said nothing for {_SILENT_S:g} s"
        return status[1]
