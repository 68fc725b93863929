"""Files: texts read within bounds, files that are there whole or not at all, JSON that any reader takes."""

from __future__ import annotations

import errno
import json
import math
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from tbm_msgs_py.base.errors import InputError

LARGEST_TEXT: Final = 1 << 20
"""Bytes of a file that people write by hand, a hundred times what any shipped one has: YAML takes seconds for it."""
LARGEST_TABLE: Final = 16 << 20
"""Bytes of a table that is held in memory: a million rows and more of a schedule."""
BEGINNINGS: Final = {
    "page": b"<!DOCTYPE html>",
    "PNG picture": b"\x89PNG\r\n",
    "SVG picture": b"<?xml",
    "CSV table": b"start,start_ns,",
    "Parquet table": b"PAR1",
}
"""First bytes of each kind of result."""


def real_path(path: str | Path) -> Path:
    """Absolute path, links followed: the same whatever way leads to a file, and whether it is there or not."""
    return Path(os.path.realpath(path))


def data_folder() -> Path:
    """``tbm_monitor`` in the user's data folder (``$XDG_DATA_HOME``); a RuntimeError where the user has none."""
    data = os.environ.get("XDG_DATA_HOME")
    return (Path(data) if data else Path.home() / ".local" / "share") / "tbm_monitor"


def read_text(path: Path, encoding: str = "utf-8", largest: int = LARGEST_TEXT) -> str:
    """Text of a file of any origin, its lines ended as Unix ends them.

    Raises
    ------
    OSError
        It cannot be read, is a device or a pipe, or is larger than `largest` bytes.
    UnicodeDecodeError
        No text of this encoding.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):  # a pipe would be waited for
        raise OSError(errno.EINVAL, "no regular file", str(path))
    with path.open("rb") as file:
        data = file.read(largest + 1)
    if len(data) > largest:
        raise OSError(errno.EFBIG, f"larger than {largest >> 20} MiB", str(path))
    return data.decode(encoding).replace("\r\n", "\n").replace("\r", "\n")


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that a reader sees the old one or the new one; an OSError names this file."""
    with unfinished(path) as fresh:
        fresh.write_bytes(content)


@contextmanager
def unfinished(path: Path) -> Iterator[Path]:
    """Empty new file beside `path` that takes its place at the end of the `with` block, or goes with an error.

    Its name cannot be guessed and it is made exclusively, so that no link can stand in its way. What is at
    `path` is replaced, be it a link; what the link led to stays as it is. An OSError names `path`.
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


def write_json(path: Path, document: object) -> None:
    """Write a JSON document whole; numbers that are not finite become null."""
    write_whole(path, json_text(document, indent=1).encode())


def json_text(document: object, indent: int) -> str:
    """JSON of a document, with escapes for what a terminal would obey; numbers that are not finite become null."""
    text = json.dumps(_finite(document), indent=indent, ensure_ascii=False, allow_nan=False)
    return "".join(one if one.isprintable() or one == "\n" else json.dumps(one)[1:-1] for one in text)


def _finite(value: object) -> object:
    """Value with null for numbers that are not finite."""
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def check_result(path: Path | None, kind: str) -> None:
    """Refuse a file that must not be written, before the work that would fill it.

    Parameters
    ----------
    path : Path or None
        None where none was asked for.
    kind : str
        Key of `BEGINNINGS`. Only an earlier file of its kind is replaced.

    Raises
    ------
    InputError
        No such folder, or something else is there.
    """
    if path is None:
        return
    if not path.parent.is_dir():
        raise InputError(f"{path}: no folder {path.parent}, allowed: a file in a folder that is there")
    if (path.exists() or path.is_symlink()) and not _is_a(kind, path):
        raise InputError(f"{path}: exists already and is no {kind}, allowed: a new file, or an earlier {kind}")


def _is_a(kind: str, path: Path) -> bool:
    """Whether a file, not a link or a device, is empty or begins as one of a kind does."""
    if path.is_symlink() or not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(BEGINNINGS[kind])) in (b"", BEGINNINGS[kind])  # an empty one has nothing to lose
