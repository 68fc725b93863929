"""A bag node as a command: it runs to its end or to a signal, its log goes to stderr."""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from tbm_gsa.app.cli.output import notes
from tbm_gsa.app.cli.processes import NodeCommand, NodeProcesses, settle_ros_environment
from tbm_gsa.reading import Part
from tbm_msgs_py.base.errors import RunError
from tbm_msgs_py.nodes.processes import record_signals

_LOOK_S = 0.1
_Summary = TypeVar("_Summary", bound=Part)
_LOG_HEAD = re.compile(r"\[\w+\] \[[\d.]+\] \[[\w.]+\]: ")  # level, time and node of a line
_FAULTS = ("[ERROR]", "[FATAL]")  # printed once, by the error that ends the command


def run_to_end(command: NodeCommand, form: type[_Summary]) -> _Summary | None:
    """Run a node to its end, or until Ctrl-C or SIGTERM ends it in order.

    Returns
    -------
    Part, optional
        What the node writes, in the given form, to the file of its parameter `summary`; None when it ended before it
        had begun.

    Raises
    ------
    RunError
        It ended with an error; the message is its last line.
    """
    settle_ros_environment()
    stopping = record_signals()
    with tempfile.TemporaryDirectory(prefix="tbm_monitor.") as name:
        folder = Path(name)
        summary, log = folder / "summary.json", folder / f"{command.name}.log"
        try:
            _follow(replace(command, parameters={**command.parameters, "summary": str(summary)}), log, stopping)
        except RunError as error:
            raise RunError(_LOG_HEAD.sub("", str(error))) from error
        if summary.exists():
            return form.model_validate_json(summary.read_bytes())
    notes.print("stopped before it had begun", highlight=False)
    return None


def _follow(command: NodeCommand, log: Path, stopping: Callable[[], bool]) -> None:
    printed = 0
    with NodeProcesses(log.parent) as nodes:
        nodes.start(command)
        while nodes.running(command.name) and not stopping():
            printed = _print_log(log, printed)
            time.sleep(_LOOK_S)
    nodes.running(command.name)  # raises when its end, too, went wrong
    _print_log(log, printed)


def _print_log(log: Path, printed: int) -> int:
    """Pass on the whole lines of a log after the first `printed` characters; the number of characters read."""
    text = log.read_text(encoding="utf-8", errors="replace")
    end = text.rfind("\n") + 1
    for line in text[printed:end].splitlines():
        if not line.startswith(_FAULTS):
            notes.print(line, highlight=False)
    return max(printed, end)
