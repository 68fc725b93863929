"""Outputs of a study by name: the eight indicators, and statistics of the acceleration at test points.

A whole spectrum, ``spectrum_POINT_AXIS``, stands for many outputs, one a band; see `expanded_outputs`.
"""

import math
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise, takewhile
from typing import Final, TypeAlias

from tbm_dynamics.indicators import EXPECTED_PEAKS, INDICATORS
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.signals.conditioning import HIGH_PASS_HZ, LOW_PASS_LIMIT_HZ, SHORTEST_S
from tbm_gsa.signals.settings import band_name
from tbm_gsa.signals.windows import SEGMENT_S

OF_THE_DRIVE: Final = (*INDICATORS, *EXPECTED_PEAKS)
AXES: Final = ("x", "y", "z", "yz")
RESOLUTION_HZ: Final = 1.0 / SEGMENT_S
SPECTRUM: Final = "spectrum"
Band: TypeAlias = tuple[float, float]
"""Limits, Hz."""
_NAME: Final = re.compile(
    rf"(?P<statistic>rms|peak|kurtosis|{SPECTRUM})_((?P<low>\d+(\.\d+)?)-(?P<high>\d+(\.\d+)?)_hz_)?"
    r"(?P<point>.+)_(?P<axis>[xyz]+)"
)
# Number k of the first midband 1000 · 10^(k/10) Hz whose third octave is as wide as a transform resolves.
_FIRST: Final = math.ceil(10.0 * math.log10(RESOLUTION_HZ / 1000.0 / (10.0**0.05 - 10.0**-0.05)))
_LAST: Final = 30  # 0.7 MHz, beyond the rate of any run


@dataclass(frozen=True)
class Vibration:
    """A statistic of the acceleration at a test point, conditioned as a comparison does it.

    Parameters
    ----------
    name : str
    statistic : {"rms", "peak", "kurtosis", "spectrum"}
        The last is the RMS in a band of a spectrum.
    band : (float, float) or None
        Hz; of an RMS, and always of a spectrum.
    point : str
    axis : {"x", "y", "z", "yz"}
        ``yz`` is √(y² + z²), which a sensor that turns with the head gives.
    """

    name: str
    statistic: str
    band: Band | None
    point: str
    axis: str


def third_octaves(high_hz: float = LOW_PASS_LIMIT_HZ) -> tuple[Band, ...]:
    """Limits of the third octaves below a frequency that are 1 Hz wide or more, Hz, lowest first.

    Their midbands are those of base ten, 1000 · 10^(k/10) Hz, their limits 10^(±1/20) times that [1]_, here to four
    digits, as in the names; neighbours share theirs.

    References
    ----------
    .. [1] IEC 61260-1:2014, Electroacoustics – Octave-band and fractional-octave-band filters, 5.2 to 5.6.
    """
    limits = (float(f"{1000.0 * 10.0 ** ((2 * k - 1) / 20):.4g}") for k in range(_FIRST, _LAST))
    return tuple(pairwise(takewhile(lambda limit: limit <= high_hz, limits)))


def expanded_outputs(names: Sequence[str], high_hz: float | None = None) -> tuple[str, ...]:
    """Put the bands of a spectrum in its place.

    Parameters
    ----------
    names : sequence of str
        ``spectrum_POINT_AXIS`` among them becomes one name for each of the `third_octaves` inside the conditioned
        band, ``spectrum_LOW-HIGH_hz_POINT_AXIS``.
    high_hz : float or None
        Upper limit of the band of accelerations, by default a comparison's.

    Raises
    ------
    StudyError
        No third octave is inside the band.
    """
    highest, expanded = LOW_PASS_LIMIT_HZ if high_hz is None else high_hz, list[str]()
    for name in names:
        found = _NAME.fullmatch(name)
        if found is None or found["statistic"] != SPECTRUM or found["low"] is not None:
            expanded.append(name)
            continue
        bands = third_octaves(highest)
        if not bands:
            least = third_octaves()[0][1]
            raise StudyError(f"output {name!r}: no third octave below {highest:g} Hz, allowed: {least:g} Hz or more")
        expanded += [f"{SPECTRUM}_{band_name(*band)}_{found['point']}_{found['axis']}" for band in bands]
    return tuple(expanded)


def gathered_outputs(names: Sequence[str]) -> tuple[str, ...]:
    """Put each spectrum in the place of its bands: the inverse of `expanded_outputs`, for people to read."""
    wholes = {band: whole for whole, bands in spectrum_bands(names).items() for band in bands}
    return tuple(dict.fromkeys(wholes.get(name, name) for name in names))


def spectrum_bands(names: Sequence[str]) -> dict[str, dict[str, Band]]:
    """Return limits (Hz) of the bands of each spectrum among `expanded_outputs`, lowest first, by their names."""
    spectra: dict[str, dict[str, Band]] = {}
    for name in names:
        found = _NAME.fullmatch(name)
        if found is not None and found["statistic"] == SPECTRUM and found["low"] is not None:
            whole = f"{SPECTRUM}_{found['point']}_{found['axis']}"
            spectra.setdefault(whole, {})[name] = float(found["low"]), float(found["high"])
    return {whole: dict(sorted(bands.items(), key=lambda item: item[1])) for whole, bands in spectra.items()}


def bands_text(bands: Sequence[Band]) -> str:
    """Write bands, lowest first, neighbours as one: 4.467–7.079, 112.2–141.3 Hz."""
    ranges: list[Band] = []
    for low, high in bands:
        joined = ranges and ranges[-1][1] == low
        ranges[-1:] = [(ranges[-1][0], high)] if joined else [*ranges[-1:], (low, high)]
    return ", ".join(f"{low:g}–{high:g}" for low, high in ranges) + " Hz"


def parse_outputs(names: Sequence[str], points: Collection[str]) -> tuple[Vibration, ...]:
    """Sort out the outputs that are statistics of accelerations.

    Parameters
    ----------
    names : sequence of str
        Indicators, expected peaks, and ``rms_POINT_AXIS``, ``peak_POINT_AXIS``, ``kurtosis_POINT_AXIS`` or, in a band,
        ``rms_LOW-HIGH_hz_POINT_AXIS``; of spectra the bands, see `expanded_outputs`.
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
        As of `parse_outputs`, or whole spectra.
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
    for name in names:
        if name not in OF_THE_DRIVE:
            _read(name, points)  # as it was given, not one of its bands
    names = expanded_outputs(names, high_hz)
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
    found = _read(name, points)
    band = None if found["low"] is None else (float(found["low"]), float(found["high"]))
    if found["statistic"] == SPECTRUM:
        if band is None or band not in third_octaves(band[1]):
            raise StudyError(f"output {name!r}: its band, allowed: a third octave of {RESOLUTION_HZ:g} Hz or more")
    elif band is not None and (found["statistic"] != "rms" or band[0] >= band[1]):
        raise StudyError(f"output {name!r}: its band, allowed: of rms only, the lower limit below the upper")
    return Vibration(name, found["statistic"], band, found["point"], found["axis"])


def _read(name: str, points: Collection[str]) -> re.Match[str]:
    """Take a name apart, or raise a StudyError of one that is unknown."""
    found = _NAME.fullmatch(name)
    if found is None or found["point"] not in points or found["axis"] not in AXES:
        raise StudyError(
            f"unknown output {name!r}, allowed: {', '.join(OF_THE_DRIVE)}, and rms_POINT_AXIS, peak_POINT_AXIS, "
            f"kurtosis_POINT_AXIS, rms_LOW-HIGH_hz_POINT_AXIS, spectrum_POINT_AXIS with POINT one of "
            f"{', '.join(points)} and AXIS one of {', '.join(AXES)}"
        )
    return found
