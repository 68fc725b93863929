"""`tbm-monitor run`: the three nodes in real time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tbm_dynamics import OperatingPoint, load_machine
from tbm_dynamics.loads.stepper import LOAD_MODELS, LoadModel
from tbm_dynamics.streaming.schedule import Schedule
from tbm_dynamics.streaming.streams import LoadStream
from tbm_gsa.app.cli.output import (
    COLUMN_OPTION,
    DEFAULT_MACHINE,
    JSON_OPTION,
    MACHINE_HELP,
    SCHEDULE_OPTION,
    WHERE_OPTION,
    TimeStep,
    add_row,
    named,
    narrow_table,
    notes,
    print_json,
    results,
)
from tbm_gsa.app.cli.processes import (
    NodeCommand,
    NodeProcesses,
    load_rates,
    received_rate,
    settle_ros_environment,
)
from tbm_gsa.app.cli.simulate import schedule_of
from tbm_gsa.app.cli.status_line import StatusLine
from tbm_gsa.app.cli.supervision import ACTIVE_STATUSES, Supervision, watch
from tbm_gsa.reading import Part
from tbm_msgs_py import topics
from tbm_msgs_py.base.errors import InputError, RunError
from tbm_msgs_py.base.units import R_MIN
from tbm_msgs_py.nodes.parameter_file import ParameterFile
from tbm_msgs_py.nodes.processes import record_signals

if TYPE_CHECKING:
    from tbm_gsa.app.nodes.watch import SystemState, Watch

_FIRST_BLOCK_S = 300.0
"""Longest wait for the first block; on a cold cache the kernel is compiled in it."""
_LOOK_S = 0.2
_NODES = ("load_node", "dynamics_node", "analysis_node")
_RATES = (("load_node", "block_rate"), ("dynamics_node", "load_rate"))
_OWN = "default: the machine's own, or what --params states"
_MACHINE_OPTION = typer.Option(
    "--machine",
    metavar="<name|file>",
    help=f"{MACHINE_HELP}; default: that of --params, else {DEFAULT_MACHINE}.",
    show_default=False,
)
_LOADS_OPTION = typer.Option(
    "--loads", help="spectral or cutter; default: that of --params, else spectral.", show_choices=False
)
_SEED_OPTION = typer.Option(
    "--seed", min=0, max=2**31 - 1, help="Seed of everything random; default: those of --params, else 0."
)


class PublishedBlocks(Part):
    """Blocks of one topic, those lost, and the time of the stream (s)."""

    blocks: int
    lost: int
    stream_time: float


class NodeStatus(Part):
    """Last status of one name on `/diagnostics`."""

    level: int
    message: str
    values: dict[str, str]


class RunResult(Part):
    """What `run --json` prints; no seconds to the first block of the model where none came."""

    first_block_seconds: float | None
    topics: dict[str, PublishedBlocks]
    diagnostics: dict[str, NodeStatus]

    @classmethod
    def of(cls, state: SystemState, first_block: float | None) -> RunResult:
        """Gather what was received."""
        blocks = {
            topics.absolute(name): PublishedBlocks(blocks=one.received, lost=one.lost, stream_time=one.stream_time)
            for name, one in state.blocks.items()
        }
        statuses = {
            name: NodeStatus(level=level, message=message, values=values)
            for name, (level, message, values) in sorted(state.diagnostics.items())
        }
        return cls(first_block_seconds=first_block, topics=blocks, diagnostics=statuses)


def run(
    context: typer.Context,
    duration: Annotated[
        float | None, typer.Option(min=0.1, max=1e9, help="Stream time (s); without it until Ctrl-C.")
    ] = None,
    machine: Annotated[str, _MACHINE_OPTION] = DEFAULT_MACHINE,
    seed: Annotated[int | None, _SEED_OPTION] = None,
    loads: Annotated[LoadModel | None, _LOADS_OPTION] = None,
    speed: Annotated[float | None, typer.Option(min=0.01, help=f"Speed of the cutterhead (r/min); {_OWN}.")] = None,
    torque: Annotated[float | None, typer.Option(min=0.1, help=f"Its mean torque (kN·m); {_OWN}.")] = None,
    thrust: Annotated[float | None, typer.Option(min=0.1, help=f"Mean thrust (kN); {_OWN}.")] = None,
    schedule: Annotated[Path | None, SCHEDULE_OPTION] = None,
    schedule_column: Annotated[list[str] | None, COLUMN_OPTION] = None,
    schedule_where: Annotated[list[str] | None, WHERE_OPTION] = None,
    params: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            dir_okay=False,
            help="ROS parameter file of the nodes; it holds wherever the command line names nothing.",
        ),
    ] = None,
    sim_time: Annotated[
        bool, typer.Option("--sim-time", help="Follow /clock, as beside a recording that `bag play` plays.")
    ] = False,
    foxglove: Annotated[
        int | None, typer.Option(min=1, max=65535, help="Show all to Foxglove at this port of this computer.")
    ] = None,
    web: Annotated[
        int | None, typer.Option(min=1, max=65535, help="Show a page to watch at this port of this computer.")
    ] = None,
    time_step: TimeStep = None,
    out: Annotated[Path, typer.Option(help="Folder for logs and studies.")] = Path("tbm_run"),
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Run loads, dynamics and analysis as ROS 2 nodes and count what they publish."""
    settle_ros_environment()
    site = ParameterFile(params)
    for node in _NODES:
        site.check(topics.absolute(node), node)
    if not named(context, "machine"):
        machine = site.common(_NODES, "machine", machine)
    described = load_machine(machine)
    step = described.step(time_step)
    level = loads or _level(site)
    plan = schedule_of(schedule, schedule_column, schedule_where)
    point = _operating_point(described.operating_point, speed, torque, thrust)
    _check_driving(LoadStream(described, seed or 0, 1e-3, 1, level, plan), point, plan)
    driven: dict[str, object] = {"machine": described.origin, "loads": level}
    if time_step is not None or not any(site.stated(*one) for one in _RATES):
        driven |= load_rates(step)
    commands = node_commands(driven | _scheduled(schedule, schedule_column, schedule_where), seed, out, site)
    if foxglove:
        commands.append(NodeCommand("live_view", {"port": foxglove}))
    if web:
        commands.append(page_command(web, described.origin, out, site))
        notes.print(f"page to watch: http://127.0.0.1:{web}/", highlight=False)
    if sim_time:
        notes.print("the nodes follow /clock, as `tbm-monitor bag play` gives it", highlight=False)
        commands = [replace(one, parameters={**one.parameters, "use_sim_time": True}) for one in commands]
    watching, patience = watch(described.description.test_points), math.inf if sim_time else _FIRST_BLOCK_S
    first_block, stopped = _run(watching, commands, out / "logs", point, duration, patience)
    found = RunResult.of(watching.state, first_block)
    if json:
        print_json(found)
    else:
        _print_table(found)
    if stopped:
        notes.print("stopped by a signal", highlight=False)


def _level(site: ParameterFile) -> LoadModel:
    stated = site.common(_NODES[:2], "loads", LOAD_MODELS[0])
    for level in LOAD_MODELS:
        if level == stated:
            return level
    raise InputError(f"{site.file}: loads: {stated}, allowed: {', '.join(LOAD_MODELS)}")


def _operating_point(
    own: OperatingPoint, speed: float | None, torque: float | None, thrust: float | None
) -> OperatingPoint | None:
    """Operating point of the command line, in r/min, kN·m and kN; what it leaves open is the machine's own."""
    if speed is None and torque is None and thrust is None:
        return None
    return OperatingPoint(
        own.speed if speed is None else speed * R_MIN,
        own.torque if torque is None else torque * 1e3,
        own.thrust if thrust is None else thrust * 1e3,
    )


def _check_driving(stream: LoadStream, point: OperatingPoint | None, plan: Schedule | None) -> None:
    """Refuse here, in one line, what the node of the loads would refuse."""
    if point is not None and plan is not None:
        raise typer.BadParameter("--schedule with --speed, --torque or --thrust, allowed: one way to drive")
    if point is not None:
        stream.set_operating_point(point)


def _scheduled(file: Path | None, columns: list[str] | None, where: list[str] | None) -> dict[str, object]:
    """Parameters of the load node for a schedule; none without one."""
    if file is None:
        return {}
    return {"schedule": str(file.absolute()), "schedule_columns": columns or [""], "schedule_where": where or [""]}


def node_commands(driven: Mapping[str, object], seed: int | None, out: Path, site: ParameterFile) -> list[NodeCommand]:
    """Return the three nodes, on the computer's clock; `driven` are parameters of the load node."""
    common: dict[str, object] = {name: driven[name] for name in ("machine", "loads")}
    analysis: dict[str, object] = {"machine": driven["machine"]}
    if site.stated("analysis_node", "gsa.folder") is None:
        analysis["gsa.folder"] = str(out / "studies")
    if seed is not None:
        common["seed"] = analysis["gsa.seed"] = seed
    return [
        NodeCommand("analysis_node", analysis, site.file),
        NodeCommand("dynamics_node", common | received_rate(driven), site.file),
        # Dynamics and this process: both see the stream from its first block.
        NodeCommand("load_node", {**common, **driven, "wait_for_subscribers": 2}, site.file),
    ]


def page_command(port: int, machine: str, out: Path, site: ParameterFile) -> NodeCommand:
    """Node of the page; what it has to share with the analysis node is what that is told, unless the file says so."""
    given: dict[str, object] = {"machine": machine, "port": port, "folder": str(out)}
    for name in ("mapping", "history", "alarm", "threshold", "baseline"):
        value = site.stated("analysis_node", name)
        if value is not None and site.stated("web_view", name) is None:
            given[name] = value
    return NodeCommand("web_view", given, site.file)


def _run(
    watching: Watch,
    commands: Iterable[NodeCommand],
    logs: Path,
    point: OperatingPoint | None,
    duration: float | None,
    patience: float,
) -> tuple[float | None, bool]:
    """Seconds to the first block, and whether a signal ended it."""
    start, stopping = time.monotonic(), record_signals()
    with watching, NodeProcesses(logs) as processes:
        nodes = Supervision(processes, watching.state.diagnostics)
        if point is not None:
            watching.operate(point.speed, point.torque, point.thrust)
        for command in commands:
            nodes.start(command)
        first_block = _wait_for_blocks(watching, nodes, start, stopping, patience)
        with StatusLine(logs, duration) as line:
            _follow(watching, nodes, duration, stopping, line)
        stopped = stopping()
    return first_block, stopped


def _wait_for_blocks(
    watching: Watch, nodes: Supervision, start: float, stopping: Callable[[], bool], patience: float
) -> float | None:
    """Seconds from the start to the first block of the model; None when stopped before it."""
    first = watching.state.blocks[topics.MODEL_MESH_FORCES]
    while first.received == 0:
        if stopping():
            return None
        nodes.check()
        if time.monotonic() - start > patience:
            raise RunError(
                f"no block on {topics.absolute(topics.MODEL_MESH_FORCES)} within {patience:g} s; see the logs"
            )
        watching.spin(_LOOK_S)
    return time.monotonic() - start


def _follow(
    watching: Watch, nodes: Supervision, duration: float | None, stopping: Callable[[], bool], line: StatusLine
) -> None:
    """Watch until every stream has the duration and all nodes have reported after it, or until stopped."""
    counts, diagnostics = watching.state.blocks.values(), watching.state.diagnostics
    asked, reached = False, 0.0
    while not stopping() and not (asked and diagnostics.keys() >= ACTIVE_STATUSES):
        watching.spin(_LOOK_S)
        reached = min(count.stream_time for count in counts)
        nodes.check(reached)  # first what is new of the nodes, then how it goes
        if not asked and diagnostics.keys() >= ACTIVE_STATUSES:
            line.update(diagnostics, reached)
        if duration is not None and reached >= duration and not asked:
            diagnostics.clear()  # of before the end
            asked = True
    line.finish(diagnostics, reached if duration is None else min(reached, duration))


def _print_table(found: RunResult) -> None:
    table = narrow_table("Blocks", "topic", ">received", ">lost", ">stream time (s)")
    for name, count in found.topics.items():
        add_row(table, name, count.blocks, count.lost, f"{count.stream_time:.2f}")
    results.print(table)
    results.print()
    first = found.first_block_seconds
    results.print("no block" if first is None else f"first block after {first:.1f} s")
    for name, status in found.diagnostics.items():
        results.print(f"{name}: {status.message}", highlight=False)
