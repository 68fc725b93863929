"""`tbm-monitor machine`: look at machine files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tbm_dynamics import load_machine
from tbm_gsa.cli.machine_tables import print_tables
from tbm_gsa.cli.output import JSON_OPTION, notes, print_json, results
from tbm_gsa.report.machine_summary import machine_summary

app = typer.Typer(help="Look at machine files.", no_args_is_help=True)

_SHOWN_MODES = 10

MachineArgument = Annotated[str, typer.Argument(help="Name of a shipped machine, or path of a machine file.")]


@app.callback()
def group() -> None:
    """Look at machine files."""


@app.command()
def check(machine: MachineArgument, json: Annotated[bool, JSON_OPTION] = False) -> None:
    """Validate a machine file: its keys and values, floating nodes, the static equilibrium."""
    described = load_machine(machine)
    system = described.assemble()
    meshes = system.couplings.drives
    force = system.equilibrium().force[:meshes]
    frequencies = [float(value) for value in system.natural_frequencies(_SHOWN_MODES)]
    document = {
        "machine": described.name,
        "nodes": len(system.nodes),
        "degrees_of_freedom": system.size,
        "meshes": meshes,
        "mesh_frequency_hz": described.mesh_frequency,
        "natural_frequencies_hz": frequencies,
        "static_mesh_force": [float(value) for value in force],
    }
    if json:
        print_json(document)
        return
    results.print(f"{described.name}: {len(system.nodes)} nodes, {system.size} degrees of freedom, {meshes} meshes")
    mean = force.mean() / 1e3
    results.print(f"mesh frequency {described.mesh_frequency:.2f} Hz, static mesh force {mean:.1f} kN each")
    results.print("lowest natural frequencies (Hz): " + ", ".join(f"{value:.1f}" for value in frequencies))


@app.command()
def show(
    machine: MachineArgument,
    count: Annotated[int, typer.Option(min=1, max=1000, help="Number of natural frequencies.")] = _SHOWN_MODES,
    out: Annotated[
        Path | None, typer.Option(help="Draw the machine into this .png or .svg file.", dir_okay=False)
    ] = None,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Show what a machine file describes: nodes, parts, connections, drives, masses, natural frequencies, sources."""
    from tbm_gsa.report.machine_drawing import check_path, write_drawing  # noqa: PLC0415 - matplotlib takes its time

    if out is not None:
        check_path(out)
    described = load_machine(machine)
    document = machine_summary(described, count)
    if out is not None:
        write_drawing(described, out)
    if json:
        print_json(document)
    else:
        print_tables(document)
    if out is not None:
        notes.print(f"drawing: {out}", markup=False, highlight=False)
