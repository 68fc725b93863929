"""A recording on disk: the files of a rosbag2 folder or a bare `.mcap`, and a folder claimed by its writer."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import NamedTuple

from tbm_msgs_py.bags import metadata
from tbm_msgs_py.base.errors import RecordingError

ALLOWED = "a rosbag2 folder with MCAP files or a .mcap file"


class Files(NamedTuple):
    """Files of a recording in order.

    Attributes
    ----------
    paths : list of Path
        Those that are there.
    declared : int or None
        Message count that the metadata state.
    problem : str
        What is wrong with the metadata, empty when nothing is.
    """

    paths: list[Path]
    declared: int | None
    problem: str


def find_files(path: Path) -> Files:
    """Find the files of a recording; metadata that are damaged, or that name files that are not there, are a problem
    and no error as long as a file is left.
    """  # noqa: D205
    try:
        return _find_files(path)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}, allowed: {ALLOWED}") from error


def _find_files(path: Path) -> Files:
    if not path.exists():
        raise RecordingError(f"{path}: no such file or folder, allowed: {ALLOWED}")
    if not path.is_dir():
        return Files(_filled([path]), None, "")
    names, declared, problem = _stated(path)
    files = [file for file in (path / name for name in names) if file.is_file()]
    if missing := [name for name in names if not (path / name).is_file()]:
        problem = f"{path / missing[0]}: named by {metadata.FILE_NAME} and not there, allowed: every file that it names"
    if not files:
        files = sorted(path.glob("*.mcap"), key=lambda file: (len(file.name), file.name))
    if not files and any(path.glob("*.db3")):
        raise RecordingError(f"{path}: rosbag2 with SQLite storage, allowed: MCAP, as `ros2 bag convert` writes it")
    if not files:
        raise RecordingError(problem or f"{path}: no .mcap file in this folder, allowed: {ALLOWED}")
    return Files(_filled(files), declared, problem)


def _filled(files: list[Path]) -> list[Path]:
    filled = [file for file in files if file.stat().st_size]
    if not filled:
        raise RecordingError(f"{files[0]}: the file is empty, allowed: {ALLOWED}")
    return filled


def _stated(folder: Path) -> tuple[list[str], int | None, str]:
    """Names of the files and number of messages by the metadata, and what is wrong with them."""
    file = folder / metadata.FILE_NAME
    if not file.is_file():
        return [], None, ""
    try:
        content = metadata.read(folder)
        storage, compression = content["storage_identifier"], content.get("compression_mode")
        names = [Path(name).name for name in content.get("relative_file_paths") or []]
        count = content.get("message_count")
    except RecordingError as error:
        return [], None, str(error)
    except (KeyError, TypeError, ValueError) as error:
        return [], None, f"{file}: {type(error).__name__} at {error}, allowed: metadata as rosbag2 writes them"
    if storage == "sqlite3":
        raise RecordingError(f"{file}: storage_identifier {storage}, allowed: mcap (convert with `ros2 bag convert`)")
    if isinstance(compression, str) and compression.lower() in ("file", "message"):
        raise RecordingError(f"{file}: compression_mode {compression}, allowed: none (MCAP chunks may be zstd or lz4)")
    names = [name for name in names if name and "\0" not in name]
    return names, count if isinstance(count, int) and count > 0 else None, ""


def lock(folder: Path) -> int | None:
    """Open descriptor that claims a folder until it is closed, be it by the death of the process.

    None when another process has the folder.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor
