"""The nodes as processes of the command line: started together, watched, ended in order."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

from tbm_gsa.app.nodes.start import WITH_PARENT
from tbm_msgs_py.base.errors import InputError, RunError
from tbm_msgs_py.nodes.transport import DISCOVERY_RANGE, avoid_shared_memory

_GRACE_S = 2.2  # a command has 3 s to end, its nodes included
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_START = "tbm_gsa.app.nodes.start"
_LAST_DOMAIN = 232

ParameterValue = bool | int | float | str | list[str]


def settle_ros_environment() -> None:
    """Check the ROS domain, and keep messages on this computer and out of shared memory.

    For this process and all it starts, unless the environment says otherwise.

    Raises
    ------
    InputError
        A domain whose ports do not exist: the middleware ends a process on it without a word of ours.
    """
    domain = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not (domain.isascii() and domain.isdigit() and int(domain) <= _LAST_DOMAIN):
        raise InputError(f"environment ROS_DOMAIN_ID: {domain}, allowed: 0 to {_LAST_DOMAIN}")
    os.environ.setdefault(DISCOVERY_RANGE, "LOCALHOST")
    avoid_shared_memory()


@dataclass(frozen=True)
class NodeCommand:
    """A node to start.

    Attributes
    ----------
    name : str
        Of the log file and in messages.
    module : str
        Python module that runs it.
    parameters : mapping
        ROS parameters.
    file : Path, optional
        Parameter file; where both name a parameter, `parameters` hold.
    """

    name: str
    module: str
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)
    file: Path | None = None

    def arguments(self) -> list[str]:
        """Command line of the process, which ends with the one that starts it."""
        given = ["--params-file", str(self.file)] if self.file else []
        given += [part for key, value in self.parameters.items() for part in ("-p", f"{key}:={_literal(value)}")]
        return [sys.executable, "-m", _START, WITH_PARENT, self.module, *(["--ros-args", *given] if given else [])]


def _literal(value: ParameterValue) -> str:
    """YAML of a parameter value; strings are quoted so that a name like `1e3` or a path stays a string."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    return repr(value)


def until_told() -> Callable[[], bool]:
    """Take note of signals from now on for good; they break off nothing, so that nothing is left half-made.

    Returns
    -------
    callable
        Whether one has come.
    """
    came: list[int] = []
    for number in _ENDING:
        if signal.getsignal(number) != signal.SIG_IGN:  # nohup
            signal.signal(number, lambda number, _frame: came.append(number))
    return lambda: bool(came)


@contextmanager
def _deaf() -> Iterator[None]:
    """Ignore what would break off the end of the nodes and leave some of them behind."""
    before = {number: signal.signal(number, signal.SIG_IGN) for number in _ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class NodeProcesses:
    """Runs node processes inside a `with` block and ends exactly those.

    Parameters
    ----------
    log_folder : Path
        Gets one log file a node.
    """

    def __init__(self, log_folder: Path) -> None:
        self._folder = log_folder
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> Self:
        self._folder.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self, command: NodeCommand) -> None:
        """Start a node; its output goes to its log file."""
        with self._log(command.name).open("wb") as log:
            # A session of its own: Ctrl-C reaches the command line only, which then ends the nodes in order. Its end
            # of the pipe closes with it, and tells them when it is killed.
            self._running[command.name] = subprocess.Popen(  # noqa: S603 - our own command line
                command.arguments(), stdin=subprocess.PIPE, stdout=log, stderr=log, start_new_session=True
            )

    def running(self, name: str) -> bool:
        """Whether a node is still there.

        Raises
        ------
        RunError
            It ended with an error; the message is its last line.
        """
        code = self._running[name].poll()
        if code:
            raise RunError(f"{name} ended with exit code {code}: {self._last_line(name)}")
        return code is None

    def check(self, ending: str = "") -> None:
        """Raise `RunError` if a node has ended, be it without an error; `ending` may have."""
        for name in self._running:
            if not self.running(name) and name != ending:
                raise RunError(f"{name} was ended from outside")

    def stop(self) -> None:
        """End every node, after a grace period with SIGKILL; a signal meanwhile changes nothing.

        A node ends when its pipe closes. That never comes too early, as a signal to a Python that still starts does.
        """
        with _deaf():
            self._stop()

    def _stop(self) -> None:
        for process in self._running.values():
            if process.stdin:
                process.stdin.close()
        deadline = time.monotonic() + _GRACE_S
        for process in self._running.values():
            try:
                process.wait(max(0.1, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"

    def _last_line(self, name: str) -> str:
        lines = self._log(name).read_text(encoding="utf-8", errors="replace").splitlines()
        return next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")
