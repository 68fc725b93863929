"""From a recording on disk to a comparison: read, run the model at the recorded operating point, compare."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from tbm_dynamics import Machine, Simulator, load_machine
from tbm_dynamics.integration.simulator import DEFAULT_STEP
from tbm_gsa.arrays import Array
from tbm_gsa.comparison.conditioning import Frame
from tbm_gsa.comparison.document import Provenance, comparison_document
from tbm_gsa.comparison.excerpt import Excerpt, take_excerpt
from tbm_gsa.comparison.expected import expected_lines
from tbm_gsa.comparison.offline import Comparison, PointComparison, Settings, compare_records
from tbm_gsa.comparison.operating import operating_level
from tbm_msgs_py.bags.errors import RecordingError
from tbm_msgs_py.bags.mapping import Mapping as TopicMapping
from tbm_msgs_py.recording import Recording, read_recording

LONGEST_MODEL_S = 300.0
SHORTEST_MODEL_S = 1.0
EXCERPT_S = 1.0
_CHUNK_STEPS = 8192

Computed = Mapping[str, tuple[Array, Array]]
"""Time (m,) s and acceleration (m, 3) m/s² by test point."""


@dataclass(frozen=True, eq=False)
class ComparisonResult:
    """A recording held against the model.

    Attributes
    ----------
    recording : Recording
    comparison : Comparison
        Of the points that machine and recording share.
    excerpt : Excerpt
        Of the first point along the power flow.
    document : dict
        See `comparison_document`.
    """

    recording: Recording
    comparison: Comparison
    excerpt: Excerpt
    document: dict[str, Any]


def compare_recording(
    bag: str | Path,
    machine: str | Path | Machine = "dz101",
    mapping: TopicMapping | str | Path | None = None,
    model_duration: float = 60.0,
    seed: int = 0,
    settings: Settings | None = None,
    progress: Callable[[float], None] | None = None,
) -> ComparisonResult:
    """Compare a recording with the model at the recorded operating point.

    Test points that the machine does not have, and those whose signal cannot be conditioned, are left out and named
    with the reason in the document; it is an error only when none is left.

    Parameters
    ----------
    bag : str or Path
        rosbag2 folder or bare MCAP file.
    machine : str, Path or Machine
        Name of a shipped machine, path of a machine file, or the machine itself.
    mapping : Mapping, str or Path, optional
        As in `read_recording`.
    model_duration : float
        Length of the model run, s.
    seed : int
        Of its loads.
    settings : Settings, optional
        Windows and bands; the machine's lines are added to the expected ones.
    progress : callable, optional
        Called with the share of the model run that is done, 0 to 1.

    Returns
    -------
    ComparisonResult

    Raises
    ------
    RecordingError
        Nothing to read, or nothing to compare.
    MachineError
        No such machine, or one that cannot be built.
    ValueError
        A duration or window that is not allowed.
    """
    chosen = settings or Settings()
    _check_lengths(model_duration, chosen.window_s)
    described = machine if isinstance(machine, Machine) else load_machine(machine)
    recording = read_recording(bag, mapping)
    shared = _shared_points(recording, described)
    operating = operating_level(recording, described)
    driven = operating.apply(described)
    lines = expected_lines(driven)
    named = {**{line.name: line.frequency for line in lines}, **chosen.expected_lines}
    computed = model_accelerations(driven, model_duration, seed, progress)
    comparison, failed = _compare_each(recording, shared, computed, replace(chosen, expected_lines=named))
    unknown = {
        point: f"machine {described.name} has no such test point" for point in recording.points if point not in shared
    }
    provenance = Provenance(driven, operating, lines, {**unknown, **failed}, seed, model_duration)
    return ComparisonResult(
        recording,
        comparison,
        _first_excerpt(recording, comparison, computed),
        comparison_document(recording, comparison, provenance),
    )


def model_accelerations(
    machine: Machine, duration: float, seed: int, progress: Callable[[float], None] | None = None
) -> Computed:
    """Accelerations of all test points at the default step.

    What `simulate` gives, without the displacements and mesh forces, for which a run of minutes has no room.
    """
    points = machine.description.test_points
    simulator = Simulator(machine.assemble(), points.values())
    loads = machine.loads(seed)
    time = np.arange(round(duration / DEFAULT_STEP), dtype=np.float64) * DEFAULT_STEP
    values = np.empty((len(points), time.size, 3))
    for first in range(0, time.size, _CHUNK_STEPS):
        part = slice(first, min(first + _CHUNK_STEPS, time.size))
        values[:, part] = simulator.step(loads.evaluate(time[part])).acceleration[:, :, :3].swapaxes(0, 1)
        if progress is not None:
            progress(part.stop / time.size)
    return {point: (time, values[i]) for i, point in enumerate(points)}


def _check_lengths(model_duration: float, window_s: float) -> None:
    if not SHORTEST_MODEL_S <= model_duration <= LONGEST_MODEL_S:
        raise ValueError(f"model_duration {model_duration:g} s, allowed: {SHORTEST_MODEL_S:g} to {LONGEST_MODEL_S:g} s")
    if not (window_s > 0.0 and math.isfinite(window_s)):
        raise ValueError(f"window {window_s:g} s, allowed: a positive length")


def _shared_points(recording: Recording, machine: Machine) -> list[str]:
    """Test points of the machine that are recorded, in the machine's order: along the power flow."""
    shared = [point for point in machine.description.test_points if point in recording.points]
    if not shared:
        raise RecordingError(
            f"{recording.path}: test points {', '.join(map(repr, recording.points))}: none is one of machine "
            f"{machine.name}, allowed: {', '.join(machine.description.test_points)}"
        )
    return shared


def _compare_each(
    recording: Recording, points: list[str], computed: Computed, settings: Settings
) -> tuple[Comparison, dict[str, str]]:
    """Compare point by point, so that one dead sensor does not take the others with it; the failed with the reason."""
    compared: dict[str, PointComparison] = {}
    failed: dict[str, str] = {}
    for point in points:
        record = recording.points[point]
        frames = {point: cast(Frame, record.frame)}
        try:
            compared |= compare_records({point: record}, computed, frames=frames, settings=settings).points
        except ValueError as error:
            failed[point] = str(error).removeprefix(f"test point {point}: ")
    if not compared:
        reasons = (f"test point {point}: {reason}" for point, reason in failed.items())
        raise RecordingError(f"{recording.path}: {'; '.join(reasons)}")
    return Comparison(compared, settings.window_s), failed


def _first_excerpt(recording: Recording, comparison: Comparison, computed: Computed) -> Excerpt:
    """Excerpt of the first point along the power flow, the cutterhead of a machine that has one."""
    name, point = next(iter(comparison.points.items()))
    return take_excerpt(name, recording.points[name], computed[name], point.model_rate_hz, point.band, EXCERPT_S)
