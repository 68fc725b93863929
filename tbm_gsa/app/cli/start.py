"""Start of `tbm-monitor`: a signal while the commands are still imported ends it without a word.

Nothing here may import anything that takes time.
"""

from __future__ import annotations

import sys
from importlib import import_module

from tbm_msgs_py.nodes.processes import exit_at_once, handle_signals

# These go on until a signal ends them: for them a signal is the usual end, for others a job cut short.
_UNTIL_TOLD = sys.argv[1:2] == ["run"] or sys.argv[1:3] in (["bag", "record"], ["bag", "play"])
INTERRUPTED = 0 if _UNTIL_TOLD else 130


def main() -> None:
    """Run the command line; see `tbm_gsa.app.cli.main.main`."""
    handle_signals(exit_at_once(INTERRUPTED))
    import_module("tbm_gsa.app.cli.main").main()
