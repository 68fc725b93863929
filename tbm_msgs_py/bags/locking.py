"""A folder claimed by the process that writes into it."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path


def lock(folder: Path) -> int | None:
    """Claim a folder until the returned descriptor is closed, be it by the death of the process.

    Returns
    -------
    int or None
        Open descriptor; None when somebody else has the folder.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor
