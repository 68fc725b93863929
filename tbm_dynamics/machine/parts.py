"""What a subsystem of a machine file is made of: nodes, shafts, bodies and connections."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from tbm_dynamics.machine.drive import Node
from tbm_dynamics.machine.springs import Springs
from tbm_msgs_py.base.fields import FrozenModel, Label, NonNegative, Positive, Source, SparseModel, Vector3

GROUND: Literal["ground"] = "ground"


Role = Literal["k_r_ct", "k_r_gd", "k_c_cf", "k_c_fb", "k_c_bc", "k_c_cg", "k_b_io", "k_h_gd"]
"""Rock–head, rock–girder (gripper), head–flange, flange–bearing, bearing–carrier, carrier–girder, main bearing,
hydraulic: the connections of Table 5 that are no drive's."""

LONGEST_CONNECTION = 200
"""Characters of a connection's name: that of an input of a study has it in it."""


class Shaft(FrozenModel):
    """A virtual shaft: equal Timoshenko beam elements through consecutive nodes, with a given total mass.

    The section gives stiffness; the mass (kg) is spread over it, so that the density is an equivalent one.
    """

    nodes: Annotated[tuple[Node, ...], Field(min_length=2)]
    outer_diameter: Positive
    inner_diameter: NonNegative = 0.0
    mass: Positive
    source: Source

    @model_validator(mode="after")
    def _hollow(self) -> Self:
        if self.inner_diameter >= self.outer_diameter:
            raise ValueError(
                f"inner_diameter {self.inner_diameter} must be smaller than outer_diameter {self.outer_diameter}"
            )
        return self


class Body(FrozenModel):
    """A rigid body at a node: mass (kg) and moments of inertia about x, y, z (kg·m²)."""

    node: Node
    mass: Positive
    inertia: tuple[Positive, Positive, Positive]
    source: Source


class _Ends(SparseModel):
    """Name and ends of a connection, which stand first in it."""

    name: Annotated[Label, Field(max_length=LONGEST_CONNECTION)]
    role: Role | None = None
    between: tuple[Node, Node | Literal["ground"]]


class Connection(Springs, _Ends):
    """A spring-damper between two nodes, or a node and the ground, located at the first node.

    Along and about x, y, z. A node elsewhere follows through a rigid arm. One with a role is scaled by its input of
    Table 4, whatever its name; a name of Table 5 is a role, too.

    Attributes
    ----------
    force_controlled : bool
        Thrust cylinders that hold a force: the mean thrust enters here, pushing the first node forward off the second,
        and what moves slowly does not feel their stiffness along x.
    turning_inertia : float, optional
        Of rock on the cutterhead: what turns on its spring about x (kg·m²). The damper about x is then that of a true
        ratio, c = 2ζ√(kJ), and the head's own turning works against it, on top of the mean torque.
    """

    optional: ClassVar[tuple[str, ...]] = (*Springs.optional, "role", "force_controlled", "turning_inertia")

    force_controlled: bool | None = None
    turning_inertia: Positive | None = None

    @model_validator(mode="after")
    def _two_ends(self) -> Self:
        if self.between[0] == self.between[1]:
            raise ValueError(f"between {list(self.between)}: the ends must be two nodes, or a node and {GROUND}")
        if self.force_controlled and (self.type != "hydraulic" or self.between[1] == GROUND):
            raise ValueError("force_controlled: allowed between two nodes, with type: hydraulic")
        if self.turning_inertia is not None and (self.type != "rock" or self.between[1] != GROUND):
            raise ValueError("turning_inertia: allowed between a node and ground, with type: rock")
        if self.turning_inertia is not None and self.damps:
            raise ValueError("turning_inertia: allowed without damping of its own, for it says what that is")
        return self

    @property
    def part(self) -> str:
        """Role if there is one, else the name: what is one part in a study."""
        return self.role or self.name


class Subsystem(FrozenModel):
    """A named group of nodes with its shafts, bodies and the connections inside it or to the ground.

    `source` is that of the nodes' places.
    """

    nodes: dict[Node, Vector3]
    source: Source
    shafts: tuple[Shaft, ...] = ()
    bodies: tuple[Body, ...] = ()
    connections: tuple[Connection, ...] = ()
