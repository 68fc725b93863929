"""Libraries that only the import of some formats needs."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from tbm_msgs_py.bags.errors import RecordingError

EXTRA = "import"


def library(name: str) -> ModuleType:
    """Import a library by name; where it is missing, say in one line what installs it."""
    try:
        return import_module(name)
    except ImportError as error:
        raise RecordingError(
            f"{name.partition('.')[0]} is not installed ({error}), needed for this format: "
            f"pip install 'tbm_monitor[{EXTRA}]'"
        ) from error
