"""`tbm-monitor demo`: the whole job on the shipped recording, ending by itself."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tbm_dynamics import Machine, load_machine
from tbm_gsa.app.cli.output import (
    DEFAULT_MACHINE,
    JSON_OPTION,
    OUTPUTS_OPTION,
    SEED_OPTION,
    MachineOption,
    add_row,
    narrow_table,
    notes,
    print_json,
    print_sentence,
    progress_bar,
    ranked_inputs,
    results,
    split_names,
)
from tbm_gsa.app.cli.processes import (
    NodeCommand,
    NodeProcesses,
    load_rates,
    received_rate,
    settle_ros_environment,
)
from tbm_gsa.app.cli.shipped import STORY, shipped_bag
from tbm_gsa.app.cli.supervision import ACTIVE_STATUSES, Supervision, watch
from tbm_gsa.app.cli.workers import anonymous_main, shown_progress
from tbm_gsa.explanation.result import PAGE_NAME, StretchFinding
from tbm_gsa.provenance import machine_file
from tbm_gsa.reading import MachineFile, Maybe, Part
from tbm_gsa.sensitivity.results import NOT_DETERMINED, is_determined
from tbm_gsa.sensitivity.study.outputs import checked_outputs
from tbm_msgs_py.bags.metadata import is_synthetic
from tbm_msgs_py.base.errors import RecordingError, RunError
from tbm_msgs_py.base.units import STANDARD_GRAVITY
from tbm_msgs_py.recordings.mapping import default_mapping_file
from tbm_msgs_py.recordings.recording import Recording, read_recording

if TYPE_CHECKING:
    from tbm_gsa.app.nodes.watch import SystemState, Watch

_LOOK_S = 0.2
_ASKED_S = 10.0
"""Longest wait for a study to start after it was asked for, and for its result."""
_START_S = 300.0
"""Longest start of the nodes, with everything to compile."""
_STRONGEST = 5
_STUDY_S = 3.0
"""Length of a simulation of the study, the default of the node."""


class DemoPoint(Part):
    """RMS of the axial acceleration, as in the paper's Table 2, over the windows of one test point."""

    node: int
    predicted_g: Maybe
    measured_g: Maybe
    relative_error: Maybe
    windows: int


class DemoOutput(Part):
    """Surrogate of one output, and the first index of its strongest inputs."""

    surrogate: str
    r2_test: Maybe
    r2_cv: Maybe
    determined: bool
    strongest: dict[str, Maybe]


class BlockTotals(Part):
    """Blocks of one topic."""

    received: int
    lost: int


class PlayedRecording(Part):
    """The recording that was played, and the mapping of its topics."""

    path: str
    mapping: str | None


class DemoResult(Part):
    """What `demo --json` prints.

    Attributes
    ----------
    points : dict of str to DemoPoint
    outputs : dict of str to DemoOutput
    blocks : dict of str to BlockTotals
        By topic.
    findings : tuple of StretchFinding
        What explains the recording, stretch by stretch.
    trigger : str
        What started the study.
    report : str or None
        Page of the study.
    seconds : float
        Of the whole demo.
    """

    points: dict[str, DemoPoint]
    outputs: dict[str, DemoOutput]
    blocks: dict[str, BlockTotals]
    findings: tuple[StretchFinding, ...]
    trigger: str
    report: str | None
    seconds: float
    machine_file: MachineFile
    seed: int
    recording: PlayedRecording


def demo(
    bag: Annotated[Path | None, typer.Option(help="Recording to play; default: the shipped synthetic one.")] = None,
    machine: MachineOption = DEFAULT_MACHINE,
    out: Annotated[Path, typer.Option(help="Folder for logs and the study.")] = Path("tbm_demo"),
    samples: Annotated[
        int, typer.Option(min=10, max=1_000_000, help="Training simulations of the sensitivity analysis.")
    ] = 200,
    test: Annotated[int, typer.Option(min=2, max=1_000_000, help="Test simulations.")] = 20,
    outputs: Annotated[str | None, OUTPUTS_OPTION] = None,
    seed: Annotated[int, SEED_OPTION] = 0,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """Play a recording, run the three nodes, compare, let the comparison trigger the sensitivity analysis, report."""
    settle_ros_environment()
    recording = read_recording(bag or shipped_bag(STORY))
    length = max(record.duration for record in recording.points.values())
    described = load_machine(machine)
    points = described.description.test_points
    if not points.keys() & recording.points.keys():
        recorded, known = ", ".join(recording.points), ", ".join(points)
        raise RecordingError(f"{recording.path}: test points {recorded}: machine {machine} has {known}")
    loads = load_rates(described.step())
    names = split_names("--outputs", [] if outputs is None else [outputs])
    checked_outputs(names, points, _STUDY_S)  # refused before anything starts
    start = time.monotonic()
    with watch(points) as watching, NodeProcesses(out / "logs") as processes:
        nodes = Supervision(processes, watching.state.diagnostics)
        for command in node_commands(recording, machine, loads, seed, out, samples, test, names):
            nodes.start(command)
        _wait_until_active(watching, nodes, out / "logs")
        nodes.start(player_command(recording))
        notes.print(
            f"playing {recording.path} ({length:.0f} s) to three nodes; logs in {out / 'logs'}", highlight=False
        )
        _play(watching, nodes, length)
        _finish_study(watching, nodes)
    mapping = default_mapping_file(recording.path)
    played = PlayedRecording(
        path=str(recording.path.resolve()), mapping=None if mapping is None else str(mapping.resolve())
    )
    findings = explained(recording.path, described, out, seed)
    seconds = time.monotonic() - start
    found = demo_result(described, watching.state, findings, seed=seed, recording=played, seconds=seconds)
    if json:
        print_json(found)
    else:
        print_tables(found, synthetic=is_synthetic(recording.path))


def node_commands(
    recording: Recording,
    machine: str,
    loads: Mapping[str, object],
    seed: int,
    out: Path,
    samples: int,
    test: int,
    outputs: Sequence[str],
) -> list[NodeCommand]:
    """Name the three nodes, which follow the recording's clock; `loads` are parameters of the load node."""
    common: dict[str, object] = {"machine": machine, "use_sim_time": True}
    study: dict[str, object] = {
        "alarm": "threshold",  # the recording is over before a baseline is learnt
        "gsa.samples": samples,
        "gsa.test": test,
        "gsa.outputs": list(outputs) or [""],  # empty: all of them
        "gsa.duration": _STUDY_S,
        "gsa.seed": seed,
        "gsa.folder": str(out / "studies"),
        "history": str(out / "history.sqlite"),  # not among the windows of a real machine
    }
    mapping = default_mapping_file(recording.path)
    stated: dict[str, object] = {"mapping": str(mapping)} if mapping else {}
    return [
        NodeCommand("analysis_node", {**common, **study, **stated}),
        NodeCommand("dynamics_node", {**common, **received_rate(loads), "seed": seed}),
        # Dynamics and this process: both see the stream from its first block.
        NodeCommand("load_node", {**common, **loads, "seed": seed, "wait_for_subscribers": 2}),
    ]


def player_command(recording: Recording) -> NodeCommand:
    """Name the player; the comparison sees every topic from its first message."""
    play: dict[str, object] = {"wait_for_subscribers": max(2, len(recording.points)), "wait_timeout": 30.0}
    return NodeCommand("bag_player", {"bag": str(recording.path), **play})


def _wait_until_active(watching: Watch, nodes: Supervision, logs: Path) -> None:
    """Wait until every node reports: on a computer that still compiles the recording would be over before."""
    _wait_while(watching, nodes, lambda: not watching.state.diagnostics.keys() >= ACTIVE_STATUSES, _START_S)
    if missing := sorted(ACTIVE_STATUSES - watching.state.diagnostics.keys()):
        raise RunError(f"{missing[0]}: nothing on /diagnostics for {_START_S:g} s; see the logs in {logs}")


def _play(watching: Watch, nodes: Supervision, length: float) -> None:
    """Follow the playback to its end, saying once when the comparison starts a study."""
    announced = False
    progress = watching.state.blocks
    with progress_bar("playing") as bar:
        task = bar.add_task("", total=length)
        while nodes.running("bag_player"):
            watching.spin(_LOOK_S)
            played = min(count.stream_time for count in progress.values())
            nodes.check(played, ending="bag_player")
            bar.update(task, completed=played)
            if not announced and watching.state.gsa.get("state") == "running":
                notes.print(f"sensitivity analysis {watching.state.gsa_message}", highlight=False)
                announced = True


def _finish_study(watching: Watch, nodes: Supervision) -> None:
    """Wait for the study; one that the comparison did not start is asked for."""
    state = watching.state
    if state.gsa.get("state", "idle") == "idle":
        notes.print("the comparison stayed under its threshold: asking for a sensitivity analysis", highlight=False)
        watching.run_gsa()
        _wait_while(watching, nodes, lambda: state.gsa.get("state", "idle") == "idle", _ASKED_S)
    with progress_bar("simulations") as bar:
        task = bar.add_task("", total=int(state.gsa.get("total", 0)))
        while state.gsa.get("state") == "running":
            watching.spin(_LOOK_S)
            done = int(state.gsa["done"])
            nodes.check(done, ending="bag_player")
            bar.update(task, completed=done)
    if state.gsa.get("state") != "finished":
        raise RunError(f"sensitivity analysis: {state.gsa_message}")
    _wait_while(watching, nodes, lambda: not state.result, _ASKED_S)
    if not state.result:
        raise RunError("sensitivity analysis: finished, but no result came")


def _wait_while(watching: Watch, nodes: Supervision, condition: Callable[[], bool], seconds: float) -> None:
    until = time.monotonic() + seconds
    while condition() and time.monotonic() < until:
        watching.spin(_LOOK_S)
        nodes.check(ending="bag_player")


def explained(path: Path, machine: Machine, out: Path, seed: int) -> list[StretchFinding]:
    """Explain the recording stretch by stretch, with a page for each."""
    from tbm_gsa.app.report.explanation_page import write_explanation_page  # noqa: PLC0415 - matplotlib loads slowly
    from tbm_gsa.explanation.stretches import explain_stretches  # noqa: PLC0415 - as above
    from tbm_gsa.explanation.workflow import ExplainOptions  # noqa: PLC0415 - as above

    with progress_bar() as bar, anonymous_main():
        options = ExplainOptions(seed=seed, progress=shown_progress(bar))
        stretches = explain_stretches(path, machine, out / "explanations", options)
    for one in stretches:
        if one.explanation is not None and one.finding.folder is not None:
            write_explanation_page(one.explanation, Path(one.finding.folder) / PAGE_NAME)
    return [one.finding for one in stretches]


def demo_result(
    machine: Machine,
    state: SystemState,
    findings: Sequence[StretchFinding],
    *,
    seed: int,
    recording: PlayedRecording,
    seconds: float,
) -> DemoResult:
    """Gather what the watch has received."""
    points = {}
    for point, place in machine.description.sensor_places.items():
        predicted, measured = (float(state.rms(point, side)[0]) for side in ("model_rms", "field_rms"))
        points[point] = DemoPoint(
            node=place.node,
            predicted_g=predicted / STANDARD_GRAVITY,
            measured_g=measured / STANDARD_GRAVITY,
            relative_error=abs(measured - predicted) / measured if measured > 0.0 else float("nan"),
            windows=state.windows[point]["relative_error"].count,
        )
    outputs = {}
    for name, values in state.result.items():
        first = {key.removeprefix("first_"): float(value) for key, value in values.items() if key.startswith("first_")}
        outputs[name] = DemoOutput(
            surrogate=values["surrogate"],
            r2_test=float(values["r2_test"]),
            r2_cv=float(values["r2_cv"]),
            determined=is_determined(float(values["r2_cv"])),
            strongest=first,
        )
    return DemoResult(
        points=points,
        outputs=outputs,
        blocks={name: BlockTotals(received=one.received, lost=one.lost) for name, one in state.blocks.items()},
        findings=tuple(findings),
        trigger=state.gsa_message,
        report=state.gsa.get("report"),
        seconds=seconds,
        machine_file=machine_file(machine),
        seed=seed,
        recording=recording,
    )


def print_tables(found: DemoResult, *, synthetic: bool) -> None:
    """Print what was predicted and measured, and what the sensitivity analysis found."""
    title = "Axial acceleration, RMS" + (" (synthetic recording)" if synthetic else "")
    table = narrow_table(title, "test point", ">node", ">predicted (g)", ">measured (g)", ">relative error")
    for point, row in found.points.items():
        figures = (
            _figure(row.predicted_g, ".3g"),
            _figure(row.measured_g, ".3g"),
            _figure(100.0 * row.relative_error, ".0f", " %"),
        )
        add_row(table, point, row.node, *figures)
    results.print(table)
    title = f"\nStrongest {_STRONGEST} inputs of each output, first Sobol index"
    table = narrow_table(title, "=output", "surrogate", ">R² test", ">R² cv", "inputs")
    for name, output in found.outputs.items():
        ranked = list(output.strongest.items())[:_STRONGEST]
        quality = (_figure(r2, ".3f") for r2 in (output.r2_test, output.r2_cv))
        shown = ranked_inputs(ranked) if output.determined else NOT_DETERMINED
        add_row(table, name, output.surrogate, *quality, shown)
    results.print(table)
    results.print("\nWhat explains the recording")
    for finding in found.findings:
        print_sentence(str(finding))
        if finding.folder is not None:
            results.print(f"  {Path(finding.folder) / PAGE_NAME}", highlight=False)
    results.print()
    lost = sum(count.lost for count in found.blocks.values())
    results.print(f"{found.seconds:.0f} s, {lost} blocks lost", highlight=False)
    results.print(f"report: {found.report}", highlight=False)


def _figure(value: float, form: str, unit: str = "") -> str:
    return format(value, form) + unit if math.isfinite(value) else "–"
