"""From a recording on disk to a comparison: reduce it, run the model at its levels of operation, compare."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from tbm_dynamics import Machine, MachineError, load_machine
from tbm_gsa.comparison.document import Provenance, comparison_document
from tbm_gsa.comparison.expected import ExpectedLine, lines_of_levels
from tbm_gsa.comparison.field_side import FieldSide, reduce_field
from tbm_gsa.comparison.levels import Course, NeverDrivenError, machine_course, recorded_course
from tbm_gsa.comparison.model_run import MODEL_RATE_HZ, run_model
from tbm_gsa.comparison.offline import Comparison, PointComparison, compare_signals
from tbm_gsa.signals.reduction import ReducedSignal, SignalReducer
from tbm_gsa.signals.settings import Settings
from tbm_msgs_py.base.errors import InputError, RecordingError
from tbm_msgs_py.base.texts import listed
from tbm_msgs_py.recordings.mapping import TopicMapping
from tbm_msgs_py.recordings.recording import RecordingReader, open_recording

LONGEST_MODEL_S = 3600.0
SHORTEST_MODEL_S = 1.0

Progress = Callable[[str, float | None], None]
"""Called with what is done now and the share of it, 0 to 1; None where the end is not known."""


@dataclass(frozen=True, eq=False)
class ComparisonResult:
    """A recording held against the model.

    Attributes
    ----------
    comparison : Comparison
        Of the points that machine and recording share, along the power flow.
    lines : tuple of ExpectedLine
        Of the machine at the levels of operation.
    starts_ns : mapping of str to int
        Header time of the first sample of each point.
    document : dict
        See `comparison_document`.
    """

    comparison: Comparison
    lines: tuple[ExpectedLine, ...]
    starts_ns: Mapping[str, int]
    document: dict[str, Any]


def compare_recording(
    bag: str | Path,
    machine: str | Path | Machine = "dz101",
    mapping: TopicMapping | str | Path | None = None,
    model_duration: float = 60.0,
    seed: int = 0,
    settings: Settings | None = None,
    progress: Progress = lambda *_: None,
) -> ComparisonResult:
    """Compare a recording with the model at the recorded levels of operation.

    Test points that the machine does not have, and those whose signal cannot be conditioned, are left out and named
    with the reason in the document; it is an error only when none is left.

    Parameters
    ----------
    bag : str or Path
        rosbag2 folder or bare MCAP file.
    machine : str, Path or Machine
        Name of a shipped machine, path of a machine file, or the machine itself.
    mapping : Mapping, str or Path, optional
        As in `open_recording`.
    model_duration : float
        Length of the model run at each level, s.
    seed : int
        Of its loads.
    settings : Settings, optional
        Windows and bands; the machine's lines are added to the expected ones.
    progress : callable, optional

    Returns
    -------
    ComparisonResult

    Raises
    ------
    RecordingError
        Nothing to read, or nothing to compare.
    MachineError
        No such machine, or one that cannot be built.
    InputError
        A duration or window that is not allowed.
    """
    chosen = settings or Settings()
    _check_lengths(model_duration, chosen.window_s)
    described = machine if isinstance(machine, Machine) else load_machine(machine)
    reader = open_recording(bag, mapping)
    shared = _shared_points(reader, described)
    field = reduce_field(reader, shared, chosen, progress=lambda seconds: progress(f"reading, {seconds:.0f} s", None))
    course = _course(reader, described, field)
    if len(course.dwells) > 1:
        # Now that the levels are known, once more: each has a spectrum of its own.
        field = reduce_field(reader, shared, chosen, course, lambda seconds: progress(f"levels, {seconds:.0f} s", None))
    machines = _machines(reader.path, course, described)
    lines = lines_of_levels(machines)
    named = {**{line.name: line.frequency for line in lines}, **chosen.expected_lines}
    chosen = replace(chosen, expected_lines=named)
    predicted = _model_side(machines, field.signals, chosen, (model_duration, seed), progress)
    comparison, failed = _compare_each(reader, field, predicted, chosen)
    skipped = {
        point: f"machine {described.name} has no such test point" for point in reader.sensors if point not in shared
    }
    provenance = Provenance(reader, described, course, lines, {**skipped, **failed}, seed, model_duration)
    return ComparisonResult(
        comparison,
        lines,
        {point: field.health[point].start_ns for point in comparison.points},
        comparison_document(field, comparison, provenance),
    )


def _check_lengths(model_duration: float, window_s: float) -> None:
    if not SHORTEST_MODEL_S <= model_duration <= LONGEST_MODEL_S:
        raise InputError(f"model_duration {model_duration:g} s, allowed: {SHORTEST_MODEL_S:g} to {LONGEST_MODEL_S:g} s")
    if not (window_s > 0.0 and math.isfinite(window_s)):
        raise InputError(f"window {window_s:g} s, allowed: a positive length")


def _shared_points(reader: RecordingReader, machine: Machine) -> list[str]:
    """Test points of the machine that are recorded, in the machine's order: along the power flow."""
    shared = [point for point in machine.description.test_points if point in reader.sensors]
    if not shared:
        raise RecordingError(
            f"{reader.path}: test points {listed(map(repr, reader.sensors))}: none is one of machine "
            f"{machine.name}, allowed: {listed(machine.description.test_points)}"
        )
    return shared


def _course(reader: RecordingReader, machine: Machine, field: FieldSide) -> Course:
    span = field.begin_ns, field.end_ns
    if reader.operating_point is None:
        return machine_course(machine, *span)
    try:
        return recorded_course(reader.operating_point, *span)
    except NeverDrivenError as error:
        raise RecordingError(f"{reader.path}: {error}") from error


def _machines(path: Path, course: Course, machine: Machine) -> dict[int, Machine]:
    """Give the machine at each level."""
    try:
        return {number: level.apply(machine) for number, level in enumerate(course.levels)}
    except MachineError as error:
        raise RecordingError(f"{path}: operating point: {error}") from error


def _model_side(
    machines: Mapping[int, Machine],
    field: Mapping[str, ReducedSignal],
    settings: Settings,
    run: tuple[float, int],
    progress: Progress,
) -> dict[int, dict[str, ReducedSignal]]:
    """Run the model at every level that a window belongs to, for (duration, seed)."""
    seen = {int(level) for signal in field.values() for level in signal.level}
    predicted = {}
    for level in sorted(seen & set(machines)):
        reducers = {
            point: SignalReducer(MODEL_RATE_HZ, signal.band, "rotating" if "yz" in signal.axes else "fixed", settings)
            for point, signal in field.items()
        }
        name = "model" if len(machines) == 1 else f"model, level {level + 1} of {len(machines)}"
        predicted[level] = run_model(machines[level], *run, reducers, partial(progress, name))
    return predicted


def _compare_each(
    reader: RecordingReader, field: FieldSide, predicted: Mapping[int, Mapping[str, ReducedSignal]], settings: Settings
) -> tuple[Comparison, dict[str, str]]:
    """Compare point by point, so that one dead sensor does not take the others with it; the failed with the reason."""
    compared: dict[str, PointComparison] = {}
    failed = {**field.failed, **reader.problems}
    for point, signal in field.signals.items():
        try:
            runs = {level: signals[point] for level, signals in predicted.items()}
            compared[point] = compare_signals(signal, runs, settings)
        except InputError as error:
            failed[point] = str(error)
    if not compared:
        reasons = (f"test point {point}: {reason}" for point, reason in failed.items())
        raise RecordingError(f"{reader.path}: {listed(reasons, separator='; ')}")
    return Comparison(compared, settings.window_s), failed
