"""From a recording on disk to a comparison: reduce it, run the model at its levels of operation, compare."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from tbm_dynamics import Machine, MachineError, load_machine
from tbm_gsa.comparison.bands import bands_of_levels, machine_bands
from tbm_gsa.comparison.drives import DriveComparison
from tbm_gsa.comparison.expected import lines_of_levels
from tbm_gsa.comparison.field_side import FieldSide, reduce_field
from tbm_gsa.comparison.gathering import gathered
from tbm_gsa.comparison.levels import NeverDrivenError, OperatingHistory, machine_history, recorded_history
from tbm_gsa.comparison.model_run import run_model
from tbm_gsa.comparison.offline import PointComparison, compare_signals, highest_hz
from tbm_gsa.comparison.results import (
    ComparisonResult,
    ExpectedLine,
)
from tbm_gsa.signals.conditioning import LOW_PASS_SHARE
from tbm_gsa.signals.reduction import ReducedSignal, Series, SignalReducer, one_level
from tbm_gsa.signals.settings import Settings
from tbm_gsa.signals.spectrogram import Spectrogram
from tbm_msgs_py.base.errors import InputError, RecordingError
from tbm_msgs_py.base.fields import Vector3
from tbm_msgs_py.base.progress import Progress
from tbm_msgs_py.base.texts import listed
from tbm_msgs_py.recordings.mapping import TopicMapping
from tbm_msgs_py.recordings.recording import RecordingReader, open_recording
from tbm_msgs_py.recordings.recording_health import PointHealth

LONGEST_MODEL_S = 3600.0
SHORTEST_MODEL_S = 1.0
SHORTEST_WINDOW_S, LONGEST_WINDOW_S = 0.01, 86_400.0
LOWEST_HIGH_HZ = 10.0


@dataclass(frozen=True, eq=False)
class RecordingComparison:
    """A recording held against the model.

    Attributes
    ----------
    result : ComparisonResult
    excerpts : mapping of str to (Series, Series)
        A second of the axial acceleration of field and model, by test point.
    starts_ns : mapping of str to int
        Header time of the first sample of each point.
    spectrograms : mapping of str to (Spectrogram, Spectrogram)
        Of the axial acceleration of field and model, by test point; empty unless the settings ask for them.
    """

    result: ComparisonResult
    excerpts: Mapping[str, tuple[Series, Series]]
    starts_ns: Mapping[str, int]
    spectrograms: Mapping[str, tuple[Spectrogram, Spectrogram]]


def compare_recording(
    bag: str | Path,
    machine: str | Path | Machine = "dz101",
    mapping: TopicMapping | str | Path | None = None,
    model_duration: float = 60.0,
    seed: int = 0,
    settings: Settings | None = None,
    progress: Progress = lambda *_: None,
    span: tuple[float, float] | None = None,
    time_step: float | None = None,
) -> RecordingComparison:
    """Compare a recording with the model at the recorded levels of operation.

    Test points that the machine does not have, those whose topic is not in the recording, and those whose signal cannot
    be conditioned, are left out and named with the reason in the result; it is an error only when none is left.

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
    span : (float, float), optional
        Begin and end of the stretch that is compared, s after the first sample of all; by default the whole.
    time_step : float, optional
        Of the model, s; by default the machine's own.

    Raises
    ------
    RecordingError
        Nothing to read, or nothing to compare.
    MachineError
        No such machine, or one that cannot be built.
    InputError
        A duration, window or stretch that is not allowed.
    """
    chosen = _checked(settings or Settings(), model_duration, seed, span)
    described = machine if isinstance(machine, Machine) else load_machine(machine)
    step = described.step(time_step)  # a machine that cannot be run is refused before a long recording is read
    chosen = replace(chosen, model_rate_hz=1.0 / step)
    _check_band(chosen)
    reader = open_recording(bag, mapping)
    shared = _shared_points(reader, described)
    placed = described.with_offsets(_stated_offsets(reader, shared))
    field, history, machines, chosen = _read(reader, placed, shared, chosen, progress, span)
    lines = lines_of_levels(machines, highest_hz(chosen))
    chosen = _with_lines(chosen, lines)
    drives = DriveComparison(reader.drives, reader.drive_mapping, described, history, chosen)
    started = step, described.settling()
    predicted = _model_side(machines, field.signals, drives, chosen, (model_duration, seed), started, progress)
    _check_stretch(span, field, predicted, chosen.window_s)
    points, failed = _compare_each(reader, field, predicted, chosen)
    if not points and (drives.result is None or (shared and chosen.high_hz is not None)):
        reasons = [*(f"test point {point}: {reason}" for point, reason in failed.items()), *drives.problems]
        raise RecordingError(f"{reader.path}: {listed(reasons, separator='; ')}")
    run = model_duration, seed, *started
    result = gathered(reader, described, placed, field, history, points, failed, drives, chosen, lines, run)
    return RecordingComparison(
        result,
        {name: point.excerpts for name, point in points.items()},
        {name: field.health[name].start_ns for name in points},
        {name: point.spectrograms for name, point in points.items() if point.spectrograms},
    )


def _check_band(settings: Settings) -> None:
    """Refuse an upper limit that the runs of the model do not hold."""
    highest = LOW_PASS_SHARE * settings.model_rate_hz
    if settings.high_hz is not None and not LOWEST_HIGH_HZ <= settings.high_hz <= highest:
        raise InputError(
            f"upper limit of the band {settings.high_hz:g} Hz, allowed: {LOWEST_HIGH_HZ:g} to {highest:g}, "
            f"{LOW_PASS_SHARE:g} of the model's sampling rate"
        )


def _with_lines(settings: Settings, lines: Sequence[ExpectedLine]) -> Settings:
    """Return settings that expect the machine's lines, too."""
    return replace(
        settings, expected_lines={**{line.name: line.frequency_hz for line in lines}, **settings.expected_lines}
    )


def _check_stretch(
    span: tuple[float, float] | None, field: FieldSide, predicted: Mapping[str, ReducedSignal], window_s: float
) -> None:
    """Refuse a stretch without a window for which the model was run."""
    if span is not None and field.signals and not predicted:
        raise InputError(
            f"stretch from {span[0]:g} to {span[1]:g} s: no window of {window_s:g} s lies in it at a level of "
            "operation, allowed: a longer stretch, or shorter windows (one begins where the one before it ends)"
        )


def _checked(settings: Settings, model_duration: float, seed: int, span: tuple[float, float] | None) -> Settings:
    """Return the settings if all that is given is allowed."""
    if span is not None and not 0.0 <= span[0] < span[1]:
        raise InputError(f"stretch from {span[0]:g} to {span[1]:g} s, allowed: from 0 or later to a later time")
    if not SHORTEST_MODEL_S <= model_duration <= LONGEST_MODEL_S:
        raise InputError(f"model_duration {model_duration:g} s, allowed: {SHORTEST_MODEL_S:g} to {LONGEST_MODEL_S:g} s")
    if not SHORTEST_WINDOW_S <= settings.window_s <= LONGEST_WINDOW_S:
        raise InputError(f"window {settings.window_s:g} s, allowed: {SHORTEST_WINDOW_S:g} to {LONGEST_WINDOW_S:g} s")
    if not 0 <= seed < 2**31:
        raise InputError(f"seed {seed}, allowed: 0 to {2**31 - 1}")
    return settings


def _shared_points(reader: RecordingReader, machine: Machine) -> list[str]:
    """Test points of the machine that are recorded, in the machine's order: along the power flow."""
    shared = [point for point in machine.description.test_points if point in reader.sensors]
    if not shared and reader.drive_topic is None:
        raise RecordingError(
            f"{reader.path}: test points {listed(map(repr, reader.sensors))}: none is one of machine "
            f"{machine.name}, allowed: {listed(machine.description.test_points)}"
        )
    return shared


def _stated_offsets(reader: RecordingReader, points: Sequence[str]) -> dict[str, Vector3]:
    """Places of sensors that the mapping states, by test point; the machine states the others."""
    stated = {point: reader.sensors[point].offset for point in points}
    return {point: offset for point, offset in stated.items() if offset is not None}


def _read(
    reader: RecordingReader,
    machine: Machine,
    points: Sequence[str],
    settings: Settings,
    progress: Progress,
    span: tuple[float, float] | None,
) -> tuple[FieldSide, OperatingHistory, dict[int, Machine], Settings]:
    """Read the recorded side, how the machine was driven, what it is then, and settings with the bands of that."""
    chosen = settings if settings.bands else replace(settings, bands=machine_bands([machine], highest_hz(settings)))
    field = reduce_field(reader, points, chosen, progress=lambda done: progress(f"reading, {done:.0f} s", None))
    history = _history(reader, machine, field, span)
    machines = _machines(reader.path, history, machine)
    bands = settings.bands or bands_of_levels(chosen.bands, machines.values(), highest_hz(settings))
    if len(history.segments) > 1 or bands != chosen.bands:
        # Now that the levels are known, once more: each has a spectrum of its own, and gears mesh elsewhere.
        chosen = replace(chosen, bands=bands)
        field = reduce_field(
            reader, points, chosen, history, field.shifts, lambda done: progress(f"levels, {done:.0f} s", None)
        )
    return field, history, machines, chosen


def _history(
    reader: RecordingReader, machine: Machine, field: FieldSide, span: tuple[float, float] | None
) -> OperatingHistory:
    whole = field.begin_ns, field.end_ns
    begin_ns, end_ns = whole if span is None else _stretch(reader.path, *whole, *span)
    if reader.operating_point is None:
        return machine_history(machine, begin_ns, end_ns).within(*whole)
    try:
        return recorded_history(reader.operating_point, begin_ns, end_ns).within(*whole)
    except NeverDrivenError as error:
        raise RecordingError(f"{reader.path}: {error}") from error


def _stretch(path: Path, first_ns: int, last_ns: int, begin: float, end: float) -> tuple[int, int]:
    """Begin and end of a stretch of a recording on its clock."""
    duration = (last_ns - first_ns) * 1e-9
    if begin >= duration:
        raise RecordingError(f"{path}: lasts {duration:.6g} s, allowed: a stretch that begins before, not at {begin:g}")
    return first_ns + round(begin * 1e9), last_ns if end >= duration else first_ns + round(end * 1e9)


def _machines(path: Path, history: OperatingHistory, machine: Machine) -> dict[int, Machine]:
    """Machine at each level."""
    try:
        return {number: level.apply(machine) for number, level in enumerate(history.levels)}
    except MachineError as error:
        raise RecordingError(f"{path}: operating point: {error}") from error


def _model_side(
    machines: Mapping[int, Machine],
    field: Mapping[str, ReducedSignal],
    drives: DriveComparison,
    settings: Settings,
    run: tuple[float, int],
    started: tuple[float, float],
    progress: Progress,
) -> dict[str, ReducedSignal]:
    """Signals of the model at every level that a window belongs to, by test point.

    `run` are duration and seed, `started` time step and settling.
    """
    seen = {int(level) for signal in field.values() for level in signal.level} | drives.levels
    runs = []
    for level in sorted(seen & set(machines)):
        reducers = {
            point: SignalReducer(1.0 / started[0], signal.band, signal.frame, settings, one_level(level))
            for point, signal in field.items()
        }
        name = "model" if len(machines) == 1 else f"model, level {level + 1} of {len(machines)}"
        reducer, most = drives.reducer(level, machines[level], run[0], settings.model_rate_hz), highest_hz(settings)
        runs.append(run_model(machines[level], *run, reducers, *started, partial(progress, name), most, reducer))
    drives.finish()
    return {point: ReducedSignal.joined([signals[point] for signals in runs]) for point in field} if runs else {}


def _compare_each(
    reader: RecordingReader, field: FieldSide, predicted: Mapping[str, ReducedSignal], settings: Settings
) -> tuple[dict[str, PointComparison], dict[str, str]]:
    """Comparison of each point by itself, for a dead sensor must not end that of the others; reasons of the failed."""
    compared: dict[str, PointComparison] = {}
    unusable = dict(field.failed)
    for point, signal in field.signals.items():
        try:
            if point not in predicted:
                raise InputError("no window at a level of operation")
            compared[point] = compare_signals(signal, predicted[point], settings, reader.sensors[point].measured)
        except InputError as error:
            unusable[point] = str(error)
    # What was not used may be why too little is left.
    failed = {
        point: "; ".join([reason, *_came(field.health.get(point)), *reader.not_used(point)])
        for point, reason in unusable.items()
    }
    return compared, {**failed, **reader.problems}


def _came(health: PointHealth | None) -> Iterator[str]:
    """How many samples came in which time: more often than that by their steps where they are stamped in bunches."""
    if health is not None and health.duration > 0.0:
        mean = (health.samples - 1) / health.duration
        yield f"{health.samples} samples in {health.duration:.4g} s, {mean:.4g} Hz on average"
