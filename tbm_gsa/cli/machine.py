"""`tbm-monitor machine`: look at machine files."""

from __future__ import annotations

from typing import Annotated

import typer

from tbm_dynamics import load_machine
from tbm_gsa.cli.output import JSON_OPTION, print_json, results

app = typer.Typer(help="Look at machine files.", no_args_is_help=True)

_SHOWN_MODES = 10


@app.callback()
def group() -> None:
    """Look at machine files."""


@app.command()
def check(
    machine: Annotated[str, typer.Argument(help="Name of a shipped machine, or path of a machine file.")],
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Validate a machine file: its keys and values, floating nodes, the static equilibrium."""
    described = load_machine(machine)
    system = described.assemble()
    still = system.equilibrium()
    frequencies = [float(value) for value in system.natural_frequencies(_SHOWN_MODES)]
    document = {
        "machine": described.name,
        "nodes": len(system.nodes),
        "degrees_of_freedom": system.size,
        "meshes": system.meshes.count,
        "mesh_frequency_hz": described.mesh_frequency,
        "natural_frequencies_hz": frequencies,
        "static_mesh_force": [float(force) for force in still.mesh_force],
    }
    if json:
        print_json(document)
        return
    results.print(
        f"{described.name}: {len(system.nodes)} nodes, {system.size} degrees of freedom, {system.meshes.count} meshes"
    )
    force = still.mesh_force.mean() / 1e3
    results.print(f"mesh frequency {described.mesh_frequency:.2f} Hz, static mesh force {force:.1f} kN each")
    results.print("lowest natural frequencies (Hz): " + ", ".join(f"{value:.1f}" for value in frequencies))
