"""Text of a machine file with some inputs changed: every value and its source, and why it was changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from tbm_dynamics.machine.machine import Machine

UPDATED = "updated"
"""Source of a value that was changed to explain a recording."""


def machine_text(machine: Machine, inputs: Mapping[str, float], name: str, reasons: Sequence[str]) -> str:
    """Text of a machine file: a machine with inputs changed, under a name of its own.

    Parameters
    ----------
    machine : Machine
    inputs : mapping of str to float
        As `Machine.with_inputs` takes them. The entries they change get the source ``updated``.
    name : str
    reasons : sequence of str
        Comments at its head.

    Raises
    ------
    MachineError
        Inputs, or a name, that the machine does not allow.
    """
    before = machine.description.model_dump(mode="json", exclude_none=True)
    after = machine.with_inputs(**inputs).description.model_dump(mode="json", exclude_none=True)
    _mark(before, after)
    after["name"] = name
    if (cutters := after.get("cutters")) and (layout := Path(machine.origin).parent / cutters["layout"]).is_file():
        cutters["layout"] = str(layout.resolve())  # it stays beside the file that it came with
    comments = "".join(f"# {' '.join(reason.split())}\n" for reason in reasons)
    return comments + yaml.safe_dump(after, sort_keys=False, allow_unicode=True, width=120)


def _mark(before: Any, after: Any) -> bool:
    """Set the source of every entry in which a value has changed; whether one did that no entry has taken on itself."""
    if isinstance(after, dict):
        changed = [_mark(before[key], value) for key, value in after.items()]
        if any(changed) and "source" in after:
            after["source"] = UPDATED
            return False
        return any(changed)
    if isinstance(after, list):
        changed = [_mark(*pair) for pair in zip(before, after, strict=True)]
        return any(changed)
    return bool(before != after)
