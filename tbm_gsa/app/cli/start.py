"""Start of `tbm-monitor`: a signal while the commands are still imported ends it without a word.

Nothing here may import anything that takes time.
"""

from __future__ import annotations

import os
import signal
import sys
from importlib import import_module
from types import FrameType
from typing import NoReturn

# These go on until they are told to end: for them a signal is the usual end, for others a job cut short.
_UNTIL_TOLD = sys.argv[1:2] == ["run"] or sys.argv[1:3] in (["bag", "record"], ["bag", "play"])
INTERRUPTED = 0 if _UNTIL_TOLD else 130
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # the last is that of a closed terminal


def main() -> None:
    """Run the command line; see `tbm_gsa.app.cli.main.main`."""
    for number in ENDING:
        if signal.getsignal(number) != signal.SIG_IGN:  # nohup
            signal.signal(number, _end)
    import_module("tbm_gsa.app.cli.main").main()


def _end(_number: int, _frame: FrameType | None) -> NoReturn:
    """End at once: nothing is begun, and threads of a half-imported library would be waited for."""
    os._exit(INTERRUPTED)
