"""What becomes of the nodes that a command has started: their processes, and what they say of themselves."""

from __future__ import annotations

from collections.abc import Mapping

from tbm_gsa.app.cli.output import notes
from tbm_gsa.app.cli.processes import NodeCommand, NodeProcesses
from tbm_msgs_py.topics import status_name


class Supervision:
    """Prints a line when a node is not as it should be, and when it is again.

    Parameters
    ----------
    processes : NodeProcesses
    diagnostics : mapping of str to (level, text, values)
        What has come on `/diagnostics`, by the name of the status.
    """

    def __init__(self, processes: NodeProcesses, diagnostics: Mapping[str, tuple[int, str, Mapping[str, str]]]) -> None:
        self._processes, self._diagnostics = processes, diagnostics
        self._said: dict[str, str] = {}

    def start(self, command: NodeCommand) -> None:
        """Start a node."""
        self._processes.start(command)
        self._said[command.name] = "active"

    def check(self) -> None:
        """Print what has changed; raise `RunError` if a node has ended."""
        self._processes.check()
        for name, said in self._said.items():
            _, text, _ = self._diagnostics.get(status_name(name), (0, said, {}))
            if text != said:
                self._said[name] = text
                notes.print(f"{name}: {text}", highlight=False)
