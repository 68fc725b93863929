"""Writing of reports."""

from pathlib import Path


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that a reader sees the old one or the new one, never half of it."""
    unfinished = path.with_name(f".{path.name}.new")
    try:
        unfinished.write_bytes(content)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def check_folder(path: Path | None) -> None:
    """Refuse a file in a folder that is not there, before the work that would fill it."""
    if path is not None and not path.parent.is_dir():
        raise ValueError(f"{path}: no folder {path.parent}, allowed: a file in a folder that is there")
