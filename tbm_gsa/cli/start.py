"""Start of `tbm-monitor`: a signal while the commands are still imported ends it without a word, code 130.

Nothing here may import anything that takes time.
"""

from __future__ import annotations

import os
import signal
from importlib import import_module
from types import FrameType
from typing import NoReturn

INTERRUPTED = 130
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # the last is that of a closed terminal


def main() -> None:
    """Run the command line; see `tbm_gsa.cli.main.main`."""
    for number in ENDING:
        if signal.getsignal(number) != signal.SIG_IGN:  # nohup
            signal.signal(number, _end)
    import_module("tbm_gsa.cli.main").main()


def _end(_number: int, _frame: FrameType | None) -> NoReturn:
    """End at once: nothing is begun, and threads of a half-imported library would be waited for."""
    os._exit(INTERRUPTED)
