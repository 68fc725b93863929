"""Vibration level of the linear system under the spectral loads, in the frequency domain: no run needed.

The loads' components are independent, so the power at a point is Σ_c ∫ |H_c(f)|² S_c(f) df, with the transfer function
H of the reduced system, couplings closed at their mean stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tbm_dynamics.frequency_response import FrequencyResponse
from tbm_dynamics.loads.spectral import TRANSITION_HZ
from tbm_dynamics.machine.machine import Machine
from tbm_dynamics.machine.stress import shaft_stresses
from tbm_dynamics.structure.system import System

_SPACING_HZ = 0.3
_AXIAL_SHARE = 0.3


@dataclass(frozen=True)
class Prediction:
    """What a calibration looks at.

    Attributes
    ----------
    rms : mapping of str to (3,) ndarray
        RMS acceleration of each test point along x, y, z (m/s²).
    axial_frequencies : (k,) ndarray
        Undamped natural frequencies (Hz) at which the cutterhead point moves axially, with a participation
        |φ| √m_head above 0.3.
    stress_used : float
        Largest stress of a shaft under the allowed loads, over the allowable one.
    """

    rms: Mapping[str, np.ndarray]
    axial_frequencies: np.ndarray
    stress_used: float


def predict(machine: Machine) -> Prediction:
    """Predict levels, axial natural frequencies and stresses of a machine that states an allowable stress."""
    system = machine.assemble()
    points = machine.description.sensor_places
    response = FrequencyResponse(system, np.vstack([place.rows(system) for place in points.values()]))
    power = np.zeros(3 * len(points))
    components = machine.description.loads.components
    for column, (component, scale) in enumerate(zip(components, machine.load_scale(), strict=True)):
        for region in component.regions:
            gain = np.abs(response.accelerance(_inside(*region.filled))[:, :, column])
            power += np.mean(gain**2, axis=0) * (region.rms * scale) ** 2
        for line in component.lines:
            gain = np.abs(response.accelerance(np.array([line.frequency]))[0, :, column])
            power += gain**2 * (line.amplitude * scale) ** 2 / 2.0
    rms = dict(zip(points, np.sqrt(power).reshape(-1, 3), strict=True))
    allowable = machine.description.steel.allowable_stress or math.inf
    used = max(one.stress for one in shaft_stresses(machine, system)) / allowable
    return Prediction(rms, _axial_frequencies(machine, system), used)


def _inside(low: float, high: float) -> np.ndarray:
    """Return middles of equal parts of what a region really fills: its filter falls off inside the limits.

    The lowest axial mode lies near the end of a region and is narrow, so the parts are too.
    """
    low, high = low + TRANSITION_HZ / 2.0, high - TRANSITION_HZ / 2.0
    count = math.ceil((high - low) / _SPACING_HZ)
    return np.asarray(low + (np.arange(count) + 0.5) * (high - low) / count)


def _axial_frequencies(machine: Machine, system: System) -> np.ndarray:
    head = machine.description.cutterhead_bearing_gear.shafts[0]
    frequencies, shapes = system.modes
    axial = np.abs(machine.description.sensor_places["cutterhead"].rows(system)[0] @ shapes)
    return np.asarray(frequencies[axial * np.sqrt(head.mass) > _AXIAL_SHARE])
