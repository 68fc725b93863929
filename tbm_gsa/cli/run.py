"""`tbm-monitor run`: the three nodes in real time."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from tbm_dynamics import load_machine
from tbm_dynamics.levels import LoadLevel
from tbm_dynamics.streams import LoadStream
from tbm_gsa.cli.output import (
    COLUMN_OPTION,
    JSON_OPTION,
    LOADS_OPTION,
    MACHINE_OPTION,
    SCHEDULE_OPTION,
    SEED_OPTION,
    WHERE_OPTION,
    notes,
    print_json,
    progress_bar,
    results,
)
from tbm_gsa.cli.processes import NodeCommand, NodeProcesses, ParameterValue, keep_discovery_local
from tbm_gsa.cli.ros import ANALYSIS_NODE, DYNAMICS_NODE, LIVE_VIEW, LOAD_NODE, watch
from tbm_gsa.cli.simulate import schedule_of
from tbm_msgs_py import topics

if TYPE_CHECKING:
    from tbm_gsa.nodes.watch import Watch

_FIRST_BLOCK_S = 60.0
"""Longest wait for the first block; on a cold cache the kernel is compiled in it."""
_LOOK_S = 0.2


def run(
    duration: Annotated[
        float | None, typer.Option(min=0.1, max=1e9, help="Stream time (s); without it until Ctrl-C.")
    ] = None,
    machine: Annotated[str, MACHINE_OPTION] = "dz101",
    seed: Annotated[int, SEED_OPTION] = 0,
    loads: Annotated[LoadLevel, LOADS_OPTION] = "spectral",
    schedule: Annotated[Path | None, SCHEDULE_OPTION] = None,
    schedule_column: Annotated[list[str] | None, COLUMN_OPTION] = None,
    schedule_where: Annotated[list[str] | None, WHERE_OPTION] = None,
    params: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            dir_okay=False,
            help="ROS parameter file of the nodes; --machine, --seed, --loads and --out hold whatever it says.",
        ),
    ] = None,
    foxglove: Annotated[
        int | None, typer.Option(min=1, max=65535, help="Show all to Foxglove at this port of this computer.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for logs and studies.")] = Path("tbm_run"),
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Run loads, dynamics and analysis as ROS 2 nodes and count what they publish."""
    keep_discovery_local()
    described = load_machine(machine)
    described.assemble()
    # Refused here, in one line, rather than by the node.
    LoadStream(described, seed, 1e-3, 1, loads, schedule_of(schedule, schedule_column, schedule_where))
    driven: dict[str, ParameterValue] = {"loads": loads}
    if schedule is not None:
        driven |= {"schedule": str(schedule.absolute()), "schedule_columns": schedule_column or [""]}
        driven |= {"schedule_where": schedule_where or [""]}
    start = time.monotonic()
    with watch(described.description.test_points) as watching, NodeProcesses(out / "logs") as nodes:
        for command in node_commands(machine, seed, out, driven, params):
            nodes.start(command)
        if foxglove:
            nodes.start(NodeCommand("live_view", LIVE_VIEW, {"port": foxglove}))
        first_block = _wait_for_blocks(watching, nodes, start)
        stopped = _follow(watching, nodes, duration)
    document = run_document(watching, first_block)
    if json:
        print_json(document)
    else:
        _print_table(document)
    if stopped:
        notes.print("stopped by Ctrl-C", highlight=False)


def node_commands(
    machine: str,
    seed: int,
    out: Path,
    driven: Mapping[str, ParameterValue] = MappingProxyType({}),
    params: Path | None = None,
) -> list[NodeCommand]:
    """Give the three nodes on the computer's clock; `driven` are parameters of the load node, `params` a file."""
    common: dict[str, ParameterValue] = {"machine": machine, "seed": seed, "loads": driven.get("loads", "spectral")}
    analysis: dict[str, ParameterValue] = {"machine": machine, "gsa.seed": seed, "gsa.folder": str(out / "studies")}
    return [
        NodeCommand("analysis_node", ANALYSIS_NODE, analysis, params),
        NodeCommand("dynamics_node", DYNAMICS_NODE, common, params),
        # Dynamics and this process: both see the stream from its first block.
        NodeCommand("load_node", LOAD_NODE, {**common, **driven, "wait_for_subscribers": 2}, params),
    ]


def _wait_for_blocks(watching: Watch, nodes: NodeProcesses, start: float) -> float:
    """Seconds from the start to the first block of the model."""
    first = watching.seen.blocks[topics.MODEL_MESH_FORCES]
    while first.received == 0:
        nodes.check()
        if time.monotonic() - start > _FIRST_BLOCK_S:
            raise RuntimeError(
                f"no block on {topics.absolute(topics.MODEL_MESH_FORCES)} within {_FIRST_BLOCK_S:g} s; see the logs"
            )
        watching.spin(_LOOK_S)
    return time.monotonic() - start


def _follow(watching: Watch, nodes: NodeProcesses, duration: float | None) -> bool:
    """Watch until every stream has reached the duration; true when Ctrl-C came first."""
    counts = watching.seen.blocks.values()
    with progress_bar("running") as bar:
        task = bar.add_task("", total=duration)
        try:
            while True:
                watching.spin(_LOOK_S)
                nodes.check()
                reached = min(count.stream_time for count in counts)
                bar.update(task, completed=reached)
                if duration is not None and reached >= duration:
                    return False
        except KeyboardInterrupt:
            return True


def run_document(watching: Watch, first_block: float) -> dict[str, Any]:
    """Gather what `run --json` prints: blocks by topic, diagnostics by status name, seconds to the first block."""
    seen = watching.seen
    return {
        "first_block_seconds": first_block,
        "topics": {
            topics.absolute(name): {"blocks": count.received, "lost": count.lost, "stream_time": count.stream_time}
            for name, count in seen.blocks.items()
        },
        "diagnostics": {
            name: {"level": level, "message": message, "values": values}
            for name, (level, message, values) in sorted(seen.diagnostics.items())
        },
    }


def _print_table(document: dict[str, Any]) -> None:
    table = Table(title="Blocks")
    for heading in ("topic", "received", "lost", "stream time (s)"):
        table.add_column(heading, justify="left" if heading == "topic" else "right")
    for name, count in document["topics"].items():
        table.add_row(name, str(count["blocks"]), str(count["lost"]), f"{count['stream_time']:.2f}")
    results.print(table)
    results.print(f"first block after {document['first_block_seconds']:.1f} s")
    for name, status in document["diagnostics"].items():
        results.print(f"{name}: {status['message']}", highlight=False, markup=False)
