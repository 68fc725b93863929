"""The machine file: what a YAML description may say, validated.

Every entry carries `source`: `table1`, `table4`, `table5` (the paper), `assumed` (ours, adjusted only by the
calibration), `calibrated`, `updated` (to explain a recording), or in words where else it is from. SI units, angles in
degrees where the name says so (and the `angle` of a drive).
"""

from __future__ import annotations

import math
import re
from itertools import groupby
from statistics import NormalDist, pstdev
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from tbm_dynamics.loads.cutters.description import CutterDescription
from tbm_dynamics.loads.description import LoadDescription
from tbm_dynamics.machine.drive import DriveOverride, DriveTemplate, Node
from tbm_dynamics.machine.parts import GROUND, Connection, Subsystem
from tbm_dynamics.machine.sensor_place import SensorPlace, TestPoint, place_of
from tbm_dynamics.mesh.planetary import GOLDEN
from tbm_msgs_py.base.fields import FrozenModel, Label, NonNegative, Positive, Source, Vector3
from tbm_msgs_py.base.texts import LONGEST_NAME
from tbm_msgs_py.base.units import R_MIN

LONGEST_POINT = 100
"""Characters of a test point: a topic has 247 at most, and names a machine and a quantity beside it."""


def _part_of_topics(name: str) -> str:
    """Name that topics of ROS can have in them."""
    if not re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", name) or len(name) > LONGEST_POINT:
        raise ValueError(
            f"test points name topics of ROS, allowed: up to {LONGEST_POINT} letters a to z, digits, _, no digit first"
        )
    return name


PointName = Annotated[str, AfterValidator(_part_of_topics)]


class SiteOperatingPoint(FrozenModel):
    """Mean working condition of the machine, in the units of the site; a speed of 0 is a standstill."""

    speed_r_min: NonNegative
    torque_kn_m: NonNegative
    thrust_kn: NonNegative
    source: Source


class OperatingLimits(FrozenModel):
    """Largest speed, torque and power of the cutterhead, and largest thrust."""

    speed_r_min: Positive
    torque_kn_m: Positive
    thrust_kn: Positive
    power_kw: Positive
    source: Source

    def problem(self, speed_r_min: float, torque_kn_m: float, thrust_kn: float) -> str | None:
        """Return one line about what of an operating point is beyond the limits; None if nothing is."""
        power = torque_kn_m * speed_r_min * R_MIN
        given = (
            ("speed", speed_r_min, self.speed_r_min, "r/min"),
            ("torque", torque_kn_m, self.torque_kn_m, "kN·m"),
            ("thrust", thrust_kn, self.thrust_kn, "kN"),
            ("power", power, self.power_kw, "kW"),
        )
        for name, value, most, unit in given:
            if value > most:
                return f"{name} {value:g} {unit}, allowed are up to {most:g}"
        return None


class Material(FrozenModel):
    """Steel of every virtual shaft (paper, Table 4: x4, x5, x6)."""

    elasticity: Positive
    poisson: Annotated[float, Field(ge=0.0, lt=0.5)]
    damping: NonNegative
    allowable_stress: Positive | None = None
    """Pa, of the shafts under the largest torque and thrust that are allowed; None: not checked."""
    source: Source


class DampingReading(FrozenModel):
    """How Table 4's damping ratios are read.

    `stiffness_proportional`: C_e = ζ_e K_e, ζ_e in seconds; its name alone will do. `ratio`: ζ_e is a true ratio at
    `frequency` (Hz), C_e = ζ_e / (π f) K_e.
    """

    reading: Literal["stiffness_proportional", "ratio"] = "stiffness_proportional"
    frequency: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, given: object) -> object:
        return {"reading": given} if isinstance(given, str) else given

    @model_validator(mode="after")
    def _stated_frequency(self) -> Self:
        if (self.reading == "ratio") != (self.frequency is not None):
            raise ValueError("frequency (Hz): allowed and needed with reading: ratio only")
        return self

    def factor(self, ratio: float) -> float:
        """β (s) of C_e = β K_e for a ratio of Table 4."""
        return ratio if self.frequency is None else ratio / (math.pi * self.frequency)


class ConnectionDamping(FrozenModel):
    """Damping ratio of each connection type (paper, Table 4: x11 … x15)."""

    rock: NonNegative
    bolt: NonNegative
    bearing: NonNegative
    spline: NonNegative
    hydraulic: NonNegative
    source: Source


class MachineDescription(FrozenModel):
    """A whole machine: three subsystems, the connections between them, and the loads on the cutterhead."""

    name: Annotated[str, Field(max_length=LONGEST_NAME, pattern=r"^[A-Za-z0-9_\-]+$")]
    title: Label
    operating_point: SiteOperatingPoint
    operating_limits: OperatingLimits | None = None
    steel: Material
    damping: DampingReading = DampingReading()
    connection_damping: ConnectionDamping
    cutterhead_bearing_gear: Subsystem
    driveshaft: DriveTemplate
    drives: dict[Annotated[int, Field(ge=1)], DriveOverride] = Field(default_factory=dict)
    carrier_girder: Subsystem
    connections: tuple[Connection, ...]
    load_node: Node
    test_points: dict[PointName, TestPoint]
    loads: LoadDescription
    cutters: CutterDescription | None = None

    @model_serializer(mode="wrap")
    def _without_alike_drives(self, dump: SerializerFunctionWrapHandler) -> dict[str, object]:
        # What is written of a machine whose drives are alike, and its digest, is as it was before they could differ.
        data: dict[str, object] = dump(self)
        if not self.drives:
            data.pop("drives", None)
        return data

    @property
    def each_drive(self) -> tuple[DriveOverride, ...]:
        """How each drive differs from the template, in the order of the drives."""
        alike = DriveOverride()
        return tuple(self.drives.get(number, alike) for number in range(1, self.driveshaft.count + 1))

    @property
    def motor_weights(self) -> tuple[float, ...]:
        """Weight of each motor in the torque of the head; of those that run, scattered as `motor.scatter` says.

        By quantiles of a normal distribution, spread over the drives by the golden ratio.
        """
        each, count = self.each_drive, self.driveshaft.count
        order = sorted(range(count), key=lambda i: math.modf(GOLDEN * i)[0])
        normal = [NormalDist().inv_cdf((order.index(i) + 0.5) / count) for i in range(count)]
        size = self.driveshaft.motor.scatter / max(pstdev(normal), 1e-12)
        return tuple(one.weight * (1.0 + size * z) for one, z in zip(each, normal, strict=True))

    @property
    def drive_angles(self) -> tuple[float, ...]:
        """Places of the drives around the x axis, rad."""
        first, count = math.radians(self.driveshaft.placement.first_angle_deg), self.driveshaft.count
        return tuple(
            first + 2.0 * math.pi * i / count if drive.angle is None else math.radians(drive.angle)
            for i, drive in enumerate(self.each_drive)
        )

    @property
    def mount_nodes(self) -> tuple[int, ...]:
        """Nodes that carry the drives."""
        return tuple(drive.mount_node or self.driveshaft.mount_node for drive in self.each_drive)

    def structural_nodes(self) -> dict[int, Vector3]:
        """Positions of the nodes that are not part of a drive."""
        return {**self.cutterhead_bearing_gear.nodes, **self.carrier_girder.nodes}

    @property
    def sensor_places(self) -> dict[str, SensorPlace]:
        """Places of the test points."""
        return {name: place_of(point) for name, point in self.test_points.items()}

    def all_connections(self) -> tuple[Connection, ...]:
        """All connections inside and between the subsystems; those of the drives are in their template."""
        return (*self.cutterhead_bearing_gear.connections, *self.carrier_girder.connections, *self.connections)

    @model_validator(mode="after")
    def _known_nodes(self) -> Self:
        repeated = set(self.cutterhead_bearing_gear.nodes) & set(self.carrier_girder.nodes)
        drive = self.driveshaft
        drive_nodes = [drive.pinion_nodes_from + j for j in range(3 * drive.count)]
        drive_nodes += [drive.gearbox_nodes_from + j for j in range(2 * drive.count)]
        known = self.structural_nodes()
        repeated |= (set(known) & set(drive_nodes)) | {n for n in drive_nodes if drive_nodes.count(n) > 1}
        if repeated:
            raise ValueError(f"nodes {sorted(repeated)} are defined twice; every node number is used once")
        allowed = set(known) | set(drive_nodes)
        for where, node in self._references():
            if node not in allowed:
                raise ValueError(f"{where}: unknown node {node}; known are {_ranges(sorted(allowed))}")
        return self

    @model_validator(mode="after")
    def _within_limits(self) -> Self:
        point, limits = self.operating_point, self.operating_limits
        problem = limits and limits.problem(point.speed_r_min, point.torque_kn_m, point.thrust_kn)
        if problem:
            raise ValueError(f"operating_point: {problem} (operating_limits)")
        return self

    @model_validator(mode="after")
    def _drives_on_the_axis(self) -> Self:
        # The drives stand around the x axis: what they act on lies on it.
        known = self.structural_nodes()
        nodes = {f"driveshaft.{key}": getattr(self.driveshaft, key) for key in ("ring_node", "mount_node")}
        nodes |= {f"drives.{number}.mount_node": one.mount_node for number, one in self.drives.items()}
        for key, node in nodes.items():
            if node is not None and (node not in known or known[node][1:] != (0.0, 0.0)):
                raise ValueError(f"{key}: node {node} must be a structural node on the x axis (y = z = 0)")
            if node == self.driveshaft.ring_node and key != "driveshaft.ring_node":
                raise ValueError(f"{key}: node {node} is the ring, allowed: a node that carries the drives")
        return self

    @model_validator(mode="after")
    def _known_drives(self) -> Self:
        count = self.driveshaft.count
        for number in self.drives:
            if number > count:
                raise ValueError(f"drives.{number}: unknown drive, allowed: 1 to {count}")
        if sum(drive.weight for drive in self.each_drive) <= 0.0:
            raise ValueError("drives: none gives torque, allowed: at least one that runs, and less drag")
        return self

    @model_validator(mode="after")
    def _drives_beside_each_other(self) -> Self:
        pair, angles = self.driveshaft.gear.pair, self.drive_angles
        tip, places = 2.0 * pair.pinion.tip_radius, 2.0 * pair.centre_distance
        for number, drive in sorted(self.drives.items()):
            for other, angle in enumerate(angles, start=1):
                apart = abs(places * math.sin((angle - angles[number - 1]) / 2.0))
                if drive.angle is not None and other != number and apart < tip:
                    raise ValueError(
                        f"drives.{number}.angle: {drive.angle:g} degrees puts its pinion into that of "
                        f"drive {other} at {math.degrees(angle):.4g}, allowed: tip circles of {tip:.3g} m side by side"
                    )
        return self

    @model_validator(mode="after")
    def _gaps_within_a_tooth(self) -> Self:
        # A number in another unit, above all: a gap without teeth, or teeth beside those of the ring.
        gear = self.driveshaft.gear
        pitch = gear.pair.base_pitch
        lengths = [("driveshaft.mesh.backlash", self.driveshaft.mesh.backlash, pitch, "base pitch")]
        for number, drive in self.drives.items():
            lengths.append((f"drives.{number}.backlash", drive.backlash or 0.0, pitch, "base pitch"))
            lengths.append((f"drives.{number}.eccentricity", drive.eccentricity, gear.module, "module"))
        for key, length, limit, name in lengths:
            if length >= limit:
                raise ValueError(f"{key}: {length:g} m, allowed: less than the {name}, {limit:.3g} m")
        return self

    @model_validator(mode="after")
    def _one_way_of_thrust(self) -> Self:
        held = [connection for connection in self.all_connections() if connection.force_controlled]
        if len(held) > 1:
            raise ValueError(f"force_controlled: {len(held)} connections, allowed: one")
        for connection in self.all_connections():
            if connection.turning_inertia is not None and connection.between[0] != self.load_node:
                raise ValueError(f"{connection.name}.turning_inertia: allowed at load_node {self.load_node}")
        return self

    @model_validator(mode="after")
    def _scalable_loads(self) -> Self:
        # The loads follow thrust and torque by their ratio to these means.
        for name in ("fx", "mx"):
            if getattr(self.loads, name).mean == 0.0:
                raise ValueError(f"loads.{name}.mean: must not be 0")
        return self

    def _references(self) -> list[tuple[str, int]]:
        """Every place that names a node, with the node."""
        found: list[tuple[str, int]] = [("load_node", self.load_node)]
        found += [(f"test_points.{name}", place.node) for name, place in self.sensor_places.items()]
        for name in ("cutterhead_bearing_gear", "carrier_girder"):
            subsystem: Subsystem = getattr(self, name)
            found += [(f"{name}.shafts", node) for shaft in subsystem.shafts for node in shaft.nodes]
            found += [(f"{name}.bodies", body.node) for body in subsystem.bodies]
            found += _ends(f"{name}.connections", subsystem.connections)
        found += _ends("connections", self.connections)
        drive = self.driveshaft
        found += [("driveshaft.ring_node", drive.ring_node), ("driveshaft.mount_node", drive.mount_node)]
        return found + [("driveshaft.ring_shaft_nodes", node) for node in drive.ring_shaft_nodes]


def _ends(where: str, connections: tuple[Connection, ...]) -> list[tuple[str, int]]:
    return [(f"{where}.{c.name}.between", node) for c in connections for node in c.between if node != GROUND]


def _ranges(numbers: list[int]) -> str:
    """Render sorted integers as `1–12, 43–50`."""
    runs = [[number for _, number in run] for _, run in groupby(enumerate(numbers), lambda pair: pair[1] - pair[0])]
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]}–{run[-1]}" for run in runs)
