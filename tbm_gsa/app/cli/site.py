"""Single values of a ROS parameter file, for a command that starts the nodes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.strict_yaml import read_yaml
from tbm_msgs_py.topics import NAMESPACE

_PARAMETERS = "ros__parameters"
_WILDCARDS = {"*": "/[^/]+", "**": "(/[^/]+)*"}


class Site:
    """Reads single values; the nodes themselves read the file as a whole.

    Parameters
    ----------
    file : Path, optional
        Parameter file; without one nothing is stated. An attribute, too.

    Raises
    ------
    InputError
        Not a YAML file of nodes and their parameters.
    """

    def __init__(self, file: Path | None) -> None:
        self.file = file
        self._content: Mapping[str, object] = {}
        if file is not None:
            self._content = read_yaml(file, f"nodes with {_PARAMETERS}")

    def stated(self, node: str, name: str) -> object:
        """Value of a parameter of a node; None where the file does not name it. The last entry holds, as in ROS."""
        found = None
        for pattern, parameters in _entries(self._content):
            if re.fullmatch(pattern, f"{NAMESPACE}/{node}"):
                value = parameters.get(name, _nested(parameters, name.split(".")))
                found = found if value is None else value
        return found

    def common(self, nodes: Iterable[str], name: str, default: str) -> str:
        """Value of a parameter that all of these nodes have to share."""
        given = {node: self.stated(node, name) or default for node in nodes}
        if len(set(given.values())) > 1:
            listed = ", ".join(f"{value} of {node}" for node, value in given.items())
            raise InputError(f"{self.file}: {name}: {listed}; allowed: one for all of them")
        return str(next(iter(given.values())))


def _entries(content: Mapping[str, object], path: str = "") -> Iterator[tuple[str, Mapping[str, object]]]:
    """Parameters with the pattern of the nodes that they are of: `*` is one part of a name, `**` any number of them."""
    for key, value in content.items():
        if key == _PARAMETERS and isinstance(value, dict):
            yield path, value
        elif isinstance(value, dict):
            parts = (_WILDCARDS.get(part, f"/{re.escape(part)}") for part in str(key).split("/") if part)
            yield from _entries(value, path + "".join(parts))


def _nested(parameters: object, names: Iterable[str]) -> object:
    for name in names:
        parameters = parameters.get(name) if isinstance(parameters, dict) else None
    return parameters
