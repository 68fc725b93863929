"""The cutterhead loads as the paper's Table 1 and Figure 4 show them: machine → one document and its signals."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
import scipy  # its parts load on first use

from tbm_dynamics import Machine
from tbm_dynamics.loads.stepper import LoadModel, load_stepper
from tbm_gsa.paper import TABLE_1, LoadRow
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

RATE_HZ: Final = 1000.0
SHORTEST_S: Final = 20.0
NEAR_HZ: Final = 0.5
AROUND_HZ: Final = 2.0
LEAST_PROMINENCE: Final = 20.0
"""Times the density around it: of the thousands of bins nearby, noise reaches this once in a hundred thousand runs."""


@dataclass(frozen=True, eq=False)
class LoadRun:
    """Loads over a stretch of time.

    Attributes
    ----------
    document : dict
        ``machine``, ``loads``, ``seed``, ``duration`` (s), ``operating_point{speed, torque, thrust}`` (SI), and
        ``components{fx …: {mean, rms, in_regions, lines[{paper_hz, found_hz}], paper_mean}}`` in N and N·m; `rms` is
        that of the fluctuation, `in_regions` the share of its power in Table 1's regions, `found_hz` null where no line
        stands out within 0.5 Hz.
    time : ndarray, shape (n,)
        s.
    values : ndarray, shape (n, 6)
        N and N·m.
    """

    document: dict[str, Any]
    time: Array
    values: Array


def load_run(machine: Machine, level: LoadModel = "spectral", duration: float = 600.0, seed: int = 0) -> LoadRun:
    """Evaluate the loads of a machine at its operating point and hold them against Table 1.

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
    document = {
        "machine": machine.name,
        "loads": level,
        "seed": seed,
        "duration": duration,
        "operating_point": asdict(point),
        "components": {name: component(values[:, i], TABLE_1[name]) for i, name in enumerate(TABLE_1)},
    }
    return LoadRun(document, time, values)


def component(values: Array, paper: LoadRow) -> dict[str, Any]:
    """Hold one component (n,), N or N·m at `RATE_HZ`, against its row of Table 1."""
    frequency, power = scipy.signal.periodogram(values, RATE_HZ, "hann", detrend="constant")
    total = float(power.sum())
    inside = np.any([(frequency >= low) & (frequency <= high) for low, high in paper.regions], axis=0)
    return {
        "mean": float(values.mean()),
        "rms": float(values.std()),
        "in_regions": float(power[inside].sum() / total) if total else 0.0,
        "lines": [{"paper_hz": line, "found_hz": found_line(frequency, power, line)} for line in paper.lines],
        "paper_mean": paper.mean,
    }


def found_line(frequency: Array, power: Array, wanted_hz: float) -> float | None:
    """Find the line nearest by: the strongest bin (Hz) within `NEAR_HZ`, if it stands out of the noise there."""
    distance = np.abs(frequency - wanted_hz)
    near = np.flatnonzero(distance <= NEAR_HZ)
    # The bins of noise are exponentially distributed: their mean is the median over ln 2, and no line moves a median.
    noise = float(np.median(power[distance <= AROUND_HZ])) / np.log(2.0)
    strongest = near[np.argmax(power[near])]
    return float(frequency[strongest]) if power[strongest] > LEAST_PROMINENCE * noise else None
