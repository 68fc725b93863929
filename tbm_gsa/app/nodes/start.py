"""Start of a process of the monitor: SIGINT and SIGTERM end it cleanly from the first moment, while it still imports.

`python -m tbm_gsa.app.nodes.start [--with-parent] <module> …`, or an executable of the name of a node. Nothing here may
import anything that takes time: with it the process would die of a signal, or show a traceback, until the module has
taken over.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import NoReturn

from tbm_gsa.compiled import settle_compiled_folder
from tbm_msgs_py.base.errors import InputError

# By name only: what they import takes seconds.
NODES = {
    "load_node": "tbm_dynamics.nodes.load_node",
    "dynamics_node": "tbm_dynamics.nodes.dynamics_node",
    "analysis_node": "tbm_gsa.app.nodes.analysis_node",
    "live_view": "tbm_gsa.app.nodes.live_view",
    "bag_player": "tbm_msgs_py.nodes.bag_player",
    "bag_recorder": "tbm_msgs_py.nodes.bag_recorder",
}
WITH_PARENT = "--with-parent"


def main() -> NoReturn:
    """Start the node that the executable is named after, or the module that the first argument names.

    With ``--with-parent`` before the module, stdin is a pipe that the parent holds open, and the process ends with it.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _end)
    if sys.argv[1:2] == [WITH_PARENT]:
        del sys.argv[1]
        threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        settle_compiled_folder()
    except InputError as error:
        sys.exit(str(error))
    module = NODES.get(Path(sys.argv[0]).name) or sys.argv.pop(1)
    sys.exit(import_module(module).main())


def _end(_number: int, _frame: FrameType | None) -> NoReturn:
    """End at once: there is nothing to release yet, and threads of a half-imported library would be waited for."""
    os._exit(0)


def _end_with_parent() -> None:
    """Ask for an end in order when the parent is gone, however it went."""
    while os.read(0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    main()
