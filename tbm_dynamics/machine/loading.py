"""Read a machine file; every problem becomes one line that names file, key and what is allowed."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Final

from tbm_dynamics.machine.description import MachineDescription
from tbm_msgs_py.base.errors import MachineError
from tbm_msgs_py.base.files import read_text
from tbm_msgs_py.base.strict_yaml import parse_yaml
from tbm_msgs_py.base.validation import validated

_CONTENT: Final = "a machine file"


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
    """Return the description in the text of a machine file, which messages call `label`; see `read_description`."""
    content = parse_yaml(text, label, _CONTENT, MachineDescription.model_fields, MachineError)
    return validated(MachineDescription, content, label, MachineError)


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
        raise MachineError(f"{machine}: cannot be read ({reason}), allowed: {_CONTENT}") from None
