"""Where ROS writes its log files: rclpy does not start without a folder for them."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from tbm_msgs_py.base.errors import InputError

_LOG_DIR, _HOME = "ROS_LOG_DIR", "ROS_HOME"


def settle_log_folder() -> str:
    """Name a folder among the temporary files where the one of ROS cannot be written.

    For this process and all it starts. Returns a line that says so; empty where the folder can be written.

    Raises
    ------
    InputError
        Neither can be written.
    """
    folder = _ros_folder()
    if _writable(folder):
        return ""
    try:
        os.environ[_LOG_DIR] = tempfile.mkdtemp(prefix="tbm_monitor.log.")
    except OSError as error:
        raise InputError(
            f"{folder}, {error.filename}: no log can be written, allowed: a folder in {_LOG_DIR}"
        ) from None
    return (
        f"{folder} cannot be written: log files of ROS are in {os.environ[_LOG_DIR]} ({_LOG_DIR} names another folder)"
    )


def _ros_folder() -> Path:
    """Folder that rcl writes to: ``$ROS_LOG_DIR``, ``$ROS_HOME/log`` or ``~/.ros/log``."""
    if stated := os.environ.get(_LOG_DIR):
        return Path(stated).expanduser()
    return Path(os.environ.get(_HOME) or Path(os.environ.get("HOME", "")) / ".ros").expanduser() / "log"


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return folder.is_absolute() and os.access(folder, os.W_OK | os.X_OK)
