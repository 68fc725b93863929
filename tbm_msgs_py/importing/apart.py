"""Import in a process of its own: a damaged file may crash the library that reads it, and only that process with it."""

from __future__ import annotations

import shutil
import signal
import sys
from collections.abc import Sequence
from glob import escape
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

from tbm_msgs_py.bags.writing import bare_label
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.importing.convert import Imported, import_recording
from tbm_msgs_py.importing.description import Description

CRASHING = (".mat", ".mf4")  # formats whose libraries end with a segmentation fault on some damaged files


def import_apart(path: Path | Sequence[Path], description: Description, out: Path) -> Imported:
    """Do `import_recording` in a process of its own; a crash of it is a `RecordingError`, and leaves nothing behind."""
    if out.exists():
        raise RecordingError(f"{out}: exists already, allowed: a new name")
    context = get_context("spawn")
    receiving, sending = context.Pipe(duplex=False)
    child = context.Process(target=_import, args=(sending, path, description, out), daemon=True)
    child.start()
    sending.close()
    result: Imported | RecordingError | None = None
    try:
        result = receiving.recv()
    except EOFError:
        names = path if isinstance(path, Path) else ", ".join(map(str, path))
        raise RecordingError(
            f"{names}: the library that reads it crashed, allowed: a file that is not damaged"
        ) from None
    finally:
        child.kill()
        child.join()
        if result is None:  # one that was refused has removed what it made, and `out` may be another's
            shutil.rmtree(out, ignore_errors=True)
            for left in out.parent.glob(f".{escape(bare_label(out, child.pid or 0))}*{out.suffix}"):
                left.unlink(missing_ok=True)
    if isinstance(result, RecordingError):
        raise result
    return result


def _import(answer: Connection, path: Path | Sequence[Path], description: Description, out: Path) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this process
    # asammdf closes what it could not open as well, with a traceback for every such object.
    sys.unraisablehook = lambda _: None
    try:
        answer.send(import_recording(path, description, out))
    except RecordingError as error:
        answer.send(error)
