"""Frequency response of the linear system: couplings closed at their mean stiffness, in the basis of a run.

What couplings have beyond those of most drives is in a run a force; here it joins all parts of the basis to one.

The stiffness of the couplings varies with the teeth, k̄ + Re Σ_n 2 K_n exp(i ν_n t). A harmonic deflection δ exp(iωt) is
so answered by forces −K_n δ exp(i(ω + ν_n)t) at other frequencies as well: to the first order in the variation, the
machine's answer to them is the modulation of its answer to the loads.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg

from tbm_dynamics.integration.basis import SplitBasis, split_basis
from tbm_dynamics.integration.linear import INPUTS, LinearSystem
from tbm_dynamics.structure.system import System

_BLOCK = 1024  # frequencies at a time, so that the terms of the poles stay small


@dataclass(frozen=True)
class StiffnessHarmonic:
    """A harmonic of the couplings' stiffness.

    Attributes
    ----------
    frequency : float
        ν_n over 2π (Hz).
    matrix : (2c, 2c) ndarray
        K_n between the patterns of the drives, complex (N/m, N·m/rad).
    """

    frequency: float
    matrix: np.ndarray


class FrequencyResponse:
    """Harmonic motion of a system, as a sum over the poles of the symmetric parts of its basis, or of all parts joined.

    Parameters
    ----------
    system : System
    observe : (o, n) ndarray
        What of the displacement is wanted, row by row.

    Attributes
    ----------
    rows : int
        Number o of them.
    """

    def __init__(self, system: System, observe: np.ndarray) -> None:
        basis = split_basis(system)
        self._system, self._shared = system, basis.shared
        self.rows, self._patterns = len(observe), 2 * basis.shared.shape[1]
        couplings = system.couplings
        beyond = np.array([couplings.stiffness, couplings.damping]) - couplings.alike
        self._parts = (
            [_joined(system, basis, observe, *beyond)]
            if beyond.any()
            else [_poles(part.linear, observe @ part.shapes, part.inputs, part.couplings) for part in basis.symmetric]
        )

    def receptance(self, frequency: np.ndarray) -> np.ndarray:
        """Displacement along the rows per unit of the six loads and of the motor torque, complex, (f, o, 7).

        Parameters
        ----------
        frequency : (f,) ndarray
            Hz; a negative one has the conjugate answer.
        """
        found = np.zeros((len(frequency), self.rows, INPUTS), dtype=complex)
        for part in self._parts:
            found[:, :, part.inputs] += part.sum(frequency, part.seen, part.driven)
        return found

    def accelerance(self, frequency: np.ndarray) -> np.ndarray:
        """Acceleration along the rows per unit of the six loads, (f, o, 6); see `receptance`."""
        return np.asarray(-((2.0 * np.pi * frequency[:, None, None]) ** 2) * self.receptance(frequency)[:, :, :6])

    def deflection(self, frequency: np.ndarray) -> np.ndarray:
        """Deflection of the couplings in the patterns of the drives per unit of the six loads, (f, 2c, 6)."""
        found = np.zeros((len(frequency), self._patterns, INPUTS), dtype=complex)
        for part in self._parts:
            found[:, part.couplings[:, None], part.inputs] += part.sum(frequency, part.bent, part.driven)
        return found[:, :, :6]

    def coupling_accelerance(self, frequency: np.ndarray) -> np.ndarray:
        """Acceleration along the rows per unit forces of the couplings beyond their mean law, (f, o, 2c)."""
        found = np.zeros((len(frequency), self.rows, self._patterns), dtype=complex)
        for part in self._parts:
            found[:, :, part.couplings] += part.sum(frequency, part.seen, part.pushed)
        return np.asarray(-((2.0 * np.pi * frequency[:, None, None]) ** 2) * found)

    def stiffness_harmonics(self) -> list[StiffnessHarmonic]:
        """Harmonics of the stiffness at the operating point's speed: of the meshes, then of the gearboxes' stages."""
        couplings, shared = self._system.couplings, self._shared
        waves, c = couplings.waves, shared.shape[1]
        rate = couplings.ring_teeth * self._system.operating_point.speed / (2.0 * np.pi)
        mesh, *stages = waves.stiffness_turns()
        # k = 1 / compliance: to the first order, less its square times the compliance's variation.
        gearbox = -waves.gearbox_variation / waves.gearbox_compliance**2
        turns, kinds = np.concatenate([mesh, *stages]), np.repeat([0, c], [len(mesh), len(gearbox) // 2])
        found = []
        for place, (turn, kind) in enumerate(zip(turns, kinds, strict=True)):
            cosine, sine = np.vstack([waves.mesh_variation, gearbox])[2 * place : 2 * place + 2]
            matrix = np.zeros((2 * c, 2 * c), dtype=complex)
            matrix[kind : kind + c, kind : kind + c] = shared.T @ ((0.5 * (cosine - 1j * sine))[:, None] * shared)
            found.append(StiffnessHarmonic(float(turn * rate), matrix))
        return found


class _Piece(NamedTuple):
    """A part among all unknowns: its motion (n, m) per coordinate, and how inputs and couplings act on it.

    `driven` (7, i) are its inputs from all of them, `pushed` (2p, k) the forces of its couplings from those of all
    drives, `bent` (2p, k) the deflections of all drives from those of its couplings.
    """

    shapes: np.ndarray
    linear: LinearSystem
    driven: np.ndarray
    pushed: np.ndarray
    bent: np.ndarray


def _pieces(system: System, basis: SplitBasis) -> list[_Piece]:
    """All parts of a basis, the individual one for every drive."""
    shared, own, every = basis.shared, basis.individual, np.eye(INPUTS)
    patterns, drives = np.kron(np.eye(2), shared), np.eye(len(shared))
    found = [
        _Piece(part.shapes, part.linear, every[:, part.inputs], *[patterns[:, part.couplings]] * 2)
        for part in basis.symmetric
    ]
    beyond = drives - shared @ shared.T
    for i, torque in enumerate(basis.own_torque):
        shapes = np.zeros((system.size, own.shapes.shape[1]))
        shapes[system.drives.dofs[i]] = system.drives.turns[i].T @ own.shapes
        pushed, bent = (np.kron(np.eye(2), columns[:, [i]]) for columns in (beyond, drives))
        found.append(_Piece(shapes, own.linear, torque * every[:, own.inputs], pushed, bent))
    return found


def _joined(
    system: System, basis: SplitBasis, observe: np.ndarray, stiffness: np.ndarray, damping: np.ndarray
) -> _Poles:
    """All parts as one, whose couplings have a stiffness and a damping (2p,) beyond those of the basis."""
    pieces = _pieces(system, basis)
    pushes = [np.split(piece.linear.E, [piece.driven.shape[1]], axis=1) for piece in pieces]
    inputs = np.vstack([push[0] @ piece.driven.T for push, piece in zip(pushes, pieces, strict=True)])
    forces = np.vstack([push[1] @ piece.pushed.T for push, piece in zip(pushes, pieces, strict=True)])
    motions = [np.kron(np.eye(2), piece.bent) @ piece.linear.observe for piece in pieces]
    deflection, rate = np.split(np.hstack(motions), 2)
    H = scipy.linalg.block_diag(*(piece.linear.H for piece in pieces))
    H += forces @ (stiffness[:, None] * deflection + damping[:, None] * rate)
    # The displacements of all parts before their velocities, as in each of them.
    order = np.argsort(np.concatenate([np.repeat([0, 1], piece.shapes.shape[1]) for piece in pieces]), kind="stable")
    patterns = np.kron(np.eye(2), basis.shared)
    linear = LinearSystem(
        H=H[np.ix_(order, order)],
        E=np.hstack([inputs, forces @ patterns])[order],
        observe=np.vstack([patterns.T @ deflection, patterns.T @ rate])[:, order],
    )
    seen = observe @ np.hstack([piece.shapes for piece in pieces])
    return _poles(linear, seen, np.arange(INPUTS), np.arange(patterns.shape[1]))


@dataclass(frozen=True)
class _Poles:
    """A part by its poles (s,): what is seen (o, s) and bent (k, s), what loads (s, i) and couplings (s, k) drive."""

    poles: np.ndarray
    inputs: np.ndarray
    couplings: np.ndarray
    seen: np.ndarray
    bent: np.ndarray
    driven: np.ndarray
    pushed: np.ndarray

    def sum(self, frequency: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Σ_s left_s right_s / (iω − λ_s), (f, rows of left, columns of right)."""
        residues = (left.T[:, :, None] * right[:, None, :]).reshape(len(self.poles), -1)
        blocks = [
            (1.0 / (2j * np.pi * frequency[first : first + _BLOCK, None] - self.poles)) @ residues
            for first in range(0, len(frequency), _BLOCK)
        ]
        return np.concatenate([*blocks, residues[:0]]).reshape(len(frequency), len(left), right.shape[1])


def _poles(linear: LinearSystem, seen: np.ndarray, inputs: np.ndarray, couplings: np.ndarray) -> _Poles:
    """Poles of a first-order system; `seen` (o, m) is what is wanted of its displacements."""
    poles, vectors = np.linalg.eig(linear.H)
    driven, pushed = np.split(np.linalg.solve(vectors, linear.E), [len(inputs)], axis=1)
    bent = linear.observe[: len(couplings)] @ vectors
    return _Poles(poles, inputs, couplings, seen @ vectors[: seen.shape[1]], bent, driven, pushed)
