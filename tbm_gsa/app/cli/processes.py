"""The nodes as processes of the command line: started together, watched, ended in order."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

from tbm_dynamics.integration import DEFAULT_STEP
from tbm_gsa.app.cli.output import notes
from tbm_gsa.app.nodes.start import child_command
from tbm_msgs_py import topics
from tbm_msgs_py.base.errors import InputError, NodeFailure, RunError
from tbm_msgs_py.base.texts import quoted
from tbm_msgs_py.nodes.guarding import FAILING
from tbm_msgs_py.nodes.log_folder import settle_log_folder
from tbm_msgs_py.nodes.processes import ChildProcess, LogLines, signals_ignored
from tbm_msgs_py.nodes.transport import DISCOVERY_RANGE, avoid_shared_memory

_GRACE_S = 2.2  # a command has 3 s to end, its nodes included
_LAST_DOMAIN = 232
_RANGES = ("LOCALHOST", "SUBNET", "SYSTEM_DEFAULT")
_LOG_HEAD = re.compile(r"\[\w+\] \[[\d.]+\] \[[\w.]+\]: ")  # level, time and node of a line
_OF_PARAMETER = re.compile(r"parameters? (\S+):")
_FAULT = 1  # exit code of a node that failed, where a bad argument or parameter has 2


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


class _Node:
    """A node that was started, and its log, which messages name if it stays."""

    def __init__(self, command: NodeCommand, log: Path, kept: bool) -> None:
        self._command, self._place = command, f"; its log: {log}" if kept else ""
        self._lines = LogLines(log)
        self.log = log
        self.process = ChildProcess(command.arguments(), log)

    def running(self) -> bool:
        """Whether it is still there; see `NodeProcesses.running`."""
        code = self.process.poll()
        fatal = (line for line in self._lines.new() if line.startswith("[FATAL]") and FAILING in line)
        failing, name = next(fatal, ""), self._command.name
        if code == _FAULT:
            raise NodeFailure(f"{name} ended with exit code {code}: {self._reason()}{self._place}")
        if code:
            raise RunError(f"{name} ended with exit code {code}: {self._reason()}")
        if failing:
            raise NodeFailure(f"{name}: {_LOG_HEAD.sub('', failing)}{self._place}")
        return code is None

    def _reason(self) -> str:
        """Last line of its log; the parameter file before the name of a parameter that stands in it."""
        line = _LOG_HEAD.sub("", self.process.last_line())
        named = _OF_PARAMETER.match(line)
        ours = named is None or named[1] in self._command.parameters
        return line if ours or self._command.file is None else f"{self._command.file}: {line}"


class NodeProcesses:
    """Runs node processes inside a `with` block and ends exactly those.

    Parameters
    ----------
    log_folder : Path
        Gets one log file a node.
    kept : bool
        Whether they stay, so that messages name them.
    """

    def __init__(self, log_folder: Path, *, kept: bool = True) -> None:
        self._folder, self._kept = log_folder, kept
        self._running: dict[str, _Node] = {}

    def __enter__(self) -> Self:
        self._folder.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self, command: NodeCommand) -> None:
        """Start a node; its output goes to its log file."""
        self._running[command.name] = _Node(command, self._folder / f"{command.name}.log", self._kept)

    def log(self, name: str) -> Path:
        """Log file of a node."""
        return self._running[name].log

    def running(self, name: str) -> bool:
        """Whether a node is still there.

        Raises
        ------
        RunError
            It ended with an error; the message is its last line.
        NodeFailure
            It failed, or goes on and does no work.
        """
        return self._running[name].running()

    def check(self, ending: str = "") -> None:
        """Raise `RunError` if a node has ended, be it without an error; `ending` may have."""
        for name in self._running:
            if not self.running(name) and name != ending:
                raise RunError(f"{name} was ended from outside")

    def stop(self) -> None:
        """End every node, after a grace period with SIGKILL; a signal meanwhile changes nothing."""
        with signals_ignored():
            for node in self._running.values():
                node.process.request_end()
            deadline = time.monotonic() + _GRACE_S
            for node in self._running.values():
                node.process.end(deadline - time.monotonic())


def load_rates(time_step: float) -> dict[str, object]:
    """Parameters of the load node for a time step (s): none for the usual one, else blocks as long as usual."""
    if time_step == DEFAULT_STEP:
        return {}
    rate = float(round(1.0 / time_step))
    return {"block_rate": rate, "block_samples": round(rate * topics.LOAD_BLOCK_SAMPLES / topics.LOAD_BLOCK_RATE)}


def received_rate(loads: Mapping[str, object]) -> dict[str, object]:
    """Parameter of the dynamics node that goes with those of the load node."""
    return {"load_rate": loads["block_rate"]} if "block_rate" in loads else {}
