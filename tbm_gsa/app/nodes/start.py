"""Start of a process of the monitor: SIGINT and SIGTERM end it cleanly from the first moment, while it still imports.

`python -m tbm_gsa.app.nodes.start [--with-parent] <node or module> …`, or an executable of the name of a node. Nothing
here may import anything that takes time: with it the process would die of a signal, or show a traceback, until the
module has taken over.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from tbm_gsa.compiled import settle_compiled_folder
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.nodes.processes import end_with_parent, exit_at_once, handle_node_signals, leave
from tbm_msgs_py.nodes.registry import NODES

_WITH_PARENT = "--with-parent"


def child_command(start: str, *arguments: str) -> list[str]:
    """Command line of a child process that runs a node or the main function of a module."""
    return [sys.executable, "-m", "tbm_gsa.app.nodes.start", _WITH_PARENT, start, *arguments]


def main() -> NoReturn:
    """Start the node that the executable is named after, or the node or module that the first argument names.

    With ``--with-parent`` before it, stdin is a pipe that the parent holds open, and the process ends with it.
    """
    handle_node_signals(exit_at_once(0))
    if sys.argv[1:2] == [_WITH_PARENT]:
        del sys.argv[1]
        end_with_parent()
    try:
        settle_compiled_folder()
    except InputError as error:
        sys.exit(str(error))
    name = Path(sys.argv[0]).name
    if name not in NODES:
        name = sys.argv.pop(1)
    if name not in NODES:
        sys.exit(import_module(name).main())
    node = getattr(import_module(NODES[name].module), NODES[name].class_name)
    leave(import_module("tbm_msgs_py.nodes.running").run_node(node))  # by name, as the node: it takes time


if __name__ == "__main__":
    main()
