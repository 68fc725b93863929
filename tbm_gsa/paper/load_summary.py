"""The cutterhead loads as the paper's Table 1 and Figure 4 show them: machine → their summary and signals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy  # its parts load on first use

from tbm_dynamics import Machine
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
    """A line of Table 1 and where it was found, Hz; None where none stands out within `NEAR_HZ`."""

    paper_hz: float
    found_hz: float | None


class ComponentSummary(Part):
    """One component of the loads beside its row of Table 1.

    Attributes
    ----------
    mean, rms : float
        N or N·m; the RMS is that of the fluctuation.
    in_regions : float
        Share of the fluctuation's power in Table 1's regions.
    lines : tuple of LineSummary
    paper_mean : float
        Magnitude, N or N·m.
    """

    mean: float
    rms: float
    in_regions: float
    lines: tuple[LineSummary, ...]
    paper_mean: float

    @classmethod
    def of(cls, values: Array, paper: LoadRow) -> ComponentSummary:
        """Component of a signal (n,), N or N·m at `RATE_HZ`, beside a row of Table 1."""
        frequency, power = scipy.signal.periodogram(values, RATE_HZ, "hann", detrend="constant")
        total = float(power.sum())
        inside = np.any([(frequency >= low) & (frequency <= high) for low, high in paper.regions], axis=0)
        return cls(
            mean=float(values.mean()),
            rms=float(values.std()),
            in_regions=float(power[inside].sum() / total) if total else 0.0,
            lines=tuple(
                LineSummary(paper_hz=line, found_hz=found_line(frequency, power, line)) for line in paper.lines
            ),
            paper_mean=paper.mean,
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
    time : ndarray, shape (n,)
        s.
    values : ndarray, shape (n, 6)
        N and N·m.
    """

    summary: LoadSummary
    time: Array
    values: Array


def load_run(machine: Machine, level: LoadModel = "spectral", duration: float = 600.0, seed: int = 0) -> LoadRun:
    """Evaluate the loads of a machine at its operating point, beside Table 1.

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
    components = {name: ComponentSummary.of(values[:, i], TABLE_1[name]) for i, name in enumerate(TABLE_1)}
    summary = LoadSummary(
        machine=machine.name,
        machine_file=machine_file(machine),
        loads=level,
        seed=seed,
        duration=duration,
        operating_point=point,
        components=components,
    )
    return LoadRun(summary, time, values)


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
