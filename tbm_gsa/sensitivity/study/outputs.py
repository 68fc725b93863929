"""Outputs of a study by name: the eight indicators, and statistics of the acceleration at test points."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

from tbm_dynamics.indicators import EXPECTED_PEAKS, INDICATORS
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.signals.conditioning import HIGH_PASS_HZ, LOW_PASS_LIMIT_HZ, SHORTEST_S
from tbm_gsa.signals.windows import SEGMENT_S

OF_THE_DRIVE: Final = (*INDICATORS, *EXPECTED_PEAKS)
AXES: Final = ("x", "y", "z", "yz")
RESOLUTION_HZ: Final = 1.0 / SEGMENT_S
_NAME: Final = re.compile(
    r"(?P<statistic>rms|peak|kurtosis)_((?P<low>\d+(\.\d+)?)-(?P<high>\d+(\.\d+)?)_hz_)?(?P<point>.+)_(?P<axis>[xyz]+)"
)


@dataclass(frozen=True)
class Vibration:
    """A statistic of the acceleration at a test point, conditioned as a comparison does it.

    Parameters
    ----------
    name : str
    statistic : {"rms", "peak", "kurtosis"}
    band : (float, float) or None
        Hz; of an RMS only.
    point : str
    axis : {"x", "y", "z", "yz"}
        ``yz`` is √(y² + z²), which a sensor that turns with the head gives.
    """

    name: str
    statistic: str
    band: tuple[float, float] | None
    point: str
    axis: str


def parse_outputs(names: Sequence[str], points: Collection[str]) -> tuple[Vibration, ...]:
    """Sort out the outputs that are statistics of accelerations.

    Parameters
    ----------
    names : sequence of str
        Indicators, expected peaks, and ``rms_POINT_AXIS``, ``peak_POINT_AXIS``, ``kurtosis_POINT_AXIS`` or, in a band,
        ``rms_LOW-HIGH_hz_POINT_AXIS``.
    points : collection of str
        Test points of the machine.

    Raises
    ------
    StudyError
        A name that is neither.
    """
    return tuple(_vibration(name, points) for name in names if name not in OF_THE_DRIVE)


def checked_outputs(
    names: Sequence[str], points: Collection[str], duration: float, high_hz: float | None = None
) -> tuple[Vibration, ...]:
    """Sort out as `parse_outputs`, and refuse what runs of this length in this band give no numbers of.

    Parameters
    ----------
    names, points
        As of `parse_outputs`.
    duration : float
        Of a simulation, s.
    high_hz : float or None
        Upper limit of the band of accelerations, by default a comparison's.

    Raises
    ------
    StudyError
        A name that is unknown or given twice, runs too short to condition, a band beyond the one that signals are
        conditioned to (there is rounding noise only), or one that may lie between two frequencies of a transform.
    """
    check_distinct(names)
    vibrations = parse_outputs(names, points)
    if vibrations and duration < SHORTEST_S:
        raise StudyError(f"duration {duration:g} s, allowed: {SHORTEST_S:g} s or more for accelerations")
    highest = LOW_PASS_LIMIT_HZ if high_hz is None else high_hz
    for output in vibrations:
        low, high = output.band or (HIGH_PASS_HZ, highest)
        if low < HIGH_PASS_HZ or high > highest:
            allowed = f"inside the compared one, {HIGH_PASS_HZ:g} to {highest:g} Hz"
        elif output.band and high - low < RESOLUTION_HZ:
            allowed = f"{RESOLUTION_HZ:g} Hz wide or more"
        else:
            continue
        raise StudyError(f"output {output.name!r}: its band, allowed: {allowed}")
    return vibrations


def check_distinct(names: Sequence[str]) -> None:
    """Raise a StudyError where an output is given twice."""
    for name in names:
        if names.count(name) > 1:
            raise StudyError(f"output {name}: given twice, allowed: once")


def _vibration(name: str, points: Collection[str]) -> Vibration:
    found = _NAME.fullmatch(name)
    if found is None or found["point"] not in points or found["axis"] not in AXES:
        raise StudyError(
            f"unknown output {name!r}, allowed: {', '.join(OF_THE_DRIVE)}, and rms_POINT_AXIS, peak_POINT_AXIS, "
            f"kurtosis_POINT_AXIS, rms_LOW-HIGH_hz_POINT_AXIS with POINT one of {', '.join(points)} and AXIS one of "
            f"{', '.join(AXES)}"
        )
    band = None
    if found["low"] is not None:
        band = float(found["low"]), float(found["high"])
        if found["statistic"] != "rms" or band[0] >= band[1]:
            raise StudyError(f"output {name!r}: its band, allowed: of rms only, the lower limit below the upper")
    return Vibration(name, found["statistic"], band, found["point"], found["axis"])
