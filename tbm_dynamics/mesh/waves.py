"""Stiffness and error of all couplings as trigonometric sums of phases that turn with the mesh, less faults of teeth.

Everything that repeats in a drive repeats with one of a few phases: the pinion–ring mesh, the pinion shaft, the mesh of
each planetary stage and the turn of its planets. Each is the mesh phase (cycles) times a constant, less a shift that
differs from drive to drive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tbm_dynamics.mesh.faults import FaultSeries


@dataclass(frozen=True)
class Waves:
    """Sums over b phases for p drives; the first of the phases is the pinion–ring mesh.

    Attributes
    ----------
    turns : (b,) ndarray
        Cycles of each phase per mesh cycle.
    harmonics : tuple of int
        Harmonics of the stiffness at the first phases: the mesh, then each planetary stage.
    mesh_stiffness : (p,) ndarray
        Mean (N/m), faults left out.
    mesh_variation : (2 h, p) ndarray
        Cosine and sine coefficients of the mesh stiffness, harmonic by harmonic (N/m).
    gearbox_compliance : (p,) ndarray
        Mean (rad/(N·m)).
    gearbox_variation : (2 Σ h, p) ndarray
        Coefficients of the gearboxes' compliance, stage by stage (rad/(N·m)).
    error : (2 b, 2 p) ndarray
        Coefficients of cosine and sine of every phase in the error of the meshes (m), then of the gearboxes (rad).
    faults : tuple of FaultSeries
        Of single teeth.
    """

    turns: np.ndarray
    harmonics: tuple[int, ...]
    mesh_stiffness: np.ndarray
    mesh_variation: np.ndarray
    gearbox_compliance: np.ndarray
    gearbox_variation: np.ndarray
    error: np.ndarray
    faults: tuple[FaultSeries, ...] = ()

    def stiffness_turns(self) -> list[np.ndarray]:
        """Cycles per mesh cycle of the harmonics of the stiffness, (h,) for each phase that it follows."""
        counts = zip(self.turns, self.harmonics, strict=False)
        return [turns * np.arange(1, count + 1) for turns, count in counts]

    def sums(self, cycles: np.ndarray) -> list[np.ndarray]:
        """Cosines and sines (n, 2h) of the phases that the stiffness follows, at mesh phases (n,)."""
        return [series(cycles * turns, count) for turns, count in zip(self.turns, self.harmonics, strict=False)]

    def first(self, cycles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cosine and sine of every phase at mesh phases (n,), and their slopes per mesh cycle, each (n, 2b)."""
        angle = 2.0 * np.pi * (cycles[:, None] * self.turns % 1.0)
        value, slope = np.empty((2, len(cycles), 2 * len(self.turns)))
        value[:, 0::2], value[:, 1::2] = np.cos(angle), np.sin(angle)
        speed = 2.0 * np.pi * self.turns
        slope[:, 0::2], slope[:, 1::2] = -speed * value[:, 1::2], speed * value[:, 0::2]
        return value, slope

    def evaluate(self, cycles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stiffness, error and error per mesh cycle at mesh phases (n,), each (n, 2p), meshes first."""
        mesh, *stages = self.sums(cycles)
        gearbox = np.hstack([mesh[:, :0], *stages]) @ self.gearbox_variation
        value, slope = self.first(cycles)
        meshes = self.mesh_stiffness + mesh @ self.mesh_variation
        for fault in self.faults:
            meshes[:, fault.drive] -= fault.at(cycles)
        stiffness = np.hstack([meshes, 1.0 / (self.gearbox_compliance + gearbox)])
        return stiffness, value @ self.error, slope @ self.error


def series(cycles: np.ndarray, harmonics: int) -> np.ndarray:
    """Cosine and sine of 1 … h times a phase (n,) in cycles, (n, 2h)."""
    angle = 2.0 * np.pi * np.outer(cycles % 1.0, np.arange(1, harmonics + 1))
    found = np.empty((len(angle), 2 * harmonics))
    found[:, 0::2], found[:, 1::2] = np.cos(angle), np.sin(angle)
    return found


def shifted(coefficients: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Coefficients (2h,) of f(x) to those of f(x − shift) for every shift (p,) in cycles, (2h, p)."""
    cosine, sine = coefficients[0::2, None], coefficients[1::2, None]
    angle = 2.0 * np.pi * np.outer(np.arange(1, len(cosine) + 1), shifts)
    found = np.empty((len(coefficients), len(shifts)))
    found[0::2] = cosine * np.cos(angle) - sine * np.sin(angle)
    found[1::2] = cosine * np.sin(angle) + sine * np.cos(angle)
    return found
