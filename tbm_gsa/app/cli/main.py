"""`tbm-monitor`: turns every expected error into one line and an exit code."""

from __future__ import annotations

import os
import signal
import sqlite3
import sys
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer

import tbm_gsa
from tbm_gsa.app.cli.commands import CommandLine
from tbm_gsa.app.cli.output import notes, results
from tbm_gsa.app.cli.start import INTERRUPTED
from tbm_msgs_py.base.errors import InputError, NodeFailure, RunError
from tbm_msgs_py.base.texts import shortened
from tbm_msgs_py.nodes.processes import handle_signals, leave

app = typer.Typer(
    name="tbm-monitor",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},  # of every command below, too
    pretty_exceptions_enable=False,
)


def _version(asked: bool) -> None:
    if asked:
        results.print(f"tbm-monitor {tbm_gsa.__version__}", highlight=False)
        raise typer.Exit


@app.callback(cls=CommandLine)
def group(
    version: Annotated[
        bool, typer.Option("--version", "-V", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Drive-train monitor for tunnel boring machines: model, recordings, comparison, sensitivity."""


BAD_INPUT = 2

# typer may carry a click of its own: the class is found where typer's own exceptions come from.
_UsageError: type[Exception] = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")


class _Interruption:
    """Signal handler that remembers; it raises KeyboardInterrupt where the program stands.

    A command that goes on until a signal ends it handles signals itself once it has begun; before, it ends at once.
    """

    received = False

    @classmethod
    def handle(cls, number: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        if INTERRUPTED == 0:
            os._exit(INTERRUPTED)
        cls.received = True
        signal.default_int_handler(number, frame)


def main() -> None:
    """Run the command line; exit code 0 on success, 2 on bad input, 1 on a fault of the program.

    After Ctrl-C 130, but 0 for a command that goes on until a signal ends it.
    """
    handle_signals(_Interruption.handle)  # what was started is ended in order, whichever comes
    _open_streams()
    code = _run()
    if _Interruption.received and code != 0:
        code = INTERRUPTED  # a library may have turned the interruption into an error of its own
    # Before the clean-up of the exit prints a complaint about a reader that has gone, or a full disk.
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
            if stream is sys.stdout and code == 0 and not isinstance(error, BrokenPipeError):
                _print_line(f"{stream.name}: {error.strerror}")
                code = BAD_INPUT
    if INTERRUPTED == 0:  # it is to end soon after a signal
        leave(code)
    sys.exit(code)


def _open_streams() -> None:
    """Lead streams that are closed nowhere: the next file that is opened would be taken for one of them."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
            setattr(sys, name, os.fdopen(number, "r" if name == "stdin" else "w", closefd=False))


def _run() -> int:
    """Exit code of the command, every error in one line."""
    try:
        _check_working_folder()
        # -c and -m runs have no useful argv[0]; the name users type stands in messages.
        code = app(prog_name="tbm-monitor", standalone_mode=False)
    except typer.Exit as leave:
        return leave.exit_code
    except (typer.Abort, KeyboardInterrupt):
        return INTERRUPTED
    except (BrokenPipeError, SystemExit):  # the reader of the output has gone; the second is what rich makes of it
        return 0
    except (_UsageError, OSError, sqlite3.Error, InputError, RunError, MemoryError) as error:
        _print_line(_line(error))
        return 1 if isinstance(error, NodeFailure) else BAD_INPUT
    except Exception as error:  # noqa: BLE001 - never a traceback
        _print_line(f"fault of the program: {type(error).__name__}: {error}")
        return 1
    return code if isinstance(code, int) else 0


def _check_working_folder() -> None:
    """Refuse a folder that was deleted: paths are looked up from there."""
    try:
        Path.cwd()
    except OSError as error:
        raise InputError(f"the working folder: {error.strerror}, allowed: a folder that is there") from None


def _line(error: Exception) -> str:
    """Line of an error that the user can do something about."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else f"a file or stream: {error.strerror}"
    if isinstance(error, MemoryError):
        return f"not enough memory: {error}"
    if type(error).__name__ == "NoArgsIsHelpError":  # a bare `tbm-monitor` has shown its help already
        return "a command is missing, see --help"
    line = str(getattr(error, "format_message", error.__str__)())
    context = getattr(error, "ctx", None)
    if "unexpected extra argument" in line and context is not None:
        line += f", see {context.command_path} --help"
    return line


def _print_line(message: str) -> None:
    with suppress(OSError):  # where nothing can be written the exit code is left
        notes.print(f"tbm-monitor: {shortened(' '.join(message.split()))}", highlight=False)


if __name__ == "__main__":
    main()
