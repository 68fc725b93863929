"""The nodes as processes of the command line: started together, watched, ended in order."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

from tbm_gsa.app.cli.output import notes
from tbm_gsa.app.nodes.start import child_command
from tbm_msgs_py.base.errors import InputError, RunError
from tbm_msgs_py.base.texts import quoted
from tbm_msgs_py.nodes.log_folder import settle_log_folder
from tbm_msgs_py.nodes.processes import ChildProcess, signals_ignored
from tbm_msgs_py.nodes.transport import DISCOVERY_RANGE, avoid_shared_memory

_GRACE_S = 2.2  # a command has 3 s to end, its nodes included
_LAST_DOMAIN = 232
_RANGES = ("LOCALHOST", "SUBNET", "SYSTEM_DEFAULT")


def settle_ros_environment() -> None:
    """Check the ROS environment, and keep messages on this computer and out of shared memory.

    For this process and all it starts, unless the environment says otherwise.

    Raises
    ------
    InputError
        A domain whose ports do not exist: the middleware ends a process on it without a word of ours. A discovery range
        within which no node finds another. No folder for log files.
    """
    domain = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not (domain.isascii() and domain.isdigit() and int(domain) <= _LAST_DOMAIN):
        raise InputError(f"environment ROS_DOMAIN_ID: {domain}, allowed: 0 to {_LAST_DOMAIN}")
    discovery = os.environ.setdefault(DISCOVERY_RANGE, "LOCALHOST")
    if discovery not in _RANGES:
        found = ", with which no node finds another" if discovery == "OFF" else ""
        raise InputError(f"environment {DISCOVERY_RANGE}: {quoted(discovery)}{found}, allowed: {', '.join(_RANGES)}")
    if moved := settle_log_folder():
        notes.print(moved, highlight=False)
    avoid_shared_memory()


@dataclass(frozen=True)
class NodeCommand:
    """A node to start.

    Attributes
    ----------
    name : str
        Of a registered node, of the log file and in messages.
    parameters : mapping
        ROS parameters.
    file : Path, optional
        Parameter file; where both name a parameter, `parameters` hold.
    module : str
        Module that is run for what is no registered node.
    """

    name: str
    parameters: Mapping[str, object] = field(default_factory=dict)
    file: Path | None = None
    module: str = ""

    def arguments(self) -> list[str]:
        """Command line of the process, which ends with the one that starts it; JSON is the YAML that ROS reads."""
        given = ["--params-file", str(self.file)] if self.file else []
        given += [
            part
            for key, value in self.parameters.items()
            for part in ("-p", f"{key}:={json.dumps(value, ensure_ascii=False)}")
        ]
        return child_command(self.module or self.name, *(["--ros-args", *given] if given else []))


class NodeProcesses:
    """Runs node processes inside a `with` block and ends exactly those.

    Parameters
    ----------
    log_folder : Path
        Gets one log file a node.
    """

    def __init__(self, log_folder: Path) -> None:
        self._folder = log_folder
        self._running: dict[str, ChildProcess] = {}

    def __enter__(self) -> Self:
        self._folder.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self, command: NodeCommand) -> None:
        """Start a node; its output goes to its log file."""
        self._running[command.name] = ChildProcess(command.arguments(), self._folder / f"{command.name}.log")

    def running(self, name: str) -> bool:
        """Whether a node is still there.

        Raises
        ------
        RunError
            It ended with an error; the message is its last line.
        """
        code = self._running[name].poll()
        if code:
            raise RunError(f"{name} ended with exit code {code}: {self._running[name].last_line()}")
        return code is None

    def check(self, ending: str = "") -> None:
        """Raise `RunError` if a node has ended, be it without an error; `ending` may have."""
        for name in self._running:
            if not self.running(name) and name != ending:
                raise RunError(f"{name} was ended from outside")

    def stop(self) -> None:
        """End every node, after a grace period with SIGKILL; a signal meanwhile changes nothing."""
        with signals_ignored():
            for process in self._running.values():
                process.request_end()
            deadline = time.monotonic() + _GRACE_S
            for process in self._running.values():
                process.end(deadline - time.monotonic())
