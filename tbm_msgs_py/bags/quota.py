"""A limit on what the recordings of a folder take on the disk: the oldest files go first.

Only recordings that were made under a quota, say so in their metadata and are not marked to be kept count and are
deleted, and only such that no process is writing; of the one being written its finished files may go, never the current
one.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tbm_msgs_py.bags import metadata
from tbm_msgs_py.bags.folder import lock
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.base.errors import RecordingError

KEEP: Final = "keep"  # a file of this name in its folder keeps a recording, also one that is being written
_RECORDER: Final = {"recorder": "tbm_monitor"}
_QUOTA: Final = "quota"
# What stands in the metadata of a recording that may be deleted: the files are searched for it every two seconds, and
# those that have it are read before anything is deleted.
_SIGNS: Final = (f"recorder: {_RECORDER['recorder']}", f"{_QUOTA}: ")


def mark(quota: float) -> dict[str, str]:
    """Mark, as custom data, a recording that is made under a quota in MB or, with 0, without."""
    return {**_RECORDER, **({_QUOTA: f"{quota:g}"} if quota else {})}


@dataclass(frozen=True)
class Stored:
    """One file of a recording on the disk."""

    path: Path
    size: int
    modified_ns: int


def stored(folder: Path) -> list[Stored]:
    """Files of the recordings in a folder that a quota is for, the one written to longest ago first."""
    files = []
    for path in _under_quota(folder):
        with suppress(FileNotFoundError):  # another recorder has deleted it meanwhile
            at = path.stat()
            files.append(Stored(path, at.st_size, at.st_mtime_ns))
    return sorted(files, key=lambda file: (file.modified_ns, len(file.path.name), file.path.name))


def enforce(limit: float, writing: BagWriter) -> tuple[list[Stored], float]:
    """Delete the oldest files in the folder of a recording being written until the rest fits.

    Parameters
    ----------
    limit : float
        Bytes that all may take.
    writing : BagWriter
        The recording being written.

    Returns
    -------
    list of Stored
        What was deleted.
    float
        Bytes over the limit that are left, because nothing else may be deleted; 0 or less when it is kept.
    """
    files = stored(writing.path.parent)
    excess = sum(file.size for file in files) - limit
    gone = []
    for file in files:
        if excess <= 0:
            break
        if file.path != writing.current and _delete(file.path, writing):
            gone.append(file)
            excess -= file.size
    return gone, excess


def _delete(file: Path, writing: BagWriter) -> bool:
    """Delete a file; False where that may not or cannot be done, which is no reason to end the recording."""
    try:
        if (file.parent / KEEP).exists():  # meanwhile
            return False
        if file.parent == writing.path:
            writing.drop(file.name)
            return True
        descriptor = lock(file.parent)
        if descriptor is None:  # another recorder is at it
            return False
        try:
            return _delete_finished(file)
        finally:
            os.close(descriptor)
    except (OSError, RecordingError, KeyError, TypeError):  # the last two: its metadata is not what a recorder writes
        return False


def _delete_finished(file: Path) -> bool:
    """Delete a file of a finished recording, and with its last one the recording; False where it is none of its."""
    from tbm_msgs_py.bags.bag import Bag  # noqa: PLC0415 - no recorder without a quota reads recordings

    folder = file.parent
    described = metadata.read(folder)
    names, found = [other["path"] for other in described["files"]], metadata.custom_data(described)
    if file.name not in names or _QUOTA not in found or not _RECORDER.items() <= found.items():
        return False
    if names == [file.name]:
        (folder / metadata.FILE_NAME).unlink()
        file.unlink()
        if not any(folder.iterdir()):
            folder.rmdir()
        return True
    try:
        counts = {topic.name: count for topic, count in Bag(file).info().topics.items()}
    except RecordingError:  # damaged beyond reading: it goes nevertheless
        counts = {}
    metadata.write(folder, metadata.without_file(described, file.name, counts))
    file.unlink()
    return True


def _under_quota(folder: Path) -> Iterator[Path]:
    """MCAP files of the recordings beside each other; what a link leads to lies elsewhere."""
    for described in folder.glob(f"*/{metadata.FILE_NAME}"):
        recording = described.parent
        with suppress(OSError):  # not ours to read, or another recorder has deleted it meanwhile
            if recording.is_symlink() or (recording / KEEP).exists():
                continue
            text = described.read_text(encoding="utf-8", errors="replace")
            if all(sign in text for sign in _SIGNS):
                yield from (file for file in recording.glob("*.mcap") if not file.is_symlink())
