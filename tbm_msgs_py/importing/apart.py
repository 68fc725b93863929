"""Import in a process of its own: a damaged file may crash the library that reads it, or have it go on for ever."""

from __future__ import annotations

import resource
import shutil
import signal
import sys
import time
from collections.abc import Callable, Sequence
from glob import escape
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

from tbm_msgs_py.bags.writing import bare_label
from tbm_msgs_py.base.errors import InputError, RecordingError
from tbm_msgs_py.importing.convert import Imported, import_recording
from tbm_msgs_py.importing.description import Description

CRASHING = (".mat", ".mf4")  # formats whose libraries end with a segmentation fault on some damaged files

CPU_S, CPU_S_PER_MB = 120.0, 10.0
"""CPU time without a message written that the process may take, and what it may take more for every MB of its files."""


def import_apart(path: Path | Sequence[Path], description: Description, out: Path) -> Imported:
    """Do `import_recording` in a process of its own.

    A crash of it, or one that goes on for ever, is a `RecordingError`, and leaves nothing behind.
    """
    if out.exists():
        raise RecordingError(f"{out}: exists already, allowed: a new name")
    context = get_context("spawn")
    receiving, sending = context.Pipe(duplex=False)
    child = context.Process(target=_import, args=(sending, path, description, out), daemon=True)
    child.start()
    sending.close()
    result: Imported | InputError | OSError | MemoryError | None = None
    try:
        result = receiving.recv()
    except EOFError:
        child.join()  # it has closed the pipe by its end
        endless = child.exitcode == -signal.SIGXCPU
        found = f"gave nothing in {_allowed_s(_listed(path)):.0f} s of CPU time" if endless else "crashed"
        names = ", ".join(map(str, _listed(path)))
        raise RecordingError(
            f"{names}: the library that reads it {found}, allowed: a file that is not damaged"
        ) from None
    finally:
        child.kill()
        child.join()
        if result is None:  # one that was refused has removed what it made, and `out` may be another's
            shutil.rmtree(out, ignore_errors=True)
            for left in out.parent.glob(f".{escape(bare_label(out, child.pid or 0))}*{out.suffix}"):
                left.unlink(missing_ok=True)
    if isinstance(result, Exception):
        raise result
    return result


def _import(answer: Connection, path: Path | Sequence[Path], description: Description, out: Path) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this process
    # asammdf closes what it could not open as well, with a traceback for every such object.
    sys.unraisablehook = lambda _: None
    renew = _limit(_allowed_s(_listed(path)))
    renew()
    try:
        answer.send(import_recording(path, description, out, lambda _: renew()))
    except (InputError, OSError, MemoryError) as error:
        answer.send(error)


def _listed(path: Path | Sequence[Path]) -> Sequence[Path]:
    return [path] if isinstance(path, Path) else path


def _allowed_s(paths: Sequence[Path]) -> float:
    """CPU time that reading these files may take, s."""
    return CPU_S + CPU_S_PER_MB * sum(path.stat().st_size for path in paths if path.is_file()) / 1e6


def _limit(seconds: float) -> Callable[[], None]:
    """Make what allows this process so many seconds of CPU time from the call on; then the kernel ends it.

    CPU time: a busy computer or a slow disk ends nothing that gets on.
    """

    def renew() -> None:
        _, most = resource.getrlimit(resource.RLIMIT_CPU)
        wanted = int(time.process_time() + seconds)
        resource.setrlimit(resource.RLIMIT_CPU, (wanted if most < 0 else min(wanted, most), most))

    return renew
