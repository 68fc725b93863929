"""Read a machine file; every problem becomes one line that names file, key and what is allowed."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import yaml
from pydantic import ValidationError

from tbm_dynamics.machine.description import MachineDescription
from tbm_msgs_py.base.bounds import LONGEST_NAME, quoted, read_text, shortened
from tbm_msgs_py.base.errors import MachineError
from tbm_msgs_py.base.strict_yaml import strict_yaml, yaml_problem


def shipped_machines() -> list[str]:
    """Names of the machines that come with the package."""
    folder = resources.files("tbm_dynamics") / "machines"
    return sorted(item.name.removesuffix(".yaml") for item in folder.iterdir() if item.name.endswith(".yaml"))


def read_description(machine: str | Path) -> MachineDescription:
    """Read the description of a shipped machine (by name) or of a YAML file (by path).

    Raises
    ------
    MachineError
        No such machine, not YAML, or a value that is not allowed.
    """
    return described_by(machine_text(machine), str(machine))


def described_by(text: str, label: str) -> MachineDescription:
    """Return what the text of a machine file says; messages call it `label`, errors are those of `read_description`."""
    try:
        data = strict_yaml(text)
    except yaml.YAMLError as error:
        raise MachineError(f"{label}: not valid YAML: {yaml_problem(error)}") from None
    if not isinstance(data, dict) or data.keys().isdisjoint(MachineDescription.model_fields):
        raise MachineError(
            f"{label}: a machine file is a mapping with the keys {', '.join(MachineDescription.model_fields)}"
        )
    return validated(data, label)


def validated(data: object, label: str) -> MachineDescription:
    """Return the description that data are; raises MachineError with the `label` in front."""
    try:
        return MachineDescription.model_validate(data)
    except ValidationError as error:
        raise MachineError(_one_line(label, error)) from None


def machine_text(machine: str | Path) -> str:
    """Text of a shipped machine's file (by name) or of a YAML file (by path).

    Raises
    ------
    MachineError
        No such machine, or a file that cannot be read.
    """
    if str(machine) in shipped_machines():
        return (resources.files("tbm_dynamics") / "machines" / f"{machine}.yaml").read_text("utf-8")
    path = Path(machine)
    if not path.is_file():
        raise MachineError(
            f"{machine}: no such machine; shipped are {', '.join(shipped_machines())}, or give the path of a YAML file"
        )
    try:
        return read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "no UTF-8 text"
        raise MachineError(f"{machine}: cannot be read: {reason}") from None


def _one_line(label: str, error: ValidationError) -> str:
    # A misspelt key is also a missing one: the misspelling comes first.
    problems = error.errors(include_url=False)
    first, *rest = sorted(problems, key=lambda problem: problem["type"] != "extra_forbidden")
    # Tags of alternatives begin with _ and are no keys.
    place = ".".join(str(part) for part in first["loc"] if not str(part).startswith("_"))
    key = shortened(place, LONGEST_NAME) or "machine"
    given = first.get("input")
    shown = f" (given: {quoted(given)})" if isinstance(given, int | float | str) else ""
    more = f" (and {len(rest)} more)" if rest else ""
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        message, shown = f"unknown key; allowed are {', '.join(_keys_of(first['loc'][:-1]))}", ""
    return f"{label}: {key}: {message}{shown}{more}"


def _keys_of(place: tuple[int | str, ...]) -> list[str]:
    """Keys allowed in the section at a place of the machine file."""
    kinds: list[Any] = [MachineDescription]
    for part in place:
        if isinstance(part, int):
            kinds = _alternatives(get_args(kinds[0])[0])
        elif part not in kinds[0].model_fields:  # one of several, by its tag
            kinds = [kind for kind in kinds if f"_{kind.__name__.lower()}" == part]
        else:
            kinds = _alternatives(kinds[0].model_fields[part].annotation)
    return list(kinds[0].model_fields)


def _alternatives(kind: Any) -> list[Any]:
    """Types that a type stands for, other than None."""
    if get_origin(kind) is Annotated:
        return _alternatives(get_args(kind)[0])
    if get_origin(kind) in (Union, UnionType):
        return [one for part in get_args(kind) if part is not NoneType for one in _alternatives(part)]
    return [kind]
