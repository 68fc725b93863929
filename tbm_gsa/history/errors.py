"""What can be wrong with a history."""

import sqlite3
from pathlib import Path
from typing import Final

from tbm_msgs_py.base.errors import InputError

NO_ACCESS: Final = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY)


class HistoryError(InputError):
    """A file that is no history, or one that cannot be used; one line."""


class HistoryLockedError(HistoryError):
    """A history that another program holds locked; it may be tried again."""


def primary_code(error: sqlite3.Error) -> int:
    """Give the result code of SQLite; 0 where it gave none."""
    return int(getattr(error, "sqlite_errorcode", 0)) & 0xFF


def unusable(path: Path, error: sqlite3.Error) -> HistoryError:
    """Make the error of a file that SQLite refuses to write, or that is no history."""
    code = primary_code(error)
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return HistoryLockedError(f"{path}: {error}")
    if code in NO_ACCESS:
        return HistoryError(f"{path}: {error}, allowed: a file, in a folder, that may be written")
    return HistoryError(f"{path}: not a history of tbm_monitor that can be used ({error})")
