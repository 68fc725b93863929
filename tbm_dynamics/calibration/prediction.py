"""Vibration level and mesh force of the linear system under the spectral loads, in the frequency domain: no run needed.

The loads' components are independent, so the power at a point is Σ_c ∫ |H_c(f)|² S_c(f) df, with the transfer function
H of the reduced system, couplings closed at their mean stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from tbm_dynamics.integration.basis import split_basis
from tbm_dynamics.loads.spectral import TRANSITION_HZ
from tbm_dynamics.machine.machine import Machine
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
    mesh_lines : mapping of float to float
        Amplitude (N) of the first mesh's force at each frequency (Hz) of a line of the torque.
    """

    rms: Mapping[str, np.ndarray]
    axial_frequencies: np.ndarray
    mesh_lines: Mapping[float, float]


def predict(machine: Machine) -> Prediction:
    """Predict levels, axial natural frequencies and mesh-force lines of a machine."""
    system = machine.assemble()
    points = machine.description.test_points
    dofs = [system.dof(node, direction) for node in points.values() for direction in ("ux", "uy", "uz")]
    gain = _Gain(system, dofs)
    power, components = np.zeros(len(dofs)), machine.description.loads.components
    lines = {line.frequency: 0.0 for line in machine.description.loads.mx.lines}
    for column, (component, scale) in enumerate(zip(components, machine.load_scale(), strict=True)):
        for region in component.regions:
            values = [gain.acceleration(frequency)[:, column] for frequency in _inside(*region.filled)]
            power += np.mean(values, axis=0) * (region.rms * scale) ** 2
        for line in component.lines:
            amplitude = line.amplitude * scale
            power += gain.acceleration(line.frequency)[:, column] * amplitude**2 / 2.0
            if line.frequency in lines:
                # Phases are random: the components' shares add up as powers.
                share = gain.mesh_force(line.frequency)[column] * amplitude
                lines[line.frequency] = float(np.hypot(lines[line.frequency], share))
    rms = dict(zip(points, np.sqrt(power).reshape(-1, 3), strict=True))
    return Prediction(rms, _axial_frequencies(machine, system), lines)


class _Gain:
    """Transfer functions of the six loads, each frequency computed once."""

    def __init__(self, system: System, dofs: list[int]) -> None:
        self._parts = split_basis(system).symmetric
        self._dofs = dofs
        self._couplings = system.couplings
        self._at = cache(self._computed)

    def acceleration(self, frequency: float) -> np.ndarray:
        """|acceleration per load|² of the unknowns, shape (o, 6)."""
        return self._at(frequency)[0]

    def mesh_force(self, frequency: float) -> np.ndarray:
        """|force of the first mesh per load|, shape (6,)."""
        return self._at(frequency)[1]

    def _computed(self, frequency: float) -> tuple[np.ndarray, np.ndarray]:
        w = 2.0 * np.pi * frequency
        displacement, deflection = np.zeros((len(self._dofs), 7), complex), np.zeros(7, complex)
        for part in self._parts:
            m = part.shapes.shape[1]
            # Mass-orthonormal coordinates: H = [[0, 1], [−K, −C]].
            dynamic = -part.linear.H[m:, :m] - 1j * w * part.linear.H[m:, m:] - w**2 * np.eye(m)
            answer = np.linalg.solve(dynamic, part.linear.E[m:, : len(part.inputs)])
            displacement[:, part.inputs] += part.shapes[self._dofs] @ answer
            deflection[part.inputs] += self._couplings.rows[0] @ part.shapes @ answer
        law = self._couplings.stiffness[0] + 1j * w * self._couplings.damping[0]
        return np.abs(w**2 * displacement[:, :6]) ** 2, np.abs(law * deflection[:6])


def _inside(low: float, high: float) -> list[float]:
    """Return middles of equal parts of what a region really fills: its filter falls off inside the limits.

    The lowest axial mode lies near the end of a region and is narrow, so the parts are too.
    """
    low, high = low + TRANSITION_HZ / 2.0, high - TRANSITION_HZ / 2.0
    count = math.ceil((high - low) / _SPACING_HZ)
    return [low + (i + 0.5) * (high - low) / count for i in range(count)]


def _axial_frequencies(machine: Machine, system: System) -> np.ndarray:
    head = machine.description.cutterhead_bearing_gear.shafts[0]
    frequencies, shapes = system.modes
    axial = np.abs(shapes[system.dof(machine.description.test_points["cutterhead"], "ux")])
    return np.asarray(frequencies[axial * np.sqrt(head.mass) > _AXIAL_SHARE])
