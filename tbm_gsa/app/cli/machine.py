"""`tbm-monitor machine`: look at machine files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any  # click's contexts: typer may carry a click of its own

import typer
from typer.core import TyperGroup

from tbm_dynamics import MachineError, load_machine, shipped_machines
from tbm_dynamics.loads.stepper import LoadModel
from tbm_dynamics.machine.stress import overstressed
from tbm_dynamics.machine.summary import machine_summary
from tbm_gsa.app.cli.machine_observe import observe
from tbm_gsa.app.cli.machine_tables import print_loads, print_tables
from tbm_gsa.app.cli.machine_update import update
from tbm_gsa.app.cli.output import (
    DEFAULT_MACHINE,
    JSON_OPTION,
    LOADS_OPTION,
    SEED_OPTION,
    MachineOption,
    notes,
    print_json,
    print_sentence,
    results,
)
from tbm_gsa.paper.load_summary import load_run
from tbm_gsa.provenance import machine_sha256
from tbm_gsa.reading import Part


class MachineList(Part):
    """What `machine list --json` prints."""

    machines: tuple[str, ...]


class CheckedMachine(Part):
    """What `machine check --json` prints; forces in N, times in s."""

    machine: str
    origin: str
    sha256: str
    nodes: int
    degrees_of_freedom: int
    meshes: int
    mesh_frequency_hz: float
    time_step: float
    settling: float
    natural_frequencies_hz: tuple[float, ...]
    static_mesh_force: tuple[float, ...]


class _MachineCommands(TyperGroup):
    """Commands that take their machine by ``--machine`` as all do, and as earlier versions did: ``show dz101``."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Command of the arguments, and what is left of them."""
        name, command, left = super().resolve_command(ctx, args)
        earlier = name != "list" and left and not left[0].startswith("-")
        return name, command, ["--machine", *left] if earlier else left


app = typer.Typer(cls=_MachineCommands, add_completion=False, no_args_is_help=True)

_SHOWN_MODES = 10


@app.command("list")
def list_machines(json: Annotated[bool, JSON_OPTION] = False) -> None:
    """List the shipped machines: names that every command takes for a machine."""
    names = shipped_machines()
    if json:
        print_json(MachineList(machines=tuple(names)))
        return
    for name in names:
        results.print(name, highlight=False)


@app.command()
def show(
    machine: MachineOption = DEFAULT_MACHINE,
    count: Annotated[int, typer.Option(min=1, max=1000, help="Number of natural frequencies.")] = _SHOWN_MODES,
    out: Annotated[
        Path | None, typer.Option(help="Draw the machine into this .png or .svg file.", dir_okay=False)
    ] = None,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Show what a machine file describes: nodes, parts, connections, drives, masses, natural frequencies, sources."""
    from tbm_gsa.app.report.machine_drawing import draw_machine  # noqa: PLC0415 - matplotlib loads slowly
    from tbm_gsa.app.report.picture import check_path, write_picture  # noqa: PLC0415

    if out is not None:
        check_path(out)
    described = load_machine(machine)
    summary = machine_summary(described, count)
    if out is not None:
        write_picture(lambda: draw_machine(described), out)
    if json:
        print_json(summary)
    else:
        print_tables(summary)
    if out is not None:
        notes.print(f"drawing: {out}", highlight=False)


@app.command()
def check(machine: MachineOption = DEFAULT_MACHINE, json: Annotated[bool, JSON_OPTION] = False) -> None:
    """Validate a machine file: keys and values, floating nodes, statics, stresses, the time step it needs."""
    from tbm_dynamics.integration.condensed import own_step  # noqa: PLC0415 - compiled code
    from tbm_dynamics.integration.settling import settling_time  # noqa: PLC0415

    described = load_machine(machine)
    system = described.assemble()
    if problem := overstressed(described, system):
        raise MachineError(f"{described.origin}: {problem}")
    meshes = system.couplings.drives
    found = CheckedMachine(
        machine=described.name,
        origin=described.origin,
        sha256=machine_sha256(described),
        nodes=len(system.nodes),
        degrees_of_freedom=system.size,
        meshes=meshes,
        mesh_frequency_hz=described.mesh_frequency,
        time_step=own_step(system),
        settling=settling_time(system),
        natural_frequencies_hz=tuple(system.natural_frequencies(_SHOWN_MODES).tolist()),
        static_mesh_force=tuple(system.equilibrium().force[:meshes].tolist()),
    )
    if json:
        print_json(found)
        return
    results.print(
        f"{found.machine}: {found.nodes} nodes, {found.degrees_of_freedom} degrees of freedom, {meshes} meshes"
    )
    results.print(f"SHA-256 {found.sha256}", highlight=False)
    force = [f"{round(value, 1) / 1e3 + 0.0:.4g}" for value in found.static_mesh_force]
    each = f"{force[0]} kN each" if len(set(force)) == 1 else f"{', '.join(force)} kN"
    results.print(f"mesh frequency {found.mesh_frequency_hz:.2f} Hz, static mesh force {each}")
    results.print(f"time step {found.time_step:g} s, settling {found.settling:.3g} s")
    print_sentence(
        "lowest natural frequencies (Hz): " + ", ".join(f"{value:.4g}" for value in found.natural_frequencies_hz)
    )


@app.command()
def loads(
    machine: MachineOption = DEFAULT_MACHINE,
    model: Annotated[LoadModel, LOADS_OPTION] = "spectral",
    duration: Annotated[float, typer.Option(max=3600.0, help="Length of the run (s), 20 or more.")] = 600.0,
    seed: Annotated[int, SEED_OPTION] = 0,
    out: Annotated[
        Path | None, typer.Option(help="Draw time and frequency into this .png or .svg file.", dir_okay=False)
    ] = None,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Hold the cutterhead loads against what the file, or the paper's Table 1, states of them, and draw them."""
    from tbm_gsa.app.report.load_figure import load_figure  # noqa: PLC0415 - matplotlib loads slowly
    from tbm_gsa.app.report.picture import check_path, write_picture  # noqa: PLC0415

    if out is not None:
        check_path(out)
    described = load_machine(machine)
    run = load_run(described, model, duration, seed)
    if out is not None:
        write_picture(lambda: load_figure(run), out)
    if json:
        print_json(run.summary)
    else:
        print_loads(run.summary)
    if out is not None:
        notes.print(f"drawing: {out}", highlight=False)


app.command()(update)
app.command()(observe)
