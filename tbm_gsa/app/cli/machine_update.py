"""`tbm-monitor machine update`: an accepted explanation as a new machine file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

from tbm_dynamics import Machine, MachineError, load_machine
from tbm_dynamics.machine.loading import described_by
from tbm_dynamics.machine.writing import updated_text
from tbm_gsa.app.cli.output import DEFAULT_MACHINE, JSON_OPTION, MachineOption, print_json, results
from tbm_gsa.explanation.ranges import explaining_inputs
from tbm_gsa.explanation.result import Explanation, InputCause, NoChange, read_explanation
from tbm_gsa.provenance import machine_sha256
from tbm_gsa.reading import Part
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_msgs_py.base.files import write_whole


class UpdateResult(Part):
    """What `machine update --json` prints: values taken over, by the code of their input."""

    machine: str
    out: str
    inputs: dict[str, float]


def update(
    source: Annotated[
        Path, typer.Option("--from", help="explanation.json of `gsa explain`, or its folder.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(help="New machine file.", dir_okay=False, show_default=False)],
    machine: MachineOption = DEFAULT_MACHINE,
    cause: Annotated[
        list[str] | None,
        typer.Option(
            "--input", help="Input to take from the explanation; default: the most probable; can be repeated."
        ),
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="Name of the new machine; default: the old one and _updated.")
    ] = None,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Write a machine file with the values that explain a recording, and say in it where they come from."""
    described = load_machine(machine)
    found = read_explanation(source)
    if found.machine_file.sha256 != machine_sha256(described):
        raise StudyError(f"{source}: explains another machine than {machine}, {found.machine_file.origin}")
    accepted = accepted_causes(found, cause)
    values = {one.input: one.value for one in accepted}
    _check_ranges(described, values, source)
    text = updated_text(described, values, name or f"{described.name}_updated", _reasons(found, accepted, machine))
    Machine(described_by(text, str(out)), origin=str(out)).assemble()
    if out.exists():
        raise MachineError(f"{out}: exists already, allowed: a new file")
    write_whole(out, text.encode())
    if json:
        print_json(UpdateResult(machine=machine, out=str(out), inputs=values))
    else:
        results.print(f"{out}: " + ", ".join(map(str, accepted)), highlight=False)


def accepted_causes(found: Explanation, wanted: list[str] | None) -> list[InputCause]:
    """Causes that are taken over: one as the cause it is alone, several as they are together."""
    if not wanted:
        if not found.explained or found.verdict in ("rock", "sensor"):
            raise StudyError(f"{found.sentence()}; choose inputs with --input to take them all the same")
        first = found.causes[0]
        if isinstance(first, NoChange):
            raise StudyError("the most probable explanation is that nothing has changed; choose one with --input")
        return [first]
    for code in wanted:
        if code not in found.inputs:
            raise StudyError(f"--input {code}: not among the causes, allowed: {', '.join(found.inputs)}")
        if wanted.count(code) > 1:
            raise StudyError(f"--input {code}: given twice, allowed: once")
    return [found.inputs[wanted[0]]] if len(wanted) == 1 else found.together(wanted)


def _check_ranges(machine: Machine, values: Mapping[str, float], source: Path) -> None:
    """Refuse what no explanation of this machine can have found: somebody has edited it."""
    inputs = explaining_inputs(machine)
    for code, value in values.items():
        item = inputs[code]
        if not item.lower <= value <= item.upper:
            raise StudyError(f"{source}: input {code} is {value:g}, allowed: {item.lower:g} to {item.upper:g}")


def _reasons(found: Explanation, accepted: Sequence[InputCause], machine: str) -> list[str]:
    settings = found.settings
    return [
        f"{machine}, changed by `tbm-monitor machine update` so that it comes nearer to a recording.",
        f"Of that: {found.sentence()}.",
        *(f"{cause}, probability {cause.probability:.2f}" for cause in accepted),
        f"Recording {Path(found.recording.path).name}, sha256 {found.recording.sha256}.",
        f"Machine before: sha256 {found.machine_file.sha256}.",
        f"tbm_monitor {found.versions.get('tbm_monitor', 'from source')}, check run of "
        f"{settings.duration:g} s, seed {settings.seed}.",
    ]
