"""The signals that end a process, and child processes that end with their parent.

Nothing here may import anything that takes time: a process handles signals before it imports the rest.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import NoReturn

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # the last is that of a closed terminal
_ENDING_NODES = (signal.SIGINT, signal.SIGTERM)
_AGAIN_S = 0.25

Handler = Callable[[int, FrameType | None], object] | signal.Handlers


def handle_signals(handler: Handler) -> None:
    """Handle the signals that end a command; those that are ignored stay so, as nohup has it."""
    for number in ENDING:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


def exit_at_once(code: int) -> Handler:
    """Return a handler for the time of the imports.

    There is nothing to release yet, and an end in order would wait for threads of a half-imported library.
    """
    return lambda _number, _frame: os._exit(code)


def record_signals() -> Callable[[], bool]:
    """Record signals from now on, for good: nothing is left half-made. Returns whether there was one, as a function."""
    received: list[int] = []
    handle_signals(lambda number, _frame: received.append(number))
    return lambda: bool(received)


@contextmanager
def signals_ignored(handler: Handler = signal.SIG_IGN) -> Iterator[None]:
    """Ignore signals inside a `with` block, or handle them in another way."""
    before = {number: signal.signal(number, handler) for number in ENDING}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


@contextmanager
def signals_deferred() -> Iterator[list[int]]:
    """Defer signals to the end of a `with` block, which has them in a list.

    Raised inside rclpy they leave half-made objects that complain.
    """
    received: list[int] = []
    try:
        with signals_ignored(lambda number, _frame: received.append(number)):
            yield received
    finally:
        if received:
            signal.raise_signal(received[0])


class StartInterruption:
    """What SIGINT and SIGTERM do to a node: they break off its start, which may take long.

    While it spins the end of the context, by rclpy's own handler, is enough: an executor would log an interruption of a
    callback as a fault.
    """

    breaks_off = False  # raises where the program stands
    received = False

    @classmethod
    def begin(cls) -> None:
        """Handle signals; before rclpy does, which calls the handlers that it finds."""
        cls.received, cls.breaks_off = False, True
        sys.unraisablehook = _silent_interruptions
        handle_node_signals(cls._handle)

    @classmethod
    def _handle(cls, _number: int, _frame: FrameType | None) -> None:
        cls.received = True
        if cls.breaks_off:
            # A compiler's callback swallows what is raised in it: again, until it is raised elsewhere.
            signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
            raise KeyboardInterrupt


def handle_node_signals(handler: Handler) -> None:
    """Handle the signals that end a node, and the alarm that repeats one; only the main thread may."""
    if threading.current_thread() is threading.main_thread():
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number in (*_ENDING_NODES, signal.SIGALRM):
            signal.signal(number, handler)


def _silent_interruptions(unraisable: sys.UnraisableHookArgs) -> None:
    """Report nothing of an interruption that a library's callback has swallowed: it is raised again."""
    if unraisable.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(unraisable)


def leave(code: int) -> NoReturn:
    """End the process, which has released all that others know of.

    Python would take apart what was imported and compiled, object by object: a third of a second of work, and more than
    one on a busy computer, of the three that a command has to end in.
    """
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # its reader has gone
            stream.flush()
    os._exit(code)


def end_with_parent() -> None:
    """End this process in order when its parent is gone, however it went; stdin is a pipe that the parent holds."""

    def wait() -> None:
        while os.read(0, 1024):
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, daemon=True).start()


class LogLines:
    """Reads the lines of a log while it is written, each once.

    Parameters
    ----------
    path : Path
        It may not be there yet, or no more.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._read = path, 0

    def new(self) -> list[str]:
        """Whole lines since the last call."""
        try:
            with self._path.open("rb") as file:
                file.seek(self._read)
                whole, end, _ = file.read().rpartition(b"\n")
        except OSError:
            return []
        self._read += len(whole) + len(end)
        return whole.decode(errors="replace").split("\n") if end else []


class ChildProcess:
    """A process that calls `end_with_parent`, with a log file.

    Parameters
    ----------
    command : sequence of str
        Program and arguments.
    log : Path
        Gets what it prints.
    results : bool
        Whether stdout goes there, too.
    """

    def __init__(self, command: Sequence[str], log: Path, *, results: bool = True) -> None:
        import subprocess  # noqa: PLC0415 - not while a process starts

        self._log, self._timeout = log, subprocess.TimeoutExpired
        with log.open("wb") as file:
            # A session of its own: Ctrl-C at the terminal reaches this process only, which then ends the child.
            self._process = subprocess.Popen(  # noqa: S603 - our own command line
                command,
                stdin=subprocess.PIPE,
                stdout=file if results else subprocess.DEVNULL,
                stderr=file,
                start_new_session=True,
            )
        self.pid = self._process.pid

    def poll(self) -> int | None:
        """Exit code; None while it runs."""
        return self._process.poll()

    def request_end(self) -> None:
        """Close its pipe; this is never too early, as a signal to a Python that still starts may be."""
        if self._process.stdin:
            self._process.stdin.close()

    def end(self, seconds: float) -> None:
        """Request the end, and kill it after so many seconds."""
        self.request_end()
        try:
            self._process.wait(max(0.1, seconds))
        except self._timeout:
            self._process.kill()
            self._process.wait()

    def last_line(self) -> str:
        """Last line of its log."""
        try:
            lines = self._log.read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError as error:  # the folder is gone
            return str(error)
        return next((line.strip() for line in reversed(lines) if line.strip()), "no message")
