"""The cutterhead loads beside what is stated of them, as Table 1 and Figure 4 show them: machine → summary, signals.

Of components whose source is `table1` the paper states means and frequencies, of others the machine file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy  # its parts load on first use

from tbm_dynamics import Machine
from tbm_dynamics.loads.description import COMPONENTS, LoadComponent
from tbm_dynamics.loads.stepper import LoadModel, load_stepper
from tbm_gsa.paper.published import TABLE_1, LoadRow
from tbm_gsa.provenance import machine_file
from tbm_gsa.reading import MachineFile, Part
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.operating_point import OperatingPoint

RATE_HZ: Final = 1000.0
SHORTEST_S: Final = 20.0
NEAR_HZ: Final = 0.5
AROUND_HZ: Final = 2.0
LEAST_PROMINENCE: Final = 20.0
"""Times the density around it: of the thousands of bins nearby, noise reaches this once in a hundred thousand runs."""
HIGHEST_HZ: Final = 220.0
RESOLUTION_HZ: Final = 0.25
"""Of the amplitudes that Figures 4 and 5 show."""


class LineSummary(Part):
    """A stated line and where it was found, Hz; None where none stands out within `NEAR_HZ`."""

    stated_hz: float
    paper_hz: float | None
    found_hz: float | None


class ComponentSummary(Part):
    """One component of the loads beside what is stated of it.

    Attributes
    ----------
    mean, rms : float
        N or N·m; the RMS is that of the fluctuation.
    in_regions : float
        Share of the fluctuation's power in the stated regions.
    lines : tuple of LineSummary
    stated_mean : float
        Magnitude, N or N·m.
    paper_mean : float or None
        The same if the paper states it.
    """

    mean: float
    rms: float
    in_regions: float
    lines: tuple[LineSummary, ...]
    stated_mean: float
    paper_mean: float | None

    @classmethod
    def of(cls, values: Array, stated: LoadRow) -> ComponentSummary:
        """Component of a signal (n,), N or N·m at `RATE_HZ`, beside what is stated."""
        of_paper = any(stated is row for row in TABLE_1.values())
        frequency, power = scipy.signal.periodogram(values, RATE_HZ, "hann", detrend="constant")
        total = float(power.sum())
        inside = np.any(
            [
                np.zeros(len(frequency), dtype=bool),
                *((frequency >= low) & (frequency <= high) for low, high in stated.regions),
            ],
            axis=0,
        )
        return cls(
            mean=float(values.mean()),
            rms=float(values.std()),
            in_regions=float(power[inside].sum() / total) if total else 0.0,
            lines=tuple(
                LineSummary(
                    stated_hz=line, paper_hz=line if of_paper else None, found_hz=found_line(frequency, power, line)
                )
                for line in stated.lines
            ),
            stated_mean=stated.mean,
            paper_mean=stated.mean if of_paper else None,
        )


class LoadSummary(Part):
    """What `machine loads --json` prints, SI units."""

    machine: str
    machine_file: MachineFile
    loads: LoadModel
    seed: int
    duration: float
    operating_point: OperatingPoint
    components: dict[str, ComponentSummary]


@dataclass(frozen=True, eq=False)
class LoadRun:
    """Loads over a time.

    Attributes
    ----------
    summary : LoadSummary
    stated : mapping of str to LoadRow
        By component.
    time : ndarray, shape (n,)
        s.
    values : ndarray, shape (n, 6)
        N and N·m.
    """

    summary: LoadSummary
    stated: Mapping[str, LoadRow]
    time: Array
    values: Array


def load_run(machine: Machine, level: LoadModel = "spectral", duration: float = 600.0, seed: int = 0) -> LoadRun:
    """Evaluate the loads of a machine at its operating point, beside what is stated of them.

    Raises
    ------
    MachineError
        A machine without the level, or an operating point that the machine or its rock does not allow.
    InputError
        Too short a duration to tell lines from noise.
    """
    if not SHORTEST_S <= duration < np.inf:
        raise InputError(f"duration {duration:g} s, allowed: {SHORTEST_S:g} s or more")
    loads = load_stepper(machine, level, seed)
    point = loads.reached(machine.operating_point)
    time = np.arange(round(duration * RATE_HZ)) / RATE_HZ
    values = loads.evaluate(point, point, time, point.speed * time)
    stated = {name: _stated(name, getattr(machine.description.loads, name)) for name in COMPONENTS}
    components = {name: ComponentSummary.of(values[:, i], row) for i, (name, row) in enumerate(stated.items())}
    summary = LoadSummary(
        machine=machine.name,
        machine_file=machine_file(machine),
        loads=level,
        seed=seed,
        duration=duration,
        operating_point=point,
        components=components,
    )
    return LoadRun(summary, stated, time, values)


def _stated(name: str, component: LoadComponent) -> LoadRow:
    """Row of Table 1, if the file names it as the source, else what the file itself states."""
    paper = TABLE_1[name]
    if component.source == "table1":
        return paper
    regions = tuple(region.band for region in component.regions)
    return LoadRow(paper.name, abs(component.mean), regions, tuple(line.frequency for line in component.lines))


def found_line(frequency: Array, power: Array, wanted_hz: float) -> float | None:
    """Strongest bin (Hz) within `NEAR_HZ` of a frequency; None where it does not stand out of the noise there."""
    distance = np.abs(frequency - wanted_hz)
    near = np.flatnonzero(distance <= NEAR_HZ)
    # The bins of noise are exponentially distributed: their mean is the median over ln 2, and no line moves a median.
    noise = float(np.median(power[distance <= AROUND_HZ])) / np.log(2.0)
    strongest = near[np.argmax(power[near])]
    return float(frequency[strongest]) if power[strongest] > LEAST_PROMINENCE * noise else None


def line_amplitudes(values: Array, rate_hz: float) -> tuple[Array, Array]:
    """Frequencies up to `HIGHEST_HZ` and amplitudes of sines in bins of `RESOLUTION_HZ` of a signal (n,)."""
    size = min(len(values), round(rate_hz / RESOLUTION_HZ))
    frequency, power = scipy.signal.welch(values, rate_hz, "hann", size, detrend="constant", scaling="spectrum")
    inside = frequency <= HIGHEST_HZ
    return frequency[inside], np.sqrt(2.0 * power[inside])
