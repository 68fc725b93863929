"""Outputs of a study by name: the eight indicators, and statistics of the acceleration at test points."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

from tbm_dynamics.indicators import INDICATORS
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.signals.windows import SEGMENT_S

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
        Indicators, and ``rms_POINT_AXIS``, ``peak_POINT_AXIS``, ``kurtosis_POINT_AXIS`` or, in a band,
        ``rms_LOW-HIGH_hz_POINT_AXIS``.
    points : collection of str
        Test points of the machine.

    Raises
    ------
    StudyError
        A name that is neither.
    """
    return tuple(_vibration(name, points) for name in names if name not in INDICATORS)


def check_bands(outputs: Sequence[Vibration], low_hz: float, high_hz: float) -> None:
    """Refuse bands that are not in the one that signals are conditioned to: beyond it there is rounding noise only.

    Raises
    ------
    StudyError
        Such a band, or one that may lie between two frequencies of a transform.
    """
    for output in outputs:
        if output.band is None:
            continue
        low, high = output.band
        if not (low_hz <= low and high <= high_hz):
            raise StudyError(
                f"output {output.name!r}: its band, allowed: inside the compared one, {low_hz:g} to {high_hz:g} Hz"
            )
        if high - low < RESOLUTION_HZ:
            raise StudyError(f"output {output.name!r}: its band, allowed: {RESOLUTION_HZ:g} Hz wide or more")


def _vibration(name: str, points: Collection[str]) -> Vibration:
    found = _NAME.fullmatch(name)
    if found is None or found["point"] not in points or found["axis"] not in AXES:
        raise StudyError(
            f"unknown output {name!r}, allowed: {', '.join(INDICATORS)}, and rms_POINT_AXIS, peak_POINT_AXIS, "
            f"kurtosis_POINT_AXIS, rms_LOW-HIGH_hz_POINT_AXIS with POINT one of {', '.join(points)} and AXIS one of "
            f"{', '.join(AXES)}"
        )
    band = None
    if found["low"] is not None:
        band = float(found["low"]), float(found["high"])
        if found["statistic"] != "rms" or band[0] >= band[1]:
            raise StudyError(f"output {name!r}: its band, allowed: of rms only, the lower limit below the upper")
    return Vibration(name, found["statistic"], band, found["point"], found["axis"])
