"""ROS parameter files, and parameters on a command line: what rclpy would pass over in them is refused by name.

ROS has every node of a computer read one file, each what is meant for it, and says nothing of the rest.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.strict_yaml import read_yaml
from tbm_msgs_py.base.texts import listed, quoted
from tbm_msgs_py.nodes.parameters import node_parameters
from tbm_msgs_py.nodes.registry import NODES
from tbm_msgs_py.topics import NAMESPACE

_PARAMETERS = "ros__parameters"
_WILDCARDS = {"*": "/[^/]+", "**": "(/[^/]+)*"}
_OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides")
"""Parameters that rclpy declares, the last a group."""


class ParameterFile:
    """Holds what a file states; the nodes read their values with rclpy.

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
        content = {} if file is None else read_yaml(file, f"nodes with {_PARAMETERS}")
        self._sections = list(_sections(content, f"{file}"))

    def check(self, name: str = "", node: str = "") -> None:
        """Refuse what no node takes.

        Parameters
        ----------
        name : str
            Absolute name of a node, which may be another than that of its executable.
        node : str
            Registered name of that node.

        Raises
        ------
        InputError
            A node that there is not, or a parameter that it does not have, or that none has where all are meant; with a
            name, entries for this node in other namespaces only, which ROS would pass over.
        """
        for path, parameters in self._sections:
            last = path.rpartition("/")[2]
            kinds = list(NODES) if last in _WILDCARDS else [last]
            if name and last not in _WILDCARDS and re.fullmatch(_pattern(path), name):
                kinds = [node]
            if kinds[0] not in NODES:
                raise InputError(f"{self.file}: {path}: unknown node, allowed: {', '.join(NODES)}, or * or ** for all")
            for key in _flat(parameters):
                _check_name(f"{self.file}: {path}", key, kinds)
        self._check_namespace(name)

    def _check_namespace(self, name: str) -> None:
        """Refuse a file that means a node by its last name, and nowhere the one of this absolute name."""
        there = [path for path, _ in self._sections if name and path.rpartition("/")[2] == name.rpartition("/")[2]]
        if there and not any(re.fullmatch(_pattern(path), name) for path in there):
            raise InputError(
                f"{self.file}: {listed(there)}: not {name}, allowed: that, or /**/{name.rpartition('/')[2]}"
            )

    def stated(self, node: str, name: str) -> object:
        """Value of a parameter of a node; None where the file does not name it. The last entry holds, as in ROS."""
        found = None
        for path, parameters in self._sections:
            if re.fullmatch(_pattern(path), f"{NAMESPACE}/{node}"):
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


class NodeArguments:
    """Parameters of a node's command line, and of the files that it names.

    Parameters
    ----------
    arguments : sequence of str

    Raises
    ------
    InputError
        A file that is no parameter file.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        given = list(_ros_options(arguments))
        self._files = [ParameterFile(Path(word)) for flag, word in given if flag == "--params-file"]
        self._names = [word.partition(":=")[0].rpartition(":")[2] for flag, word in given if flag in ("-p", "--param")]

    def check(self, name: str, node: str) -> None:
        """Refuse the first parameter that the node does not have.

        Parameters
        ----------
        name : str
            Absolute name of the node.
        node : str
            Its registered name.

        Raises
        ------
        InputError
            There is one.
        """
        for file in self._files:
            file.check(name, node)
        for given in self._names:
            _check_name("command line", given, [node])


def _ros_options(arguments: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Words that follow each other in the parts of a command line that are for ROS."""
    inside = False
    for word, following in zip(arguments, [*arguments[1:], ""], strict=True):
        if word in ("--ros-args", "--"):
            inside = word == "--ros-args"
        elif inside:
            yield word, following


def _check_name(place: str, name: str, nodes: Collection[str]) -> None:
    if name.partition(".")[0] in _OF_ROS:
        return
    known = [name for node in nodes for name in node_parameters(node)]
    if name not in known:
        raise InputError(f"{place}: {quoted(name)}: unknown parameter, allowed: {listed(known, most=40)}")


def _sections(content: Mapping[str, object], file: str, path: str = "") -> Iterator[tuple[str, Mapping[str, object]]]:
    """Parameters with the path of the nodes that they are of: `*` is one part of a name, `**` any number of them."""
    for key, value in content.items():
        place = path + "".join(f"/{part}" for part in str(key).split("/") if part)
        if str(key) != _PARAMETERS and str(key).replace("_", "") == _PARAMETERS.replace("_", ""):
            raise InputError(f"{file}: {path or '/'}: {quoted(key)}, allowed: {_PARAMETERS}, with two underscores")
        if not isinstance(value, dict):
            raise InputError(f"{file}: {path or '/'}: {quoted(key)}: no mapping, allowed: nodes with {_PARAMETERS}")
        if key == _PARAMETERS:
            yield path, value
        else:
            yield from _sections(value, file, place)


def _pattern(path: str) -> str:
    """Regular expression of the names that a path means."""
    return "".join(_WILDCARDS.get(part, f"/{re.escape(part)}") for part in path.split("/") if part)


def _flat(parameters: Mapping[str, object], group: str = "") -> Iterator[str]:
    """Names of parameters, dots for groups."""
    for name, value in parameters.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{group}{name}.")
        else:
            yield f"{group}{name}"


def _nested(parameters: object, names: Iterable[str]) -> object:
    for name in names:
        parameters = parameters.get(name) if isinstance(parameters, dict) else None
    return parameters
