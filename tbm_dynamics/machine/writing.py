"""Machine files with values changed: comments, order and formats of numbers stay as they were written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import StringIO
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from tbm_dynamics.machine.description import MachineDescription
from tbm_dynamics.machine.inputs import Place, changed_values, set_values
from tbm_dynamics.machine.loading import described_by, machine_text
from tbm_dynamics.machine.machine import Machine
from tbm_msgs_py.base.errors import MachineError
from tbm_msgs_py.base.validation import validated


def edited_text(text: str, values: Mapping[Place, float | str], source: str) -> str:
    """Text of a machine file with values changed.

    Parameters
    ----------
    text : str
        Of a valid machine file.
    values : mapping of tuple to float or str
        New values.
    source : str
        That of every entry in which a number changes.

    Raises
    ------
    MachineError
        A text in which one place stands for several (anchors and aliases), or that is no YAML 1.2.
    """
    before = described_by(text, "machine file")
    data = before.model_dump(mode="json")
    set_values(data, values, source)
    yaml = YAML()
    yaml.preserve_quotes, yaml.width = True, 1 << 20  # a line stays one
    yaml.indent(mapping=2, sequence=4, offset=2)
    stream = StringIO()
    try:
        document = yaml.load(text)
        formatted = {
            place: value if isinstance(value, str) else yaml.load(_short(value)) for place, value in values.items()
        }
        set_values(document, formatted, source)
        yaml.dump(document, stream)
    except YAMLError as error:
        raise MachineError(
            f"{before.name}: cannot be changed: {' '.join(str(getattr(error, 'problem', error)).split())}"
        ) from None
    written = stream.getvalue()
    if described_by(written, before.name) != validated(MachineDescription, data, before.name, MachineError):
        raise MachineError(f"{before.name}: cannot be changed: write out what its aliases (*) stand for")
    return written


def _short(number: float) -> str:
    """Shortest text of a number: 7e+08 rather than 700000000.0."""
    return text if float(text := f"{number:g}") == number else repr(number)


def updated_text(machine: Machine, inputs: Mapping[str, float], name: str, reasons: Sequence[str]) -> str:
    """Text of a machine's file with inputs changed, under a name of its own; changed entries have the source `updated`.

    Parameters
    ----------
    machine : Machine
        As it was loaded.
    inputs : mapping of str to float
        As for `Machine.with_inputs`.
    name : str
    reasons : sequence of str
        Comments at its head.

    Raises
    ------
    MachineError
        Inputs, or a name, that the machine does not allow; a file that cannot be read or changed.
    """
    machine.with_inputs(**inputs)
    values: dict[Place, float | str] = {**changed_values(machine.base, inputs), ("name",): name}
    cutters = machine.base.cutters
    if cutters and (layout := Path(machine.origin).parent / cutters.layout).is_file():
        values["cutters", "layout"] = str(layout.resolve())  # it stays beside the file that it came with
    comments = "".join(f"# {' '.join(reason.split())}\n" for reason in reasons)
    return comments + edited_text(machine_text(machine.origin), values, "updated")
