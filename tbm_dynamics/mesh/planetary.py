"""A planetary stage of a gearbox: sun driven, ring held, carrier driving; condensed to a torsional law at the carrier.

In the frame of the carrier the sun drives the planets and each planet drives the ring. With sun and ring held, turning
the carrier back by δ presses both flanks of a planet, which turns on its pin by θ_p until both carry the same force F.
With the excess of material e on the flanks, base radii r_bs, r_b and r_br of sun, planet and ring, and forces in the
transverse section,

    F = k_sp ((r_bs + r_b) δ − r_b θ_p + e_sp) = k_pr ((r_br − r_b) δ + r_b θ_p + e_pr)
      = k_path (lever δ + e_sp + e_pr),
    1/k_path = 1/k_sp + 1/k_pr,   lever = r_bs + r_br,

and the planets together make the torque T = lever² Σ k_path δ + lever Σ k_path (e_sp + e_pr). As the sun's base radius
is lever/ratio, δ stands for the turn of a free sun over the ratio less that of the carrier. Pins, bearings and gear
bodies are rigid, the sun stays central and contact is never lost.

Phases are in mesh cycles φ; φ = 0 where a tooth of the sun and planet 0 touch at the pitch point. A wave over φ is
c0 + Σ c_n cos 2πnφ + s_n sin 2πnφ.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from tbm_dynamics.mesh.error import composite_tolerances
from tbm_dynamics.mesh.geometry import ExternalPair, GearPair, HelixAngle, InternalPair, Shift
from tbm_dynamics.mesh.ishikawa import mesh_stiffness
from tbm_dynamics.mesh.stiffness import HARMONICS, PATTERN_PARTS, rounded_variation
from tbm_dynamics.mesh.tooth import GearError, named
from tbm_dynamics.mesh.waves import series, shifted
from tbm_msgs_py.base.fields import Positive, Source, SparseModel

SAME_PLACE = 1e-3
"""Modules by which the planets' distances from sun and ring may differ: profile shifts of a drawing are rounded."""

GOLDEN = 0.6180339887498949
"""Spacing of phases that no assembly aligns, as the run-out of planets and pinions: fixed, no two alike (assumed)."""


class PlanetaryStage(SparseModel):
    """Gears of a stage with standard addenda and equally spaced planets.

    Planet j stands at ψ_j = 2πj/N of the carrier, counted against the turn of the planets relative to the carrier (the
    way the sun turns).

    Attributes
    ----------
    sun_teeth, planet_teeth, ring_teeth, planets : int
        z_s, z_p, z_r, N.
    module, face_width : float
        m.
    pressure_angle_deg : float
        As the module in the normal section.
    helix_angle_deg : float
    profile_shift : (float, float, float)
        Of sun, planets and ring in modules, each positive away from its axis.
    accuracy_grade : int
        ISO 1328-1, all gears.
    """

    optional: ClassVar[tuple[str, ...]] = ("helix_angle_deg", "profile_shift")

    sun_teeth: Annotated[int, Field(ge=5)]
    planet_teeth: Annotated[int, Field(ge=5)]
    ring_teeth: Annotated[int, Field(ge=10)]
    planets: Annotated[int, Field(ge=1, le=12)]
    module: Positive
    pressure_angle_deg: Annotated[float, Field(gt=10.0, lt=35.0)]
    helix_angle_deg: HelixAngle = 0.0
    profile_shift: tuple[Shift, Shift, Shift] = (0.0, 0.0, 0.0)
    face_width: Positive
    accuracy_grade: Annotated[int, Field(ge=0, le=12)]
    source: Source

    @property
    def pressure_angle(self) -> float:
        """α (rad)."""
        return math.radians(self.pressure_angle_deg)

    @property
    def sun_mesh(self) -> ExternalPair:
        """The sun driving a planet."""
        return ExternalPair(self.sun_teeth, self.planet_teeth, *self._section, *self.profile_shift[:2])

    @property
    def ring_mesh(self) -> InternalPair:
        """A planet driving the ring."""
        return InternalPair(self.planet_teeth, self.ring_teeth, *self._section, *self.profile_shift[1:])

    @property
    def _section(self) -> tuple[float, float, float]:
        """Module (m), pressure angle and helix angle (rad) of all gears."""
        return self.module, self.pressure_angle, math.radians(self.helix_angle_deg)

    @property
    def ratio(self) -> float:
        """Turns of the sun per turn of the carrier, 1 + z_r/z_s (Willis)."""
        return 1.0 + self.ring_teeth / self.sun_teeth

    @property
    def centre_distance(self) -> float:
        """Of sun and planet (m)."""
        return self.sun_mesh.centre_distance

    @property
    def lever(self) -> float:
        """Carrier torque per tooth force of one planet, the base radii of sun and ring (m): 2 a cos α without shift."""
        return self.sun_mesh.pinion_base_radius + self.ring_mesh.driven_base_radius

    @property
    def sun_phases(self) -> np.ndarray:
        """Mesh cycles by which sun–planet mesh j lags that of planet 0, z_s ψ_j/2π, shape (N,).

        Parker and Lin, J. Mech. Des. 126 (2004) 525–534, planets turning clockwise and ψ counter-clockwise.
        """
        return self.sun_teeth * np.arange(self.planets) / self.planets

    @property
    def ring_phases(self) -> np.ndarray:
        """Mesh cycles by which planet–ring mesh j lags that of planet 0, −z_r ψ_j/2π, shape (N,) (source as above)."""
        return -self.ring_teeth * np.arange(self.planets) / self.planets

    @property
    def ring_lag(self) -> float:
        """Mesh cycles γ_rs by which a planet touches the ring at the pitch point after it touches the sun there.

        The two contacts are on opposite flanks half a turn apart, at the pitch circles of either mesh: the planet has
        to turn by half a turn less the mean of its tooth's thicknesses there. Without profile shift that is 0 for an
        odd number of planet teeth, ½ for an even one (source as above).
        """
        tooth, pitches = self.ring_mesh.pinion, (self.sun_mesh.driven_pitch_radius, self.ring_mesh.pinion_pitch_radius)
        thickness = sum(float(tooth.half_angle(radius)) for radius in pitches)
        return round(self.planet_teeth * (0.5 - thickness / (2.0 * math.pi)), 12) % 1.0

    def check(self) -> None:
        """Raise what keeps the stage from being assembled.

        Raises
        ------
        GearError
            Teeth that do not fit around each other, planets that cannot be spaced equally or touch, or pairs that
            cannot mesh.
        """
        if self.planets < 2:
            raise GearError(f"planets {self.planets}: at least 2, spaced equally")
        self._check_distances()
        if (self.sun_teeth + self.ring_teeth) % self.planets:
            raise GearError(
                f"planets {self.planets}: sun_teeth + ring_teeth = {self.sun_teeth + self.ring_teeth} must be a "
                f"multiple of it for equal spacing"
            )
        gap = 2.0 * (self.centre_distance * math.sin(math.pi / self.planets) - self.sun_mesh.wheel.tip_radius)
        if gap <= 0.0:
            raise GearError(
                f"planets {self.planets}: tip circles of neighbours are {gap * 1e3:.3g} mm apart, must be more than 0"
            )
        with named("sun-planet mesh"):
            self.sun_mesh.check()
        with named("planet-ring mesh"):
            self.ring_mesh.check()

    def _check_distances(self) -> None:
        """Refuse gears whose planets cannot run with both the sun and the ring."""
        fitting = self.sun_teeth + 2 * self.planet_teeth
        if self.ring_teeth != fitting and not any(self.profile_shift):
            raise GearError(f"ring_teeth {self.ring_teeth}: sun_teeth + 2 planet_teeth is {fitting}")
        distances = [mesh.centre_distance for mesh in (self.sun_mesh, self.ring_mesh)]
        if abs(distances[0] - distances[1]) > SAME_PLACE * self.module:
            sun, ring = (f"{1e3 * distance:.6g} mm" for distance in distances)
            raise GearError(
                f"profile shifts: planets run with the sun at {sun}, with the ring at {ring}, allowed: "
                f"{SAME_PLACE:g} modules apart at most"
            )


@dataclass(frozen=True)
class StageLaw:
    """Torsional law of a stage at its carrier, T = (δ + e)/compliance.

    δ is the turn of the sun over the ratio less that of the carrier; without torque the carrier is ahead by e, the
    static transmission error.

    Attributes
    ----------
    compliance : (1 + 2h,) ndarray
        Mean, then cosine and sine of each harmonic of the mesh cycle, rad/(N·m).
    tooth_error : (2,) ndarray
        Cosine and sine of e once per mesh cycle, rad.
    planet_error : (2,) ndarray
        Cosine and sine of e once per turn of the planets relative to the carrier, z_p mesh cycles, rad.
    """

    compliance: np.ndarray
    tooth_error: np.ndarray
    planet_error: np.ndarray


@lru_cache(maxsize=16)
def stage_law(stage: PlanetaryStage, elasticity: float, poisson: float, harmonics: int) -> StageLaw:
    """Condense a stage to its carrier; the last are kept, for the machines of a study differ in other parts.

    Parameters
    ----------
    stage : PlanetaryStage
        One that passes its check.
    elasticity, poisson : float
        Pa, one.
    harmonics : int
        h, kept of the compliance; below 1024.
    """
    cycles = np.arange(PATTERN_PARTS) / PATTERN_PARTS
    sun, ring = tooth_stiffness(stage, elasticity, poisson, cycles)
    stiffness = stage.lever**2 * np.sum(sun * ring / (sun + ring), axis=1)
    found = np.fft.rfft(1.0 / stiffness)[: harmonics + 1] / PATTERN_PARTS
    compliance = np.empty(1 + 2 * harmonics)
    compliance[0], compliance[1::2], compliance[2::2] = found[0].real, 2.0 * found[1:].real, -2.0 * found[1:].imag
    return StageLaw(compliance, _tooth_error(stage), _planet_error(stage))


def tooth_stiffness(
    stage: PlanetaryStage, elasticity: float, poisson: float, cycles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness of the sun–planet and of the planet–ring meshes at mesh phases (n,), each (n, N), N/m.

    Ishikawa's over the path of contact with its own mean, rounded like that of the pinions.
    """
    middles = (np.arange(PATTERN_PARTS) + 0.5) / PATTERN_PARTS
    waves = series(cycles, HARMONICS)
    sun, ring = (
        mesh_stiffness(pair, stage.face_width, elasticity, poisson, middles)
        for pair in (stage.sun_mesh, stage.ring_mesh)
    )
    sun_entry, ring_entry = _entries(stage)
    overlap = stage.sun_mesh.overlap_ratio(stage.face_width)
    return (
        sun.mean() * (1.0 + waves @ shifted(rounded_variation(sun, overlap), sun_entry)),
        ring.mean() * (1.0 + waves @ shifted(rounded_variation(ring, overlap), ring_entry)),
    )


def _entries(stage: PlanetaryStage) -> tuple[np.ndarray, np.ndarray]:
    """Mesh phases at which a tooth pair enters the sun–planet and the planet–ring mesh of every planet, each (N,)."""
    return (
        stage.sun_phases - stage.sun_mesh.pitch_phase,
        stage.ring_phases + stage.ring_lag - stage.ring_mesh.pitch_phase,
    )


def _tooth_error(stage: PlanetaryStage) -> np.ndarray:
    """Coefficients (2,) of the mean of e_sp + e_pr over the planets, over the lever, rad.

    e = ½ f_i' sin 2πφ from where a pair enters, f_i' of the driving gear of the mesh as for the pinions of the machine.
    All paths are equally stiff in the mean, so T = 0 at the mean of their errors.
    """
    total = np.zeros(2)
    for pair, entry in zip((stage.sun_mesh, stage.ring_mesh), _entries(stage), strict=True):
        tooth, _ = _tolerances(stage, pair)
        total += shifted(np.array([0.0, tooth / 2.0]), entry).mean(axis=1)
    return total / stage.lever


def _planet_error(stage: PlanetaryStage) -> np.ndarray:
    """Coefficients (2,) of the planets' run-out at the carrier, rad.

    ½ (F_i' − f_i') is the eccentricity ε of a planet's teeth. With u the part of it backwards round the stage, into
    both driving flanks, and v the part inwards, e_sp = u cos α_sp + v sin α_sp and e_pr = u cos α_pr − v sin α_pr:
    without profile shift together 2 u cos α, u/a at the carrier. u = ε sin 2π(φ/z_p + φ_j), v = −ε cos of the same, and
    fixed φ_j spaced by the golden ratio (assumed).

    The run-out of the sun, ε sin(θ − ψ_j + const) in mesh j with θ its turn relative to the carrier, has no mean over
    N ≥ 2 equally spaced planets. Nor has that of the fixed ring, passed once per turn of the carrier.
    """
    tooth, total = _tolerances(stage, stage.ring_mesh)
    places = np.mod(GOLDEN * np.arange(stage.planets), 1.0)
    sun, ring = stage.sun_mesh.working_angle, stage.ring_mesh.working_angle
    both = np.array([math.sin(ring) - math.sin(sun), math.cos(sun) + math.cos(ring)]) / stage.lever
    return np.asarray(shifted(0.5 * (total - tooth) * both, -places).mean(axis=1))


def _tolerances(stage: PlanetaryStage, pair: GearPair) -> tuple[float, float]:
    """Composite tolerances of the driving gear of a mesh (m), f_i' and F_i'."""
    ratio = pair.contact_ratio + pair.overlap_ratio(stage.face_width)
    return composite_tolerances(stage.module, 2.0 * pair.pinion.reference_radius, ratio, stage.accuracy_grade)
