"""The log of a process: texts of others, such as names in a recording, make no line of their own, steer no terminal."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from rclpy.impl import rcutils_logger
from rclpy.logging import LoggingSeverity

from tbm_msgs_py.base.texts import printable

# A line names the file that logs it, not this one; rclpy skips the files of that list.
rcutils_logger._internal_callers.append(__file__)


class PrintableLogger(rcutils_logger.RcutilsLogger):  # type: ignore[misc]  # rclpy is untyped
    """Logger of rclpy that shows control characters instead of handing them on; only debug texts have several lines."""

    def log(self, message: object, severity: Any, **kwargs: Any) -> bool:
        """Log a line."""
        keep = "\n" if severity == LoggingSeverity.DEBUG else ""
        return bool(super().log(printable(str(message), keep), severity, **kwargs))


@lru_cache
def get_logger(name: str) -> PrintableLogger:
    """Logger of a name."""
    return PrintableLogger(name)
