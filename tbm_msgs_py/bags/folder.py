"""A recording on disk: the files of a rosbag2 folder or a bare file, and a folder claimed by its writer."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import NamedTuple

from tbm_msgs_py.bags import metadata
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.texts import quoted

ALLOWED = "a rosbag2 folder, or a .mcap or .db3 file, either of them as it is or .zstd"
_STORAGES = {"mcap": ".mcap", "sqlite3": ".db3"}
_PACKED = ".zstd"


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
        return _filled([path], None, "")
    names, declared, problem = _stated(path)
    found = {name: _there(path, name) for name in names}
    files = [file for file in found.values() if file]
    if missing := [name for name, file in found.items() if not file]:
        problem = f"{path / missing[0]}: named by {metadata.FILE_NAME} and not there, allowed: every file that it names"
    if not files:
        of_storage = [_of(path, suffix) for suffix in _STORAGES.values()]
        files = next((found for found in of_storage if found), [])
        if all(of_storage):  # one is likely the other, converted
            problem = problem or f"{of_storage[1][0]}: beside MCAP files, and not read"
    if not files:
        raise RecordingError(problem or f"{path}: no recording in this folder, allowed: {ALLOWED}")
    return _filled(files, declared, problem)


def _there(folder: Path, name: str) -> Path | None:
    """File of a name of the metadata: itself, or as somebody unpacked or packed it afterwards."""
    other = name.removesuffix(_PACKED) if name.endswith(_PACKED) else name + _PACKED
    return next((file for file in (folder / name, folder / other) if file.is_file()), None)


def _of(folder: Path, suffix: str) -> list[Path]:
    """Files of a storage, each once, in the order of their numbers."""
    plain = set(folder.glob(f"*{suffix}"))
    packed = {file for file in folder.glob(f"*{suffix}{_PACKED}") if file.with_suffix("") not in plain}
    return sorted(plain | packed, key=lambda file: (len(file.name.removesuffix(_PACKED)), file.name))


def _filled(files: list[Path], declared: int | None, problem: str) -> Files:
    empty = [file for file in files if not file.stat().st_size]
    if empty and (len(empty) == len(files) or not problem):
        problem = f"{empty[0]}: the file is empty, allowed: {ALLOWED}"
    if len(empty) == len(files):
        raise RecordingError(problem)
    return Files([file for file in files if file not in empty], declared, problem)


def _stated(folder: Path) -> tuple[list[str], int | None, str]:
    """Names of the files and number of messages by the metadata, and what is wrong with them."""
    file = folder / metadata.FILE_NAME
    if not file.is_file():
        return [], None, ""
    try:
        content = metadata.read(folder)
        storage, compression = content["storage_identifier"], str(content.get("compression_mode") or "none")
        codec = str(content.get("compression_format"))
        names = [Path(name).name for name in content.get("relative_file_paths") or []]
        count = content.get("message_count")
    except RecordingError as error:
        return [], None, str(error)
    except (KeyError, TypeError, ValueError) as error:
        return [], None, f"{file}: {type(error).__name__} at {error}, allowed: metadata as rosbag2 writes them"
    names = [name for name in names if name and "\0" not in name]
    if storage not in _STORAGES:
        raise RecordingError(f"{file}: storage_identifier {quoted(storage)}, allowed: {', '.join(_STORAGES)}")
    if compression.lower() in ("file", "message") and codec != "zstd":
        raise RecordingError(
            f"{file}: compression_format {quoted(codec)} of compression_mode {compression}, allowed: zstd"
        )
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
