"""A limit on what the recordings of a folder take on the disk: the oldest files go first.

Only recordings that carry the recorder's mark count and are deleted, and only such that nobody is writing; of the one
being written its finished files may go, never the file being written.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tbm_msgs_py.bags import metadata
from tbm_msgs_py.bags.errors import RecordingError
from tbm_msgs_py.bags.locking import lock
from tbm_msgs_py.bags.writing import BagWriter

MARK = {"recorder": "tbm_monitor"}
_MARK_LINE = f"recorder: {MARK['recorder']}"


@dataclass(frozen=True)
class Stored:
    """One file of a recording on the disk."""

    path: Path
    size: int
    modified_ns: int


def stored(folder: Path) -> list[Stored]:
    """Files of the marked recordings in a folder, the one written to longest ago first."""
    files = [Stored(path, at.st_size, at.st_mtime_ns) for path in _marked(folder) if (at := _stat(path))]
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
        if file.parent == writing.path:
            writing.drop(file.name)
            return True
        descriptor = lock(file.parent)
        if descriptor is None:  # another recorder is at it
            return False
        try:
            _delete_finished(file)
        finally:
            os.close(descriptor)
    except (OSError, RecordingError, KeyError, TypeError):  # the last two: its metadata is not what a recorder writes
        return False
    return True


def _delete_finished(file: Path) -> None:
    """Delete a file of a finished recording, and with its last one the recording."""
    from tbm_msgs_py.bags.bag import Bag  # noqa: PLC0415 - no recorder without a quota reads recordings

    folder = file.parent
    described = metadata.read(folder)
    if [other["path"] for other in described["files"]] == [file.name]:
        (folder / metadata.FILE_NAME).unlink()
        file.unlink()
        if not any(folder.iterdir()):
            folder.rmdir()
        return
    try:
        counts = {topic.name: count for topic, count in Bag(file).info().topics.items()}
    except RecordingError:  # damaged beyond reading: it goes nevertheless
        counts = {}
    metadata.write(folder, metadata.without_file(described, file.name, counts))
    file.unlink()


def _marked(folder: Path) -> Iterator[Path]:
    for described in folder.glob(f"*/{metadata.FILE_NAME}"):
        with suppress(OSError):  # not ours to read, or another recorder has deleted it meanwhile
            if _MARK_LINE in described.read_text(encoding="utf-8", errors="replace"):
                yield from described.parent.glob("*.mcap")


def _stat(path: Path) -> os.stat_result | None:
    """State of a file; None when another recorder has deleted it meanwhile."""
    try:
        return path.stat()
    except FileNotFoundError:
        return None
