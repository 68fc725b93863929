"""`tbm-monitor simulate`: one run of the model."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from tbm_dynamics import Machine, Response, load_machine
from tbm_dynamics import simulate as run_model
from tbm_dynamics.indicators import UNITS
from tbm_dynamics.loads.stepper import LoadModel
from tbm_dynamics.streaming.schedule import Schedule, pairs, read_schedule
from tbm_gsa.app.cli.output import (
    COLUMN_OPTION,
    DEFAULT_MACHINE,
    JSON_OPTION,
    LOADS_OPTION,
    SCHEDULE_OPTION,
    SEED_OPTION,
    WHERE_OPTION,
    MachineOption,
    TimeStep,
    add_row,
    narrow_table,
    print_json,
    progress_bar,
    results,
)
from tbm_gsa.provenance import machine_file
from tbm_gsa.reading import MachineFile, Maybe, Part
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.units import STANDARD_GRAVITY

OPERATING_POINT = ("speed_r_min", "torque_kn_m", "thrust_kn")


class MeshForceSummary(Part):
    """Mean, standard deviation and maximum over all meshes, N."""

    mean: Maybe
    std: Maybe
    max: Maybe


class SimulationResult(Part):
    """What `simulate --json` prints.

    Attributes
    ----------
    indicators : dict of str to float
        ``RDef_A …``, SI units.
    rms_g, peak_g : dict of str to (dict of str to float)
        By test point and axis, of the accelerations without their mean (g).
    duration, settling : float
        Of the run, and of what is run before it and left out (s).
    time_step : float
        s.
    real_time_factor : float
    operating_point : dict of str to float
        The machine's, which a schedule replaces.
    schedule : str or None
        File of the operating points.
    unused_rows : int
        Rows of it beyond the end of the run.
    """

    machine: str
    machine_file: MachineFile
    operating_point: dict[str, float]
    seed: int
    duration: float
    settling: float
    time_step: float
    indicators: dict[str, Maybe]
    rms_g: dict[str, dict[str, Maybe]]
    peak_g: dict[str, dict[str, Maybe]]
    mesh_force: MeshForceSummary
    states: int
    real_time_factor: float
    loads: LoadModel
    schedule: str | None
    unused_rows: int


def simulate(
    duration: Annotated[float, typer.Option(max=3600.0, help="Simulated time (s), 0.0001 or more.")] = 3.0,
    machine: MachineOption = DEFAULT_MACHINE,
    seed: Annotated[int, SEED_OPTION] = 0,
    time_step: TimeStep = None,
    loads: Annotated[LoadModel, LOADS_OPTION] = "spectral",
    schedule: Annotated[Path | None, SCHEDULE_OPTION] = None,
    schedule_column: Annotated[list[str] | None, COLUMN_OPTION] = None,
    schedule_where: Annotated[list[str] | None, WHERE_OPTION] = None,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Run the model and print its indicators and accelerations."""
    described = load_machine(machine)
    driven = schedule_of(schedule, schedule_column, schedule_where)
    # The kernel is compiled, and the factor below is that of the model, not of the compiler.
    step, settling = described.step(time_step), described.settling()
    run_model(described, duration=1e-3, seed=seed, time_step=step, loads=loads)
    start = time.perf_counter()
    with progress_bar("simulating") as bar:
        task = bar.add_task("", total=1.0)
        response = run_model(
            described,
            duration,
            seed,
            time_step=step,
            settling=settling,
            loads=loads,
            schedule=driven,
            progress=lambda share: bar.update(task, completed=share),
        )
    seconds = time.perf_counter() - start
    rms, peak = _accelerations_g(described, response)
    force = response.mesh_force
    point = described.description.operating_point
    found = SimulationResult(
        machine=described.name,
        machine_file=machine_file(described),
        operating_point={name: getattr(point, name) for name in OPERATING_POINT},
        seed=seed,
        duration=len(response.time) * step,
        settling=settling,
        time_step=step,
        indicators=response.indicators(),
        rms_g=rms,
        peak_g=peak,
        mesh_force=MeshForceSummary(mean=float(force.mean()), std=float(force.std()), max=float(force.max())),
        states=response.states,
        real_time_factor=(settling + duration) / seconds,
        loads=loads,
        schedule=None if schedule is None else str(schedule.resolve()),
        unused_rows=_unused_rows(driven, settling + duration),
    )
    if json:
        print_json(found)
    else:
        _print_tables(found)


def _unused_rows(schedule: Schedule | None, duration: float) -> int:
    """Rows of a schedule that lie beyond the end of a run."""
    return 0 if schedule is None else int(np.count_nonzero(np.asarray(schedule.time) >= duration))


def schedule_of(file: Path | None, columns: list[str] | None, where: list[str] | None) -> Schedule | None:
    """Read the schedule that the options name; columns and rows of no file are bad input."""
    if file is None:
        if columns or where:
            raise InputError("--schedule-column and --schedule-where: allowed only with --schedule")
        return None
    return read_schedule(file, pairs("--schedule-column", columns or ()), pairs("--schedule-where", where or ()))


def _accelerations_g(
    machine: Machine, response: Response
) -> tuple[dict[str, dict[str, float]], dict[str, dict[str, float]]]:
    """RMS and peak of the accelerations without their mean, g, by test point and axis."""
    rms: dict[str, dict[str, float]] = {}
    peak: dict[str, dict[str, float]] = {}
    for point, node in machine.description.test_points.items():
        values = response.acceleration(node)[:, :3] / STANDARD_GRAVITY
        values = values - values.mean(axis=0)
        rms[point] = dict(zip("xyz", np.sqrt(np.mean(values**2, axis=0)).tolist(), strict=True))
        peak[point] = dict(zip("xyz", np.abs(values).max(axis=0).tolist(), strict=True))
    return rms, peak


def _print_provenance(found: SimulationResult) -> None:
    """Print the machine file and how the machine was driven."""
    speed, torque, thrust = found.operating_point.values()
    driven = f"{speed:g} r/min, {torque:g} kN·m, {thrust:g} kN"
    if found.schedule is not None:
        unused = found.unused_rows
        driven = found.schedule + (f" ({unused} rows lie beyond the end of the run)" if unused else "")
    results.print(f"machine {found.machine_file.origin}, driven at {driven}", highlight=False)


def _print_tables(found: SimulationResult) -> None:
    settled = f"after {found.settling:.3g} s of settling"
    title = f"{found.machine}: indicators over {found.duration:.3g} s {settled}, seed {found.seed}"
    table = narrow_table(title, "indicator", ">value", "unit")
    for name, value in found.indicators.items():
        add_row(table, name, f"{value:.4g}", UNITS[name])
    results.print(table)
    table = narrow_table("\nacceleration, RMS (peak), g", "test point", ">x", ">y", ">z")
    for point, rms in found.rms_g.items():
        peak = found.peak_g[point]
        add_row(table, point, *(f"{rms[axis]:.3g} ({peak[axis]:.3g})" for axis in rms))
    results.print(table)
    results.print()
    _print_provenance(found)
    results.print(
        f"real-time factor {found.real_time_factor:.1f}, {found.states} states, time step {found.time_step:g} s"
    )
