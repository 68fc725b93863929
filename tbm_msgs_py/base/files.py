"""Writing of results: whole or not at all, and JSON that any reader takes."""

import json
import math
from pathlib import Path
from typing import Any

from tbm_msgs_py.base.errors import InputError


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that a reader sees the old one or the new one, never half of it.

    Raises
    ------
    OSError
        It cannot be written; the error names this file.
    """
    unfinished = path.with_name(f".{path.name}.new")
    try:
        try:
            unfinished.write_bytes(content)
            unfinished.replace(path)
        finally:
            unfinished.unlink(missing_ok=True)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def write_json(path: Path, document: Any) -> None:
    """Write a JSON document whole; numbers that are not finite become null."""
    write_whole(path, json.dumps(plain(document), indent=1, ensure_ascii=False, allow_nan=False).encode())


def plain(value: Any) -> Any:
    """Give what JSON can hold: numbers that are not finite become null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def check_folder(path: Path | None) -> None:
    """Refuse a file in a folder that is not there, before the work that would fill it."""
    if path is not None and not path.parent.is_dir():
        raise InputError(f"{path}: no folder {path.parent}, allowed: a file in a folder that is there")
