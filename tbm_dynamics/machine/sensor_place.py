"""Where an accelerometer sits: on a node, or at the end of a rigid arm from it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import AfterValidator, Discriminator, Tag

from tbm_dynamics.machine.drive import Node
from tbm_msgs_py.base.fields import FrozenModel, Vector3

if TYPE_CHECKING:
    from tbm_dynamics.structure.system import System


class SensorPlace(FrozenModel):
    """A node, and the arm from it in the machine's axes (m).

    Rotations are small: a point at r moves by u + θ × r, and accelerates alike.
    """

    node: Node
    offset: Vector3 = (0.0, 0.0, 0.0)

    @property
    def shortest(self) -> int | SensorPlace:
        """Number of the node alone where there is no arm: a stated default is no difference."""
        return self if any(self.offset) else self.node

    def at(self, offset: Vector3 | None) -> SensorPlace:
        """Return a place on another arm from the same node, or this one at None."""
        return self if offset is None else SensorPlace(node=self.node, offset=offset)

    @property
    def arm(self) -> np.ndarray:
        """Motion along x, y, z from that of the six unknowns of the node, (3, 6)."""
        x, y, z = self.offset
        turned = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        return np.hstack([np.eye(3), turned])

    def rows(self, system: System) -> np.ndarray:
        """Motion along x, y, z from that of all n unknowns of a system, (3, n)."""
        from tbm_dynamics.structure.system import DIRECTIONS  # noqa: PLC0415 - scipy, for those who assemble

        found = np.zeros((3, system.size))
        found[:, [system.dof(self.node, direction) for direction in DIRECTIONS]] = self.arm
        return found

    def translation(self, motion: np.ndarray) -> np.ndarray:
        """Motion along x, y, z, (…, 3), from that of the node, (…, 6): the same bits for any number of rows."""
        if not any(self.offset):
            return motion[..., :3]
        return np.asarray(motion[..., :3] + np.cross(motion[..., 3:], self.offset))


def _form(value: object) -> str:
    return "_place" if isinstance(value, dict | SensorPlace) else "_node"


TestPoint = Annotated[
    Annotated[Node, Tag("_node")] | Annotated[SensorPlace, Tag("_place")],
    Discriminator(_form),
    AfterValidator(lambda point: place_of(point).shortest),
]
"""A test point as a machine file states it: the number of a node, or a node and an offset."""


def place_of(point: int | SensorPlace) -> SensorPlace:
    """Place of a test point, or of a node."""
    return point if isinstance(point, SensorPlace) else SensorPlace(node=point)
