"""Tooth stiffness along the path of contact: Ishikawa's formula for external teeth, ISO 6336-1 for the ring tooth.

Ishikawa takes a tooth as a trapezoid on a rectangle and adds, for a normal force F at the radius r_x,

    δ_Br  bending of the rectangle,     δ_Bt  bending of the trapezoid,
    δ_s   shear,                        δ_G   tilting of the root,

and once for the pair δ_H, the flattening of the contact. The ring tooth, wide at its root and on a thick rim, takes the
share that ISO 6336-1:2006, equation (82), leaves a gear with many teeth, constant along the path.
"""

from __future__ import annotations

import math

import numpy as np

from tbm_dynamics.mesh.geometry import ExternalPair, GearPair, InternalPair
from tbm_dynamics.mesh.tooth import Tooth

# ISO 6336-1's q' with many teeth on both gears (m²/N); half of it belongs to either gear.
_ISO_CONSTANT = 0.04723e-9
# C_M: measured teeth against theoretical ones, c' = C_M/q'.
_ISO_CORRECTION = 0.8


def tooth_compliance(tooth: Tooth, radius: np.ndarray, width: float, elasticity: float, poisson: float) -> np.ndarray:
    """Deflection per normal force at the radii of contact, bending, shear and root, shape of `radius`, m/N."""
    form = max(tooth.form_radius, tooth.base_radius, tooth.root_radius)
    root_chord = 2.0 * form * float(np.sin(tooth.half_angle(form)))
    tip_chord = 2.0 * tooth.tip_radius * float(np.sin(tooth.half_angle(tooth.tip_radius)))
    foot = math.sqrt(tooth.root_radius**2 - (root_chord / 2.0) ** 2)
    height = math.sqrt(tooth.tip_radius**2 - (tip_chord / 2.0) ** 2) - foot
    rectangle = math.sqrt(form**2 - (root_chord / 2.0) ** 2) - foot
    apex = (height * root_chord - rectangle * tip_chord) / (root_chord - tip_chord)
    angle = tooth.half_angle(radius)
    lever = radius * np.cos(angle) - foot
    lean = np.cos(np.arccos(tooth.base_radius / radius) - angle) ** 2
    q = (apex - lever) / (apex - rectangle)
    cube = elasticity * width * root_chord**3
    bending = 12.0 * lean / cube * (lever * rectangle * (lever - rectangle) + rectangle**3 / 3.0)
    bending += 6.0 * lean / cube * (apex - rectangle) ** 3 * (q * (4.0 - q) - 2.0 * np.log(q) - 3.0)
    shear = 2.0 * (1.0 + poisson) * lean / (elasticity * width * root_chord)
    shear = shear * (rectangle - (apex - rectangle) * np.log(q))
    tilt = 24.0 * lever**2 * lean / (math.pi * elasticity * width * root_chord**2)
    return np.asarray(bending + shear + tilt)


def contact_compliance(width: float, elasticity: float, poisson: float) -> float:
    """Flattening of the pair per normal force, m/N."""
    return 4.0 * (1.0 - poisson**2) / (math.pi * elasticity * width)


def iso_flexibility(pinion_teeth: float, wheel_teeth: float, shifts: tuple[float, float] = (0.0, 0.0)) -> float:
    """How far a pair of teeth yields in theory per force and width, q' of ISO 6336-1:2006, equation (82), m²/N.

    `shifts` are the profile shift coefficients of pinion and wheel; infinitely many teeth yield least.
    """
    (z1, z2), (x1, x2) = (pinion_teeth, wheel_teeth), shifts
    flexibility = _ISO_CONSTANT + 0.15551e-9 / z1 + 0.25791e-9 / z2
    flexibility -= 0.00635e-9 * x1 + 0.11654e-9 * x1 / z1 + 0.00193e-9 * x2 + 0.24188e-9 * x2 / z2
    return flexibility + 0.00529e-9 * x1**2 + 0.00182e-9 * x2**2


def ring_compliance(teeth: int, width: float) -> float:
    """Deflection of an internal tooth per normal force, ISO 6336-1's share of a gear, m/N."""
    return (iso_flexibility(math.inf, teeth) - _ISO_CONSTANT / 2.0) / (_ISO_CORRECTION * width)


def mesh_stiffness(pair: GearPair, width: float, elasticity: float, poisson: float, phase: np.ndarray) -> np.ndarray:
    """Stiffness of all tooth pairs in contact at phases of the mesh cycle, shape of `phase`, N/m.

    Phase 0 is where a pair enters; with a contact ratio ε two pairs carry up to ε − 1, one after it.

    Parameters
    ----------
    pair : GearPair
    width : float
        Common face width (m).
    elasticity, poisson : float
        Pa, one.
    phase : ndarray
        Cycles, in [0, 1).
    """
    total = np.zeros_like(phase)
    for j in range(math.ceil(pair.contact_ratio)):
        total += pair_stiffness(pair, width, elasticity, poisson, phase + j)
    return total


def pair_stiffness(pair: GearPair, width: float, elasticity: float, poisson: float, along: np.ndarray) -> np.ndarray:
    """Stiffness of one tooth pair, mesh cycles `along` after it has entered, 0 when it has left; see above."""
    ratio = pair.contact_ratio
    curvature = pair.path_start + np.minimum(along, ratio) * pair.base_pitch
    compliance = _pair_compliance(pair, curvature, width, elasticity, poisson)
    return np.where(along < ratio, 1.0 / compliance, 0.0)


def _pair_compliance(
    pair: GearPair, curvature: np.ndarray, width: float, elasticity: float, poisson: float
) -> np.ndarray:
    """Deflection of a tooth pair per normal force at the pinion flank's radii of curvature (m), m/N."""
    fixed = contact_compliance(width, elasticity, poisson)
    if isinstance(pair, InternalPair):
        fixed += ring_compliance(pair.ring_teeth, width)
    radius = np.hypot(pair.pinion_base_radius, curvature)
    compliance = fixed + tooth_compliance(pair.pinion, radius, width, elasticity, poisson)
    if isinstance(pair, ExternalPair):
        # Between the points where the line of action touches the base circles the radii of curvature add up.
        radius = np.hypot(pair.driven_base_radius, pair.between_base_circles - curvature)
        compliance = compliance + tooth_compliance(pair.wheel, radius, width, elasticity, poisson)
    return compliance
