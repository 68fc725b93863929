"""Timoshenko beam element with axial and torsional stiffness, circular section.

Consistent mass with rotary inertia, shear deformation Φ = 12EI/(κGAL²): Przemieniecki, Theory of Matrix
Structural Analysis (1968); shear coefficients: Cowper, J. Appl. Mech. 33 (1966).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

# Where the 4 bending coordinates (v1, θ1, v2, θ2) of each plane sit among the element's 12.
_XY_PLANE = np.array([1, 5, 7, 11])
_XZ_PLANE = np.array([2, 4, 8, 10])
_AXIAL = np.array([0, 6])
_TORSION = np.array([3, 9])
# In the x–z plane a positive θy lowers z: the v–θ terms change sign.
_FLIP = np.outer([1, -1, 1, -1], [1, -1, 1, -1])


@dataclass(frozen=True)
class Section:
    """Circular section: area (m²), second moment (m⁴), polar moment (m⁴), shear coefficient κ."""

    area: float
    second_moment: float
    polar_moment: float
    shear_coefficient: float


def circular_section(outer_diameter: float, inner_diameter: float, poisson: float) -> Section:
    """Solid or hollow circular section (Cowper's κ)."""
    outer, inner = outer_diameter / 2.0, inner_diameter / 2.0
    second = math.pi / 4.0 * (outer**4 - inner**4)
    ratio = (inner / outer) ** 2
    whole = (7.0 + 6.0 * poisson) * (1.0 + ratio) ** 2
    kappa = 6.0 * (1.0 + poisson) * (1.0 + ratio) ** 2 / (whole + (20.0 + 12.0 * poisson) * ratio)
    return Section(math.pi * (outer**2 - inner**2), second, 2.0 * second, kappa)


def beam_stiffness(section: Section, length: float, elasticity: float, poisson: float) -> np.ndarray:
    """Element stiffness, shape (12, 12), coordinates (ux, uy, uz, θx, θy, θz) of both ends, axis along x."""
    shear = elasticity / (2.0 * (1.0 + poisson))
    phi = _shear_parameter(section, length, elasticity, poisson)
    L = length
    bending = (elasticity * section.second_moment / ((1.0 + phi) * L**3)) * np.array(
        [
            [12.0, 6.0 * L, -12.0, 6.0 * L],
            [6.0 * L, (4.0 + phi) * L**2, -6.0 * L, (2.0 - phi) * L**2],
            [-12.0, -6.0 * L, 12.0, -6.0 * L],
            [6.0 * L, (2.0 - phi) * L**2, -6.0 * L, (4.0 + phi) * L**2],
        ]
    )
    pair = np.array([[1.0, -1.0], [-1.0, 1.0]])
    axial = elasticity * section.area / L * pair
    torsion = shear * section.polar_moment / L * pair
    return _place(bending, axial, torsion)


def beam_mass(section: Section, length: float, density: float, elasticity: float, poisson: float) -> np.ndarray:
    """Consistent element mass with rotary inertia, shape (12, 12), coordinates as `beam_stiffness`."""
    phi = _shear_parameter(section, length, elasticity, poisson)
    L = length
    m1 = 13.0 / 35.0 + 7.0 * phi / 10.0 + phi**2 / 3.0
    m2 = (11.0 / 210.0 + 11.0 * phi / 120.0 + phi**2 / 24.0) * L
    m3 = 9.0 / 70.0 + 3.0 * phi / 10.0 + phi**2 / 6.0
    m4 = (13.0 / 420.0 + 3.0 * phi / 40.0 + phi**2 / 24.0) * L
    m5 = (1.0 / 105.0 + phi / 60.0 + phi**2 / 120.0) * L**2
    m6 = (1.0 / 140.0 + phi / 60.0 + phi**2 / 120.0) * L**2
    translation = np.array([[m1, m2, m3, -m4], [m2, m5, m4, -m6], [m3, m4, m1, -m2], [-m4, -m6, -m2, m5]])
    n1 = 6.0 / 5.0
    n2 = (1.0 / 10.0 - phi / 2.0) * L
    n3 = (2.0 / 15.0 + phi / 6.0 + phi**2 / 3.0) * L**2
    n4 = (-1.0 / 30.0 - phi / 6.0 + phi**2 / 6.0) * L**2
    rotation = np.array([[n1, n2, -n1, n2], [n2, n3, -n2, n4], [-n1, -n2, n1, -n2], [n2, n4, -n2, n3]])
    scale = density / (1.0 + phi) ** 2
    bending = scale * (section.area * L * translation + section.second_moment / L * rotation)
    pair = np.array([[2.0, 1.0], [1.0, 2.0]]) * density * L / 6.0
    return _place(bending, section.area * pair, section.polar_moment * pair)


def _shear_parameter(section: Section, length: float, elasticity: float, poisson: float) -> float:
    shear = elasticity / (2.0 * (1.0 + poisson))
    return 12.0 * elasticity * section.second_moment / (section.shear_coefficient * shear * section.area * length**2)


def _place(bending: np.ndarray, axial: np.ndarray, torsion: np.ndarray) -> np.ndarray:
    matrix = np.zeros((12, 12))
    matrix[np.ix_(_XY_PLANE, _XY_PLANE)] = bending
    matrix[np.ix_(_XZ_PLANE, _XZ_PLANE)] = bending * _FLIP
    matrix[np.ix_(_AXIAL, _AXIAL)] = axial
    matrix[np.ix_(_TORSION, _TORSION)] = torsion
    return matrix


def along_direction(matrix: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Turn an element matrix from its own axis x to `direction` (3,); circular sections have no other axis."""
    x = direction / np.linalg.norm(direction)
    # Across it, in the plane of the global axis that it is not along.
    y = np.array([-x[1], x[0], 0.0]) if abs(x[2]) < 0.9 else np.array([x[2], 0.0, -x[0]])
    y /= np.linalg.norm(y)
    z = np.array([x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]])
    turn = np.array([x, y, z])
    blocks = matrix.reshape(4, 3, 4, 3).transpose(0, 2, 1, 3)
    return np.asarray((turn.T @ blocks @ turn).transpose(0, 2, 1, 3).reshape(12, 12))
