"""The bands of a comparison: those of a machine, in which its loads fluctuate and its gears mesh, or stated ones."""

import math
import re
from collections.abc import Collection, Iterable, Iterator

from tbm_dynamics import Machine
from tbm_gsa.comparison.gears import gear_meshes
from tbm_gsa.comparison.levels import TOLERANCE
from tbm_gsa.signals.conditioning import HIGH_PASS_HZ
from tbm_gsa.signals.settings import band_name
from tbm_gsa.signals.windows import SEGMENT_S
from tbm_msgs_py.base.errors import InputError

Bands = tuple[tuple[float, float], ...]

MOST_BANDS = 24
_NUMBER = r"\d{1,5}(?:\.\d{1,3})?"


def machine_bands(machines: Iterable[Machine], high_hz: float) -> Bands:
    """Bands of a machine at its levels of operation, below `high_hz`: those of the loads, and one for each gear mesh.

    A mesh has the band of its frequency, which moves by the tolerance of a level, and of the sidebands of its gears,
    to whole Hz. One that lies in another band has none of its own.
    """
    found: list[tuple[float, float]] = []
    for machine in machines:
        found += [band for band in machine.driven_loads.bands if band not in found]
        for low, high in mesh_ranges(machine):
            wide = max(low * (1.0 - TOLERANCE), HIGH_PASS_HZ), high * (1.0 + TOLERANCE)
            if not within(wide, found):
                found.append((max(float(math.floor(wide[0])), HIGH_PASS_HZ), float(math.ceil(wide[1]))))
    return tuple(sorted(band for band in found if band[1] <= high_hz))


def bands_of_levels(known: Bands, machines: Collection[Machine], high_hz: float) -> Bands:
    """Bands at levels of operation: the known ones if they hold what meshes there, as they mostly do."""
    meshes = [span for machine in machines for span in mesh_ranges(machine) if span[1] <= high_hz]
    return known if all(within(span, known) for span in meshes) else machine_bands(machines, high_hz)


def mesh_ranges(machine: Machine) -> Iterator[tuple[float, float]]:
    """Frequencies of each gear mesh with its sidebands, Hz; none of a machine that stands still."""
    for mesh in gear_meshes(machine):
        if mesh.frequency_hz > HIGH_PASS_HZ:
            reach = max(mesh.sidebands(0.0).values())
            yield mesh.frequency_hz - reach, mesh.frequency_hz + reach


def within(span: tuple[float, float], bands: Iterable[tuple[float, float]]) -> bool:
    """Whether frequencies lie in one of the bands."""
    return any(low <= span[0] and span[1] <= high for low, high in bands)


def parse_bands(text: str, high_hz: float) -> Bands:
    """Bands written as ``0.5-20,60-120``, in Hz.

    Raises
    ------
    InputError
        No such list, a band outside what is compared, narrower than the transforms tell, or given twice.
    """
    found: list[tuple[float, float]] = []
    for part in text.split(","):
        match = re.fullmatch(rf"\s*({_NUMBER})\s*-\s*({_NUMBER})\s*", part)
        low, high = map(float, match.groups()) if match else (0.0, 0.0)
        if not HIGH_PASS_HZ <= low <= high - 1.0 / SEGMENT_S or high > high_hz:
            raise InputError(
                f"band {part.strip()!r}, allowed: LOW-HIGH in Hz from {HIGH_PASS_HZ:g} to {high_hz:g}, "
                f"{1.0 / SEGMENT_S:g} Hz wide or more, as in 0.5-20,60-120"
            )
        found.append((low, high))
    if len({band_name(*band) for band in found}) < len(found) or len(found) > MOST_BANDS:
        raise InputError(f"bands {text!r}, allowed: up to {MOST_BANDS} bands, each once")
    return tuple(found)
