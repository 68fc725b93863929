"""Where the shipped recording is: the source tree, or share/ of an installation."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import typer

import tbm_gsa
from tbm_msgs_py.base.files import real_path

RECORDING = "field_dz101"
STORY = "story_dz101"
"""First the rock changes, then the machine."""
RECORDING_ARGUMENT = typer.Argument(
    help=f"Recording: a rosbag2 folder, an .mcap file, or {RECORDING} or {STORY}, the shipped synthetic ones."
)

MAPPING_OPTION = typer.Option(
    help="Mapping of topics to test points; default: mapping.yaml in or beside the bag, else the contract's topics."
)


def shipped_bag(name: str = RECORDING) -> Path:
    """Folder of a recording that comes with the project.

    Raises
    ------
    FileNotFoundError
        It is in none of the places an installation has.
    """
    shares = [Path(prefix) / "share" / "tbm_monitor" for prefix in _prefixes()]
    roots = [Path(tbm_gsa.__file__).resolve().parent.parent, *shares]
    for root in roots:
        if (root / "bags" / name / "metadata.yaml").is_file():
            return root / "bags" / name
    raise FileNotFoundError(f"recording {name}: not found in {', '.join(str(root / 'bags') for root in roots)}")


def recording_path(given: Path) -> Path:
    """Absolute path, links followed, of the recording given, or a shipped one if its name is given and not there."""
    return shipped_bag(str(given)) if str(given) in (RECORDING, STORY) and not given.exists() else real_path(given)


def _prefixes() -> list[str]:
    ament = os.environ.get("AMENT_PREFIX_PATH", "")
    return [*(prefix for prefix in ament.split(os.pathsep) if prefix), sys.prefix]
