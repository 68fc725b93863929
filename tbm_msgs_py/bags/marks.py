"""What a recording says of itself in the `custom_data` of its metadata, which `ros2 bag record --custom-data` sets."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from tbm_msgs_py.bags import metadata
from tbm_msgs_py.base.errors import RecordingError

SYNTHETIC: Final = {"synthetic": "true"}


def is_synthetic(path: Path) -> bool:
    """Whether a recording says that it was computed, not measured.

    A bare file says it by the metadata beside it that name it; one by itself has no place for it.
    """
    folder = path if path.is_dir() else path.parent
    try:
        described = metadata.read(folder)
    except (RecordingError, OSError):
        return False
    own = path.is_dir() or path.name in (described.get("relative_file_paths") or [])
    return own and custom_data(described).get("synthetic", "").lower() == "true"


def custom_data(described: dict[str, Any]) -> dict[str, str]:
    """Give the custom data of a description, which may hold anything in their place."""
    found = described.get("custom_data")
    return {str(key): str(value) for key, value in found.items()} if isinstance(found, dict) else {}
