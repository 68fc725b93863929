"""`tbm-monitor machine update`: an accepted explanation as a new machine file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from tbm_dynamics import Machine, MachineError, load_machine
from tbm_dynamics.machine.loading import described_by
from tbm_dynamics.machine.writing import updated_text
from tbm_gsa.app.cli.output import DEFAULT_MACHINE, JSON_OPTION, MachineOption, print_json, results
from tbm_gsa.explanation.forms import EXPLANATION, ExplanationForm
from tbm_gsa.explanation.ranges import explaining_inputs
from tbm_gsa.explanation.verdict import verdict
from tbm_gsa.provenance import machine_sha256
from tbm_gsa.reading import read_document
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_msgs_py.base.files import write_whole


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
    document = read_explanation(source)
    if document["machine_file"]["sha256"] != machine_sha256(described):
        raise StudyError(f"{source}: explains another machine than {machine}, {document['machine_file']['origin']}")
    accepted = accepted_causes(document, cause)
    values = {row["input"]: float(row["value"]) for row in accepted}
    _check_ranges(described, values, source)
    text = updated_text(described, values, name or f"{described.name}_updated", _reasons(document, accepted, machine))
    Machine(described_by(text, str(out)), origin=str(out)).assemble()
    if out.exists():
        raise MachineError(f"{out}: exists already, allowed: a new file")
    write_whole(out, text.encode())
    if json:
        print_json({"machine": machine, "out": str(out), "inputs": values})
    else:
        results.print(f"{out}: " + ", ".join(map(_change, accepted)), highlight=False)


def read_explanation(source: Path) -> dict[str, Any]:
    """Read the document of an explanation from its file or its folder."""
    file = source / "explanation.json" if source.is_dir() else source
    return read_document(file, ExplanationForm, EXPLANATION)


def accepted_causes(document: Mapping[str, Any], wanted: list[str] | None) -> list[dict[str, Any]]:
    """Rows of the causes that are taken over: one as the cause it is alone, several as they are together."""
    rows = {row["input"]: row for row in document["causes"] if row["input"] is not None}
    if not wanted:
        first = document["causes"][0]
        if first["input"] is None:
            raise StudyError("the most probable explanation is that nothing has changed; choose one with --input")
        if not document["explained"]:
            raise StudyError(f"{verdict(document)}; choose inputs with --input to take them all the same")
        return [first]
    for code in wanted:
        if code not in rows:
            raise StudyError(f"--input {code}: not among the causes, allowed: {', '.join(rows)}")
    if len(wanted) == 1:
        return [rows[wanted[0]]]
    return [{**rows[code], **document["joint"]["inputs"][code]} for code in dict.fromkeys(wanted)]


def _check_ranges(machine: Machine, values: Mapping[str, float], source: Path) -> None:
    """Refuse what no explanation of this machine can have found: somebody has edited it."""
    inputs = explaining_inputs(machine)
    for code, value in values.items():
        item = inputs[code]
        if not item.lower <= value <= item.upper:
            raise StudyError(f"{source}: input {code} is {value:g}, allowed: {item.lower:g} to {item.upper:g}")


def _change(row: Mapping[str, Any]) -> str:
    low, high = row["interval"]
    return (
        f"{row['input']} ({row['name']}) {row['machine_value']:.4g} to {row['value']:.4g} {row['unit']}".rstrip()
        + f" (90 % interval {low:.4g} to {high:.4g})"
    )


def _reasons(document: Mapping[str, Any], accepted: list[dict[str, Any]], machine: str) -> list[str]:
    recording, versions = document["recording"], document["versions"]
    return [
        f"{machine}, changed by `tbm-monitor machine update` so that it comes nearer to a recording.",
        f"Of that: {verdict(document)}.",
        *(f"{_change(row)}, probability {row['probability']:.2f}" for row in accepted),
        f"Recording {Path(recording['path']).name}, sha256 {recording['sha256']}.",
        f"Machine before: sha256 {document['machine_file']['sha256']}.",
        f"tbm_monitor {versions.get('tbm_monitor', 'from source')}, campaign of {document['settings']['samples']} runs "
        f"of {document['settings']['duration']:g} s, seed {document['settings']['seed']}.",
    ]
