"""Vibration level of the linear system under the spectral loads, in the frequency domain: no run needed.

The loads' components are independent, so the power at a point is Σ_c ∫ |H_c(f)|² S_c(f) df, with the transfer function
H of the reduced system, meshes closed at their mean stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tbm_dynamics.integration.basis import reduced_basis
from tbm_dynamics.loads.spectral import TRANSITION_HZ
from tbm_dynamics.machine.machine import Machine
from tbm_dynamics.structure.system import System

_CUTOFF_HZ = 250.0
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
    """

    rms: Mapping[str, np.ndarray]
    axial_frequencies: np.ndarray


def predict(machine: Machine) -> Prediction:
    """Predict levels and axial natural frequencies of a machine."""
    system = machine.assemble()
    basis = reduced_basis(system, _CUTOFF_HZ)
    points = machine.description.test_points
    dofs = [system.dof(node, direction) for node in points.values() for direction in ("ux", "uy", "uz")]
    power = _power(machine, system, basis, basis[dofs])
    rms = dict(zip(points, np.sqrt(power).reshape(-1, 3), strict=True))
    return Prediction(rms, _axial_frequencies(machine, system))


def _power(machine: Machine, system: System, basis: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Mean square acceleration of the rows (o, m) of the basis, shape (o,)."""
    mass, damping, stiffness = (basis.T @ matrix @ basis for matrix in (system.M, system.C, system.K))
    forces = basis[system.load_dofs].T
    known: dict[float, np.ndarray] = {}

    def gain(frequency: float) -> np.ndarray:
        """|acceleration per load|², shape (o, 6)."""
        if frequency not in known:
            w = 2.0 * np.pi * frequency
            dynamic = stiffness + 1j * w * damping - w**2 * mass
            known[frequency] = np.abs(w**2 * rows @ np.linalg.solve(dynamic, forces)) ** 2
        return known[frequency]

    power = np.zeros(len(rows))
    for column, (component, scale) in enumerate(
        zip(machine.description.loads.components, machine.load_scale(), strict=True)
    ):
        for region in component.regions:
            values = [gain(frequency)[:, column] for frequency in _inside(*region.filled)]
            power += np.mean(values, axis=0) * (region.rms * scale) ** 2
        for line in component.lines:
            power += gain(line.frequency)[:, column] * (line.amplitude * scale) ** 2 / 2.0
    return power


def _inside(low: float, high: float) -> list[float]:
    """Give middles of equal parts of what a region really fills: its filter falls off inside the limits.

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
