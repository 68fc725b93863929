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

# Of Table 4's ranges.
_MIDDLE = {**dict.fromkeys(("x4", "x11", "x12", "x13", "x14", "x15"), 2.6e-3), "x16": 1.25}
_ENDS = {"x4": (2e-4, 2.6e-3, 5e-3), "x16": (0.5, 1.25, 2.0)}


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
    steel_share : float
        Of steel's damping (x4), beside the stiffness of the rock (x16), in the variance of the first pinion's axial
        level over the ranges of the paper's Table 4.
    """

    rms: Mapping[str, np.ndarray]
    axial_frequencies: np.ndarray
    stress_used: float
    steel_share: float


def predict(machine: Machine) -> Prediction:
    """Predict levels, axial natural frequencies and stresses of a machine that states an allowable stress."""
    system = machine.assemble()
    points = machine.description.sensor_places
    level = _levels(machine, system, np.vstack([place.rows(system) for place in points.values()]))
    allowable = machine.description.steel.allowable_stress or math.inf
    return Prediction(
        rms=dict(zip(points, level.reshape(-1, 3), strict=True)),
        axial_frequencies=_axial_frequencies(machine, system),
        stress_used=max(one.stress for one in shaft_stresses(machine, system)) / allowable,
        steel_share=_steel_share(machine),
    )


def _steel_share(machine: Machine) -> float:
    variance = {}
    for code, values in _ENDS.items():
        levels = []
        for value in values:
            variant = machine.with_inputs(**{**_MIDDLE, code: value})
            system = variant.assemble()
            pinion = np.zeros((1, system.size))
            pinion[0, system.dof(machine.description.driveshaft.pinion_nodes_from + 1, "ux")] = 1.0
            levels.append(_levels(variant, system, pinion)[0])
        variance[code] = np.var(levels)
    return float(variance["x4"] / sum(variance.values()))


def _levels(machine: Machine, system: System, observe: np.ndarray) -> np.ndarray:
    """RMS acceleration (k,) of the rows (k, n) of a motion, m/s²."""
    response, power = FrequencyResponse(system, observe), np.zeros(len(observe))
    components = machine.description.loads.components
    for column, (component, scale) in enumerate(zip(components, machine.load_scale(), strict=True)):
        for region in component.regions:
            gain = np.abs(response.accelerance(_inside(*region.filled))[:, :, column])
            power += np.mean(gain**2, axis=0) * (region.rms * scale) ** 2
        for line in component.lines:
            gain = np.abs(response.accelerance(np.array([line.frequency]))[0, :, column])
            power += gain**2 * (line.amplitude * scale) ** 2 / 2.0
    return np.sqrt(power)


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
