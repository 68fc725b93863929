"""Where numba keeps what it has compiled, on a computer where none of its own places can be written.

It would end with "no locator available" there, as in a container of an unknown user, while it imports a module. Nothing
here may import anything that takes time.
"""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

from tbm_msgs_py.base.errors import InputError

_VARIABLE = "NUMBA_CACHE_DIR"
COMPILED = (
    "tbm_dynamics/integration",
    "tbm_dynamics/loads",
    "tbm_dynamics/loads/cutters",
    "tbm_msgs_py/bags",
    "tbm_msgs_py/recordings",
)


def settle_compiled_folder() -> None:
    """Choose a folder for this process and all it starts, and say so; numba's own choice holds where it has one.

    Raises
    ------
    InputError
        No folder can be written, not a temporary one either.
    """
    given = os.environ.get(_VARIABLE)
    packages = Path(__file__).resolve().parent.parent
    own = [packages / folder / "__pycache__" for folder in COMPILED]
    home = os.path.expanduser("~")  # noqa: PTH111 - of an unknown user it is no error
    cache = os.environ.get("XDG_CACHE_HOME") or f"{home}/.cache"
    if (given and _writable(Path(given))) or all(map(_writable, own)) or _writable(Path(cache) / "numba"):
        return
    chosen = _private_folder()
    os.environ[_VARIABLE] = str(chosen)
    sys.stderr.write(f"compiled code is kept in {chosen}, for no other folder can be written; {_VARIABLE} names one\n")


def _writable(folder: Path) -> bool:
    """Whether files can be made in a folder, which is made first, as numba does."""
    import tempfile  # noqa: PLC0415 - only where numba is needed

    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _private_folder() -> Path:
    """Folder of this user in the one for temporary files; what is in it is run, so nobody else may write there."""
    import tempfile  # noqa: PLC0415

    try:
        folder = Path(tempfile.gettempdir()) / f"tbm_monitor_compiled_{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise InputError(f"no folder for compiled code ({error.strerror}), allowed: {_VARIABLE} names one") from None
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise InputError(f"{folder}: not a folder of this user alone, allowed: {_VARIABLE} names one for compiled code")
    return folder
