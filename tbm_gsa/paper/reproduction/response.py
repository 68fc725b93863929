"""Tables 2 and 3, Figures 5 and 7: how the machine vibrates under one reading of the dampings, beside a recording."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import scipy.signal

from tbm_dynamics import Response, simulate
from tbm_dynamics.calibration.targets import AXIAL_BAND_HZ
from tbm_dynamics.structure.system import System
from tbm_gsa.comparison.expected import expected_lines
from tbm_gsa.comparison.workflow import RecordingComparison, compare_recording
from tbm_gsa.paper.load_summary import found_line, line_amplitudes
from tbm_gsa.paper.published import ACCELERATION_LINE_HZ, MESH_LINES_HZ
from tbm_gsa.paper.reproduction.readings import Reading
from tbm_gsa.signals.clock import sampling_rate
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.units import STANDARD_GRAVITY

MULTIPLES: Final = 3
"""The mesh frequency and its multiples that are looked for."""
_SHOWN_S: Final = 1.0
_RESONANCE_STEP_HZ: Final = 0.1


@dataclass(frozen=True, eq=False)
class Excerpt:
    """A signal as Figure 5 shows it: a second of it and its amplitudes over frequency.

    Attributes
    ----------
    time, values : ndarray, shape (n,)
    frequency, amplitude : ndarray, shape (m,)
        Of sines, up to 220 Hz.
    """

    time: Array
    values: Array
    frequency: Array
    amplitude: Array


@dataclass(frozen=True, eq=False)
class ResponseEvidence:
    """Vibration under one reading.

    Attributes
    ----------
    reading : Reading
    seconds : float
        Of the run.
    rms_g : mapping of str to (x, y, z)
        Acceleration without its mean, by test point.
    peak_g : float
        Largest axial acceleration at the cutterhead.
    acceleration, mesh_force : Excerpt
        Axial at the cutterhead in g; of the first mesh in kN.
    axial_hz : tuple of float
        Undamped axial natural frequencies.
    resonance_hz : float or None
        Where the axial answer at the cutterhead to F_x is highest within Figure 5's band, dampings included; None where
        it has no maximum there.
    lines_hz : mapping of float to (float or None)
        Lines found in the acceleration by where they were looked for.
    mesh_lines_hz : mapping of float to (float or None)
        The same of the mesh force.
    indicators : mapping of str to float
        SI.
    comparison : RecordingComparison
        With the recording.
    """

    reading: Reading
    seconds: float
    rms_g: Mapping[str, tuple[float, ...]]
    peak_g: float
    acceleration: Excerpt
    mesh_force: Excerpt
    axial_hz: tuple[float, ...]
    resonance_hz: float | None
    lines_hz: Mapping[float, float | None]
    mesh_lines_hz: Mapping[float, float | None]
    indicators: Mapping[str, float]
    comparison: RecordingComparison


def gather_response(reading: Reading, bag: Path, seed: int, seconds: float, model_s: float) -> ResponseEvidence:
    """Run a machine and compare it with a recording.

    Parameters
    ----------
    reading : Reading
    bag : Path
    seed : int
        Of the loads.
    seconds : float
        Of the run.
    model_s : float
        Of the comparison's run.
    """
    machine = reading.machine
    response = simulate(machine, seconds, seed, settling=machine.settling())
    points = machine.description.test_points
    head = response.acceleration(points["cutterhead"], "x") / STANDARD_GRAVITY
    head = head - head.mean()
    force = response.mesh_force[:, 0] / 1e3
    wanted = [number * machine.mesh_frequency for number in range(1, MULTIPLES + 1)]
    return ResponseEvidence(
        reading=reading,
        seconds=seconds,
        rms_g={
            name: tuple((response.acceleration(node)[:, :3] / STANDARD_GRAVITY).std(axis=0).tolist())
            for name, node in points.items()
        },
        peak_g=float(np.abs(head).max()),
        acceleration=_excerpt(response.time, head),
        mesh_force=_excerpt(response.time, force),
        axial_hz=tuple(line.frequency_hz for line in expected_lines(machine) if line.kind == "axial"),
        resonance_hz=_resonance(
            machine.assemble(), machine.description.sensor_places["cutterhead"].node, machine.description.load_node
        ),
        lines_hz=_found(response, head, [ACCELERATION_LINE_HZ]),
        mesh_lines_hz=_found(response, force, [*wanted, *MESH_LINES_HZ]),
        indicators=response.indicators(),
        comparison=compare_recording(bag, machine, model_duration=model_s, seed=seed),
    )


def _found(response: Response, values: Array, wanted: list[float]) -> dict[float, float | None]:
    """Lines that stand out of a signal (n,), by where they were looked for (Hz)."""
    rate = sampling_rate(response.time)
    frequency, power = scipy.signal.periodogram(values, rate, "hann", detrend="constant", scaling="spectrum")
    return {line: found_line(frequency, power, line) for line in wanted}


def _excerpt(time: Array, values: Array) -> Excerpt:
    shown = time - time[0] < _SHOWN_S
    return Excerpt(time[shown], values[shown], *line_amplitudes(values, sampling_rate(time)))


def _resonance(system: System, point: int, load_node: int) -> float | None:
    """Maximum of the acceleration at a point per axial load within Figure 5's band, dampings included (Hz)."""
    low, high = AXIAL_BAND_HZ
    frequency = np.arange(low, high + 0.5 * _RESONANCE_STEP_HZ, _RESONANCE_STEP_HZ)
    force = np.zeros(system.size)
    force[system.dof(load_node, "ux")] = 1.0
    answer = [
        np.linalg.solve(system.K + 1j * w * system.C - w**2 * system.M, force)[system.dof(point, "ux")] * w**2
        for w in 2.0 * np.pi * frequency
    ]
    highest = int(np.argmax(np.abs(answer)))
    return float(frequency[highest]) if 0 < highest < len(frequency) - 1 else None
