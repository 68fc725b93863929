"""Files of results: where one may be written, and JSON that any reader takes."""

import json
import math
from pathlib import Path
from typing import Any, Final

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.files import write_whole

BEGINNINGS: Final = {"page": b"<!DOCTYPE html>", "PNG picture": b"\x89PNG\r\n", "SVG picture": b"<?xml"}


def write_json(path: Path, document: Any) -> None:
    """Write a JSON document whole; numbers that are not finite become null."""
    write_whole(path, json_text(document, indent=1).encode())


def json_text(document: Any, indent: int) -> str:
    """JSON of a document, with escapes for what a terminal would obey; numbers that are not finite become null."""
    text = json.dumps(plain(document), indent=indent, ensure_ascii=False, allow_nan=False)
    return "".join(one if one.isprintable() or one == "\n" else json.dumps(one)[1:-1] for one in text)


def plain(value: Any) -> Any:
    """Give what JSON can hold: numbers that are not finite become null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def check_result(path: Path | None, kind: str) -> None:
    """Refuse a file that must not be written, before the work that would fill it.

    Parameters
    ----------
    path : Path or None
        None where none was asked for.
    kind : str
        Key of `BEGINNINGS`. What is there already is replaced by another of its kind, and by nothing else.

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
