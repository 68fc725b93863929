"""How a machine vibrates: its modes, each by where it moves and which way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tbm_dynamics.structure.system import System
from tbm_msgs_py.base.arrays import Array


@dataclass(frozen=True)
class ModeSummary:
    """A mode of vibration.

    Attributes
    ----------
    frequency_hz : float
    motion : str
        The largest of the shares.
    node : int
        The one that moves most in that way.
    shares : dict of str to float
        axial, lateral and torsional share of the kinetic energy; above some 600 Hz they overlap in a few modes.
    """

    frequency_hz: float
    motion: str
    node: int
    shares: dict[str, float]


def lowest_modes(system: System, count: int) -> Iterator[ModeSummary]:
    """Modes of the `count` lowest natural frequencies."""
    frequencies, shapes = system.modes
    for frequency, shape in zip(frequencies[:count], shapes.T, strict=False):
        parts = motion_parts(system, shape)
        energy = {name: float(part @ system.M @ part) for name, part in parts.items()}
        shares = {name: value / sum(energy.values()) for name, value in energy.items()}
        motion = max(shares, key=shares.__getitem__)
        at_nodes = parts[motion].reshape(-1, 6)
        size = np.abs(at_nodes[:, 3]) if motion == "torsional" else np.linalg.norm(at_nodes[:, :3], axis=1)
        # Drives that move alike differ by rounding: the first of them is named.
        node = system.nodes[int(np.argmax(size > (1.0 - 1e-6) * size.max()))]
        yield ModeSummary(float(frequency), motion, node, shares)


def motion_parts(system: System, shape: Array) -> dict[str, Array]:
    """Axial, lateral and torsional part of a motion (n,); together they are the motion.

    The drives stand off the axis: what they do together along it is axial, together around it torsional. Tilting and
    what differs from drive to drive is lateral, a drive's turn about its own axis torsional.
    """
    drives, count = system.drives, len(system.drives.angles)
    own = np.einsum("pij,pj->pi", drives.turns, shape[drives.dofs]).reshape(count, -1, 6)
    split = {name: np.zeros_like(own) for name in ("axial", "torsional")}
    split["axial"][:, :, 0] = own[:, :, 0].mean(axis=0)
    split["torsional"][:, :, 2] = own[:, :, 2].mean(axis=0)
    split["torsional"][:, :, 3] = own[:, :, 3]
    split["lateral"] = own - split["axial"] - split["torsional"]
    found = {}
    for name, columns in (("axial", [0]), ("lateral", [1, 2, 4, 5]), ("torsional", [3])):
        part = np.zeros_like(shape)
        part.reshape(-1, 6)[:, columns] = shape.reshape(-1, 6)[:, columns]
        part[drives.dofs] = np.einsum("pji,pj->pi", drives.turns, split[name].reshape(count, -1))
        found[name] = part
    return found
