"""A bag node as a command: it runs to its end or to a signal, its log goes to stderr."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from tbm_gsa.app.cli.output import notes
from tbm_gsa.app.cli.processes import NodeCommand, NodeProcesses, settle_ros_environment
from tbm_gsa.reading import Part, read_document
from tbm_msgs_py.base.errors import NodeFailure
from tbm_msgs_py.nodes.guarding import FAILING, UNEXPECTED
from tbm_msgs_py.nodes.processes import LogLines, record_signals

_LOOK_S = 0.1
_Summary = TypeVar("_Summary", bound=Part)
_FAULTS = ("[ERROR]", "[FATAL]")  # printed once, by the error that ends the command; others do not end it


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
    NodeFailure
        It failed, or does no work; its log stays.
    """
    settle_ros_environment()
    stopping = record_signals()
    with ExitStack() as stack:
        folder = Path(tempfile.mkdtemp(prefix="tbm_monitor."))
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        summary, log = folder / "summary.json", folder / f"{command.name}.log"
        try:
            _follow(replace(command, parameters={**command.parameters, "summary": str(summary)}), log, stopping)
        except NodeFailure:
            stack.pop_all()
            raise
        if summary.exists():
            return read_document(summary, form, "the summary of a node")
    notes.print("stopped before it had begun", highlight=False)
    return None


def _follow(command: NodeCommand, log: Path, stopping: Callable[[], bool]) -> None:
    lines = LogLines(log)
    with NodeProcesses(log.parent) as nodes:
        nodes.start(command)
        while nodes.running(command.name) and not stopping():
            _print_log(lines)
            time.sleep(_LOOK_S)
    nodes.running(command.name)  # raises when its end, too, went wrong
    _print_log(lines)


def _print_log(lines: LogLines) -> None:
    """Pass on the new lines of a log, but for those of the error that ends the command."""
    for line in lines.new():
        if not line.startswith(_FAULTS) or (UNEXPECTED in line and FAILING not in line):
            notes.print(line, highlight=False)
