"""A history opened to read and for nothing else: that of another user, of a service, on a disk that takes no writes."""

import sqlite3
import stat
import time
from pathlib import Path
from typing import Final

from tbm_gsa.history.queries import Queries
from tbm_gsa.history.schema import (
    LOOK_S,
    NO_ACCESS,
    SCHEMA_VERSION,
    HistoryError,
    HistoryLockedError,
    primary_code,
    unusable,
    version_of,
)

WAIT_S: Final = 5.0  # for a program that holds the file locked
SETTLE_S: Final = 0.5  # for the log and its index, which other programs make and remove one after the other
WRITTEN_BY: Final = "`compare` and the analysis node write one"


def check_file(path: Path) -> None:
    """Refuse a history that is not there, is no file, or may not be read."""
    try:
        regular = stat.S_ISREG(path.stat().st_mode)
        if regular:
            path.open("rb").close()
    except (FileNotFoundError, NotADirectoryError):
        regular = False
    except OSError as error:
        raise HistoryError(f"{path}: {error.strerror}, allowed: a file that may be read") from None
    if not regular:
        raise HistoryError(f"{path}: no such history; {WRITTEN_BY}")


class HistoryReader(Queries):
    """An open history that is only read: nothing is written, created or brought up to date, not beside the file either.

    SQLite keeps what was written last in a second file, ``-wal``, and reads it through a third, ``-shm``. Both are
    there while a program has the history open, and after one was killed; otherwise the file is whole by itself. SQLite
    would make both even to read, which another user often may not, or leave files behind that the owner may not write:
    a file that is whole is read without them. No lock holds it then, so closing looks whether it was written meanwhile.

    Parameters
    ----------
    path : Path
    wait_s : float
        Longest wait for a program that holds it locked, s.

    Raises
    ------
    HistoryError
        No file, no history, of an older or newer version, or not to be read; at the end, one that was written while it
        was read as a whole.
    """

    def __init__(self, path: Path, wait_s: float = WAIT_S) -> None:
        check_file(path)
        deadline = time.monotonic() + SETTLE_S
        while True:
            log = path.with_name(f"{path.name}-wal").exists()
            self._whole = None if log else _state(path)
            how = "mode=ro&readonly_shm=1" if log else "immutable=1"
            uri = f"{path.absolute().as_uri()}?{how}"
            super().__init__(path, sqlite3.connect(uri, timeout=wait_s, isolation_level=None, uri=True))
            try:
                self._begin()
            except sqlite3.DatabaseError as error:
                self._connection.close()
                if primary_code(error) not in NO_ACCESS:
                    raise unusable(path, error) from None
                if time.monotonic() > deadline:
                    raise _unreadable(path) from None
                time.sleep(LOOK_S)  # another program opens or closes it: one of the files is there without the other
            except HistoryError:
                self._connection.close()
                raise
            else:
                return

    def _begin(self) -> None:
        """Check the version; all that follows reads the state that the file has now."""
        self._connection.execute("BEGIN")
        _check_version(self.path, version_of(self.path, self._connection))

    def close(self) -> None:
        """Close the file.

        Raises
        ------
        HistoryLockedError
            What was read is no state that the file was ever in.
        """
        super().close()
        if self._whole is not None and _state(self.path) != self._whole:
            raise HistoryLockedError(f"{self.path}: another program wrote to it meanwhile; try again")


def _state(path: Path) -> tuple[int, int, int]:
    """Inode, size and time of a file: one changes when it is written or replaced."""
    try:
        found = path.stat()
    except OSError:
        return 0, 0, 0
    return found.st_ino, found.st_size, found.st_mtime_ns


def _check_version(path: Path, version: int) -> None:
    if version == 0:
        raise HistoryError(f"{path}: an empty file, no history yet; {WRITTEN_BY}")
    if version < SCHEMA_VERSION:
        raise HistoryError(
            f"{path}: schema version {version}, allowed to read: {SCHEMA_VERSION}; "
            "`compare` or the analysis node of its owner brings it up to date when it writes to it"
        )


def _unreadable(path: Path) -> HistoryError:
    """Error of a log that cannot be read; SQLite's own words for it say nothing."""
    names = f"{path.name}-wal and {path.name}-shm"
    return HistoryError(f"{path}: what was written last is in {names}, allowed: both beside it, and to read both")
