"""The result of a comparison, from what was read, compared and left out."""

from collections.abc import Iterator, Mapping, Sequence

from tbm_dynamics import Machine
from tbm_gsa.comparison.change_times import change_times
from tbm_gsa.comparison.drives import DriveComparison
from tbm_gsa.comparison.field_side import FieldSide
from tbm_gsa.comparison.levels import OperatingHistory
from tbm_gsa.comparison.offline import PointComparison
from tbm_gsa.comparison.results import (
    ComparisonResult,
    DwellResult,
    ExpectedLine,
    LevelResult,
    RecordedPoint,
    RecordingResult,
)
from tbm_gsa.comparison.units import operating_doubts, unit_doubt
from tbm_gsa.provenance import machine_file, package_versions
from tbm_gsa.signals.intervals import CONFIDENCE
from tbm_gsa.signals.settings import Settings
from tbm_msgs_py.bags.metadata import is_synthetic
from tbm_msgs_py.base.units import iso_time
from tbm_msgs_py.recordings.mapping import SensorMapping
from tbm_msgs_py.recordings.recording import RecordingReader
from tbm_msgs_py.recordings.recording_health import PointHealth


def gathered(
    reader: RecordingReader,
    described: Machine,
    placed: Machine,
    field: FieldSide,
    history: OperatingHistory,
    points: Mapping[str, PointComparison],
    failed: Mapping[str, str],
    drives: DriveComparison,
    settings: Settings,
    lines: tuple[ExpectedLine, ...],
    run: tuple[float, int, float, float],
) -> ComparisonResult:
    """Gather what was read, compared and left out, and what it depends on.

    `run`: duration, seed, time step and settling of the model's.
    """
    places, changed = placed.description.sensor_places, change_times(points)
    return ComparisonResult(
        window_s=settings.window_s,
        confidence=CONFIDENCE,
        points={name: dict(point.axes) for name, point in points.items()},
        spectra={name: dict(point.spectra) for name, point in points.items()},
        nodes={name: places[name].node for name in points},
        offsets={name: places[name].offset for name in points if any(places[name].offset)},
        bands={name: point.band for name, point in points.items()},
        skipped={**_unknown_points(reader, described), **failed},
        left_out=tuple(reader.left_out),
        recording=_recording(reader, field),
        expected_lines=lines,
        machine=described.name,
        machine_file=machine_file(described),
        sources=reader.sources,
        doubts=(
            *reader.doubts,
            *_operating_doubts(history, described),
            *_unit_doubts(points),
            *_changed(changed),
            *drives.problems,
        ),
        operating_point=history.levels[0],
        levels=_levels(history, points),
        dwells=_dwells(history, field.begin_ns),
        changes=changed,
        model_duration=run[0],
        seed=run[1],
        time_step=run[2],
        settling=run[3],
        versions=package_versions(),
        synthetic=is_synthetic(reader.path),
        drives=drives.result,
    )


def _unknown_points(reader: RecordingReader, machine: Machine) -> dict[str, str]:
    """Name the recorded points that the machine does not have, with that as the reason."""
    missing = [point for point in reader.sensors if point not in machine.description.test_points]
    return dict.fromkeys(missing, f"machine {machine.name} has no such test point")


def _operating_doubts(history: OperatingHistory, machine: Machine) -> Iterator[str]:
    level, own = history.levels[0], machine.description.operating_point
    names = {"torque (kN·m)": "torque_kn_m", "thrust (kN)": "thrust_kn"}
    return operating_doubts(*({name: getattr(one, key) for name, key in names.items()} for one in (level, own)))


def _unit_doubts(points: Mapping[str, PointComparison]) -> Iterator[str]:
    for name, point in points.items():
        both = [(axis.field_rms or 0.0, axis.model_rms or 0.0) for axis in point.axes.values()]
        if doubt := unit_doubt(*zip(*both, strict=True)):
            yield f"test point {name}: {doubt}"


def _changed(times: Sequence[float]) -> Iterator[str]:
    if times:
        when = ", ".join(f"{time:.0f}" for time in times)
        yield (
            f"the vibration changes at {when} s while the machine is driven alike, and what is said is of all of it "
            "together; --begin and --end compare a stretch"
        )


def _levels(history: OperatingHistory, points: Mapping[str, PointComparison]) -> tuple[LevelResult, ...]:
    return tuple(
        LevelResult(**dict(level), points={name: dict(point.levels.get(number, {})) for name, point in points.items()})
        for number, level in enumerate(history.levels)
    )


def _dwells(history: OperatingHistory, origin_ns: int) -> tuple[DwellResult, ...]:
    return tuple(
        DwellResult(
            begin=(segment.begin_ns - origin_ns) * 1e-9,
            end=(segment.end_ns - origin_ns) * 1e-9,
            kind=segment.kind,
            level=segment.level,
        )
        for segment in history.segments
    )


def _recording(reader: RecordingReader, field: FieldSide) -> RecordingResult:
    return RecordingResult(
        path=str(reader.path),
        messages=reader.messages,
        lost=reader.lost,
        truncated=reader.truncated,
        damaged=reader.damaged,
        sha256=reader.sha256,
        begin=iso_time(field.begin_ns),
        duration=(field.end_ns - field.begin_ns) * 1e-9,
        points={name: _recorded(health, reader.sensors[name]) for name, health in field.health.items()},
    )


def _recorded(health: PointHealth, sensor: SensorMapping) -> RecordedPoint:
    counts = {**health.counts(), "gaps": tuple(health.gaps), "stuck": tuple(health.stuck)}
    counts["noise_power"] = sensor.noise_power_density(health.rate_hz) if health.rate_hz > 0.0 else None
    counts["band_hz"] = sensor.band_hz
    names = RecordedPoint.model_fields.keys() - counts.keys()
    return RecordedPoint.model_validate({**{name: getattr(health, name) for name in names}, **counts})
