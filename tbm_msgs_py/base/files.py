"""Files that are there whole or not at all, and the folder of those that the user names no other for."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def data_folder() -> Path:
    """``tbm_monitor`` in the user's data folder (``$XDG_DATA_HOME``).

    Raises
    ------
    RuntimeError
        The user has none.
    """
    data = os.environ.get("XDG_DATA_HOME")
    return (Path(data) if data else Path.home() / ".local" / "share") / "tbm_monitor"


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that a reader sees the old one or the new one, never half of it.

    Raises
    ------
    OSError
        It cannot be written; the error names this file.
    """
    with unfinished(path) as fresh:
        fresh.write_bytes(content)


@contextmanager
def unfinished(path: Path) -> Iterator[Path]:
    """Empty new file beside `path` that takes its place at the end of the `with` block, or goes with an error.

    Its name cannot be guessed and it is made exclusively, so that nobody can have put a link in its way. What is at
    `path` is replaced, be it a link; what the link led to stays as it is.

    Raises
    ------
    OSError
        Something cannot be written; the error names `path`.
    """
    fresh = hidden_beside(path)
    try:
        fresh.open("xb").close()
        try:
            yield fresh
            fresh.replace(path)
        finally:
            fresh.unlink(missing_ok=True)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def hidden_beside(path: Path, label: str = "") -> Path:
    """Path of no file yet, in the same folder and with the same suffix, under a name that cannot be guessed."""
    return path.with_name(f".{label}{secrets.token_hex(8)}{path.suffix}")
