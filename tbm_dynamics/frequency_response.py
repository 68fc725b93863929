"""Frequency response of the linear system: couplings closed at their mean stiffness, in the basis of a run."""

from __future__ import annotations

import numpy as np

from tbm_dynamics.integration.basis import ModalPart, split_basis
from tbm_dynamics.integration.linear import INPUTS
from tbm_dynamics.structure.system import System

_BLOCK = 1024  # frequencies at a time, so that the terms of the poles stay small


class FrequencyResponse:
    """Displacement of a system under harmonic loads, as a sum over the poles of the reduced parts.

    Parameters
    ----------
    system : System
    observe : (o, n) ndarray
        What of the displacement is wanted, row by row.
    """

    def __init__(self, system: System, observe: np.ndarray) -> None:
        self._parts = [(part.inputs, *_poles(part, observe)) for part in split_basis(system).symmetric]
        self._rows = len(observe)

    def receptance(self, frequency: np.ndarray) -> np.ndarray:
        """Complex amplitude along the rows per unit of the six loads and of the motor torque, (f, o, 7).

        Parameters
        ----------
        frequency : (f,) ndarray
            Hz.
        """
        found = np.zeros((len(frequency), self._rows, INPUTS), dtype=complex)
        for first in range(0, len(frequency), _BLOCK):
            block = slice(first, first + _BLOCK)
            omega = 2j * np.pi * frequency[block]
            for inputs, poles, residues in self._parts:
                terms = 1.0 / (omega[:, None] - poles)
                found[block, :, inputs] += (terms @ residues).reshape(len(omega), self._rows, -1)
        return found

    def accelerance(self, frequency: np.ndarray) -> np.ndarray:
        """Acceleration along the rows per unit of the six loads, (f, o, 6); see `receptance`."""
        return np.asarray(-((2.0 * np.pi * frequency[:, None, None]) ** 2) * self.receptance(frequency)[:, :, :6])


def _poles(part: ModalPart, observe: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poles (s,) of a part, and the residues of all rows and inputs, (s, o · i)."""
    poles, vectors = np.linalg.eig(part.linear.H)
    driven = np.linalg.solve(vectors, part.linear.E[:, : len(part.inputs)])
    seen = (observe @ part.shapes) @ vectors[: part.shapes.shape[1]]
    return poles, np.einsum("os,si->soi", seen, driven).reshape(len(poles), -1)
