"""What becomes of the nodes that a command has started: their processes, and what they say of themselves."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from tbm_gsa.app.cli.output import notes
from tbm_gsa.app.cli.processes import NodeCommand, NodeProcesses
from tbm_msgs_py.topics import status_name

_SILENT_S = 10.0  # of a node that speaks once a second, and less often while it compiles


class Supervision:
    """Prints a line when a node is not as it should be, and when it is again.

    Parameters
    ----------
    processes : NodeProcesses
    diagnostics : mapping of str to (level, text, values)
        What has come on `/diagnostics`, by the name of the status; a new tuple for each message.
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
        self._said: dict[str, str] = {}
        self._heard: dict[str, tuple[object, float]] = {}  # the last status of a node, and when it was first seen
        self._looked = clock()

    def start(self, command: NodeCommand) -> None:
        """Start a node."""
        self._processes.start(command)
        self._said[command.name] = "active"

    def check(self) -> None:
        """Print what has changed; raise `RunError` if a node has ended."""
        self._processes.check()
        now = self._clock()
        if now - self._looked > _SILENT_S / 2.0:  # stopped itself meanwhile, this process has heard nobody
            self._heard.clear()
        self._looked = now
        for name, said in self._said.items():
            text = self._text(name, now) or said
            if text != said:
                self._said[name] = text
                notes.print(f"{name}: {text}", highlight=False)

    def _text(self, name: str, now: float) -> str:
        """Find what a node says, or that it is silent, as one that is stopped or hangs; empty before its first word."""
        status = self._diagnostics.get(status_name(name))
        if status is None:
            return ""
        heard, since = self._heard.get(name, (None, now))
        if status is not heard:
            self._heard[name] = status, now
        elif now - since > _SILENT_S:
            return f"has said nothing for {_SILENT_S:g} s"
        return status[1]
