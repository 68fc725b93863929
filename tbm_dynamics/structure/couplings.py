"""The couplings that vary with time: the pinion–ring mesh and the planetary gearbox of every drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tbm_dynamics.mesh.error import composite_tolerances
from tbm_dynamics.mesh.faults import FaultSeries, lost_stiffness
from tbm_dynamics.mesh.geometry import GearPair
from tbm_dynamics.mesh.ishikawa import mesh_stiffness
from tbm_dynamics.mesh.planetary import GOLDEN, PlanetaryStage, StageLaw, stage_law
from tbm_dynamics.mesh.stiffness import HARMONICS, PATTERN_PARTS, rounded_variation
from tbm_dynamics.mesh.tooth import named
from tbm_dynamics.mesh.waves import Waves, shifted
from tbm_dynamics.structure.drive import DriveUnit, gear_pair

if TYPE_CHECKING:
    from tbm_dynamics.machine.description import MachineDescription
    from tbm_dynamics.machine.drive import DriveOverride, DriveTemplate

STAGE_HARMONICS = 4

_UNCOUPLED = 1e-6
"""Of its stiffness, what is left of an uncoupled gearbox: its rotor would need minutes to follow, and has a place."""


@dataclass(frozen=True)
class Couplings:
    """k = 2p couplings of p drives, the meshes first, then the gearboxes.

    F = k(t) f(δ) + c δ̇ in contact, δ = rows q + e(t), f with the gap (none in a gearbox).

    Attributes
    ----------
    rows : (2p, n) ndarray
        Compression of a mesh on its drive flank (m), twist of a gearbox in the driving direction (rad).
    stiffness, damping, half_gap : (2p,) ndarray
        Mean k̄, c and half the total backlash: N/m, N·s/m and m of a mesh, N·m/rad, N·m·s/rad and rad of a gearbox.
    waves : Waves
        k(t) and e(t).
    ring_teeth : int
        Mesh cycles per turn of the head.
    """

    rows: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    half_gap: np.ndarray
    waves: Waves
    ring_teeth: int

    @property
    def drives(self) -> int:
        """Number of drives p."""
        return len(self.rows) // 2

    @property
    def alike(self) -> np.ndarray:
        """Stiffness and damping (2, 2p) that most drives have, of every drive: what the split of the motion takes."""
        laws = np.array([self.stiffness, self.damping]).reshape(2, 2, -1)
        return np.repeat(np.median(laws, axis=2), self.drives, axis=1)


def build_couplings(
    description: MachineDescription, unit: DriveUnit, rows: np.ndarray, ring_inertia: float
) -> Couplings:
    """Stiffness, damping and waves of the couplings with the given rows (2p, n).

    Raises
    ------
    GearError
        Gears that cannot mesh.
    """
    drive = description.driveshaft
    pair, stages = gear_pair(drive), drive.gearbox.stages
    with named("driveshaft.gear"):
        pair.check()
    for number, stage in enumerate(stages):
        with named(f"driveshaft.gearbox.stages.{number}"):
            stage.check()
    waves = _waves(description, pair, stages)
    mesh, gearbox = drive.mesh, 1.0 / waves.gearbox_compliance
    own = (one.backlash for one in description.each_drive)
    backlash = np.array([mesh.backlash if value is None else value for value in own])
    mass = 1.0 / (1.0 / unit.pinion_mesh_mass + pair.driven_base_radius**2 / ring_inertia)
    mesh_damping = 2.0 * mesh.damping_ratio * np.sqrt(waves.mesh_stiffness * mass)
    return Couplings(
        rows=rows,
        stiffness=np.concatenate([waves.mesh_stiffness, gearbox]),
        damping=np.concatenate([mesh_damping, gearbox**2 * _gearbox_loss(unit, drive, waves)]),
        half_gap=np.concatenate([backlash / 2.0, np.zeros_like(backlash)]),
        waves=waves,
        ring_teeth=pair.driven_teeth,
    )


def _gearbox_loss(unit: DriveUnit, drive: DriveTemplate, waves: Waves) -> float:
    """Damping over the squared stiffness of shaft and stages in series, each in its own way: c = k̄² Σ c_j/k_j².

    The shaft is steel; of the stages' teeth ζ_m is a true ratio, as of the pinion's, of the rotor against the output.
    """
    shaft = 1.0 / drive.gearbox.shaft_stiffness
    stages = max(float(waves.gearbox_compliance.min()) - shaft, 0.0)  # of a drive that is not uncoupled
    return unit.shaft_damping * shaft + 2.0 * drive.mesh.damping_ratio * math.sqrt(unit.gearbox_inertia * stages**3)


def _waves(description: MachineDescription, pair: GearPair, stages: Sequence[PlanetaryStage]) -> Waves:
    drive, steel = description.driveshaft, description.steel
    middles = (np.arange(PATTERN_PARTS) + 0.5) / PATTERN_PARTS
    pattern = mesh_stiffness(pair, drive.gear.face_width, steel.elasticity, steel.poisson, middles)
    mesh, each = drive.mesh, description.each_drive
    overlap = pair.overlap_ratio(drive.gear.face_width)
    variation = mesh.mean_stiffness * mesh.variation * rounded_variation(pattern, overlap)
    phases = np.mod(pair.driven_teeth * np.array(description.drive_angles) / (2.0 * math.pi), 1.0)
    touching = np.array([one.tooth_stiffness * (1.0 - one.misalignment) for one in each])
    engaged = np.array([_UNCOUPLED if one.off == "uncoupled" else 1.0 for one in each])
    boxes = _gearboxes(
        drive.count, stages, [stage_law(s, steel.elasticity, steel.poisson, STAGE_HARMONICS) for s in stages]
    )
    shaft_turns = 1.0 / pair.pinion_teeth
    idle = np.zeros((2, drive.count))
    tooth, shaft = _pinion_errors(drive, each, pair, phases)
    return Waves(
        turns=np.array(
            [
                1.0,
                *(shaft_turns * box.mesh_turns for box in boxes),
                shaft_turns,
                *(shaft_turns * box.planet_turns for box in boxes),
            ]
        ),
        harmonics=(HARMONICS, *(STAGE_HARMONICS for _ in boxes)),
        mesh_stiffness=mesh.mean_stiffness * touching,
        mesh_variation=shifted(variation, phases) * touching,
        gearbox_compliance=(1.0 / drive.gearbox.shaft_stiffness + sum(box.compliance for box in boxes)) / engaged,
        gearbox_variation=np.vstack([idle[:0], *(box.variation for box in boxes)]) / engaged,
        error=np.vstack(
            [
                np.hstack([tooth, idle]),
                *(np.hstack([idle, box.tooth_error]) for box in boxes),
                np.hstack([shaft, idle]),
                *(np.hstack([idle, box.planet_error]) for box in boxes),
            ]
        ),
        faults=_faults(description, pair, phases, mesh.mean_stiffness * touching / np.mean(pattern)),
    )


def _faults(
    description: MachineDescription, pair: GearPair, phases: np.ndarray, scale: np.ndarray
) -> tuple[FaultSeries, ...]:
    """Faults of teeth; `scale` (p,) is each mesh's mean stiffness over Ishikawa's."""
    width, steel = description.driveshaft.gear.face_width, description.steel
    return tuple(
        FaultSeries(
            drive=i,
            entry=phases[i],
            turn=pair.pinion_teeth,
            lost=scale[i] * lost_stiffness(one.tooth, pair, width, steel.elasticity, steel.poisson),
        )
        for i, one in enumerate(description.each_drive)
        if one.tooth
    )


def _pinion_errors(
    drive: DriveTemplate, each: Sequence[DriveOverride], pair: GearPair, phases: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of the pinions' error at the mesh and at the shaft phase, each (2, p), m."""
    tooth, total = composite_tolerances(
        drive.gear.module,
        2.0 * pair.pinion.reference_radius,
        pair.contact_ratio + pair.overlap_ratio(drive.gear.face_width),
        drive.gear.accuracy_grade,
    )
    half = 0.5 * drive.mesh.error_factor
    run_out = np.mod(-GOLDEN * np.arange(drive.count), 1.0)
    factor, eccentricity = np.array([(one.mesh_error, one.eccentricity) for one in each]).T
    return (
        shifted(np.array([0.0, half * tooth]), phases) * factor,
        shifted(np.array([0.0, half * (total - tooth)]), run_out) * factor
        + shifted(np.array([0.0, 1.0]), run_out) * eccentricity,
    )


@dataclass(frozen=True)
class _StageAtPinion:
    """A stage seen from the pinion shaft: turns per turn of it, law in rad/(N·m) and rad at it, (2h, p) and (2, p)."""

    mesh_turns: float
    planet_turns: float
    compliance: float
    variation: np.ndarray
    tooth_error: np.ndarray
    planet_error: np.ndarray


def _gearboxes(drives: int, stages: Sequence[PlanetaryStage], laws: Sequence[StageLaw]) -> list[_StageAtPinion]:
    found = []
    speed = 1.0  # of the stage's carrier, over the pinion shaft
    for number, (stage, law) in enumerate(zip(stages, laws, strict=True), start=1):
        shifts = np.mod(GOLDEN * number * np.arange(drives), 1.0)
        found.append(
            _StageAtPinion(
                mesh_turns=speed * stage.ring_teeth,
                planet_turns=speed * stage.ring_teeth / stage.planet_teeth,
                compliance=law.compliance[0] / speed**2,
                variation=shifted(law.compliance[1:], shifts) / speed**2,
                tooth_error=shifted(law.tooth_error, shifts) / speed,
                planet_error=shifted(law.planet_error, shifts / stage.planet_teeth) / speed,
            )
        )
        speed *= stage.ratio
    return found
