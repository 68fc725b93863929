"""Where a node writes: as its start states; set over ROS, where any node may set it, below a root only."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from tbm_msgs_py.nodes.parameters import DATA_ROOT, ParameterError


def check_below(name: str, path: str, roots: Iterable[str]) -> None:
    """Refuse a path outside of some folders, wherever its links and its ``..`` lead.

    Parameters
    ----------
    name : str
        Of the parameter.
    path : str
    roots : iterable of str
        Folders, not all of which need to be there.

    Raises
    ------
    ParameterError
        It is outside.
    """
    real = _real(name, path)
    allowed = [_real(name, root) for root in roots if root]
    if not any(real.is_relative_to(root) for root in allowed):
        raise ParameterError(
            f"parameter {name}: {path}, allowed while the node runs: below {' or '.join(map(str, allowed))} "
            f"(another folder is stated at the start: {name} or {DATA_ROOT})"
        )


def _real(name: str, path: str) -> Path:
    try:
        return Path(path).resolve()
    except (OSError, ValueError, RuntimeError) as error:  # links in a circle, a zero byte
        raise ParameterError(f"parameter {name}: {path}: {error}, allowed: a path") from None
