"""What a ROS parameter file says of the nodes that a command starts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_msgs_py.base.strict_yaml import read_yaml
from tbm_msgs_py.topics import NAMESPACE

_PARAMETERS = "ros__parameters"


class Site:
    """Reads single values; the nodes themselves read the file as a whole.

    Parameters
    ----------
    file : Path, optional
        Parameter file; without one nothing is stated. An attribute, too.

    Raises
    ------
    StudyError
        Not a YAML file of nodes and their parameters.
    """

    def __init__(self, file: Path | None) -> None:
        self.file = file
        self._content: Mapping[str, Any] = {}
        if file is not None:
            self._content = read_yaml(file, f"nodes with {_PARAMETERS}", error=StudyError)

    def stated(self, node: str, name: str) -> Any:
        """Value of a parameter of a node; None where the file does not name it. The last entry holds, as in ROS."""
        found = None
        for parameters in _entries(self._content, _parts(f"{NAMESPACE}/{node}")):
            value: Any = parameters
            for part in name.split("."):
                value = value.get(part) if isinstance(value, dict) else None
            value = parameters.get(name, value)
            found = found if value is None else value
        return found

    def common(self, nodes: Iterable[str], name: str, default: str) -> str:
        """Value of a parameter that all of these nodes have to share."""
        given = {node: self.stated(node, name) or default for node in nodes}
        if len(set(given.values())) > 1:
            listed = ", ".join(f"{value} of {node}" for node, value in given.items())
            raise StudyError(f"{self.file}: {name}: {listed}; allowed: one for all of them")
        return str(next(iter(given.values())))


def _entries(content: Mapping[str, Any], path: list[str]) -> Iterator[Mapping[str, Any]]:
    """Parameters of every entry that a node's path matches: `*` is one part of it, `**` any number of them."""
    for key, value in content.items():
        if not isinstance(value, dict):
            continue
        if key == _PARAMETERS:
            if not path:
                yield value
            continue
        for rest in _rests(_parts(str(key)), path):
            yield from _entries(value, rest)


def _parts(name: str) -> list[str]:
    return [part for part in name.split("/") if part]


def _rests(pattern: list[str], path: list[str]) -> Iterator[list[str]]:
    """Give what may be left of a path after a pattern."""
    if not pattern:
        yield path
    elif pattern[0] == "**":
        for taken in range(len(path) + 1):
            yield from _rests(pattern[1:], path[taken:])
    elif path and pattern[0] in ("*", path[0]):
        yield from _rests(pattern[1:], path[1:])
