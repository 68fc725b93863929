"""A machine: a validated description with the changes asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from tbm_dynamics.loads.cutters.description import CutterError
from tbm_dynamics.machine.description import MachineDescription
from tbm_dynamics.machine.inputs import apply_inputs
from tbm_dynamics.machine.loading import read_description, shipped_machines
from tbm_msgs_py.base.errors import MachineError
from tbm_msgs_py.base.fields import Vector3
from tbm_msgs_py.base.files import real_path
from tbm_msgs_py.base.operating_point import OperatingPoint
from tbm_msgs_py.base.units import R_MIN

if TYPE_CHECKING:
    from tbm_dynamics.loads.cutters.cutter_loads import CutterLoads
    from tbm_dynamics.loads.description import LoadDescription
    from tbm_dynamics.loads.spectral import SpectralLoads
    from tbm_dynamics.structure.system import System


@dataclass(frozen=True)
class Machine:
    """A drive described by a file, with some of its inputs changed.

    Attributes
    ----------
    base : MachineDescription
        What the file says.
    inputs : mapping
        Inputs changed since, read-only: x1 … x25 in Table 4's units, ``loads.axial_low`` … ``loads.moments``,
        ``drive_3.backlash`` …. A multiplier is relative to the file.
    origin : str
        What error messages and results call it: the shipped name or the file it was loaded from, the same by whatever
        path or link it was named; else the name in the description.
    """

    base: MachineDescription
    inputs: Mapping[str, float] = field(default_factory=dict)
    origin: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "inputs", MappingProxyType(dict(self.inputs)))
        object.__setattr__(self, "origin", self.origin or self.base.name)

    def __reduce__(self) -> tuple[type[Machine], tuple[MachineDescription, dict[str, float], str]]:
        # A read-only view does not pickle, and processes are sent machines.
        return Machine, (self.base, dict(self.inputs), self.origin)

    @cached_property
    def description(self) -> MachineDescription:
        """The description with the inputs applied."""
        return apply_inputs(self.base, self.inputs) if self.inputs else self.base

    @property
    def name(self) -> str:
        """Name given in the file."""
        return self.base.name

    @property
    def operating_point(self) -> OperatingPoint:
        """Mean working condition in SI units."""
        entry = self.description.operating_point
        return OperatingPoint(
            speed=entry.speed_r_min * R_MIN,
            torque=entry.torque_kn_m * 1e3,
            thrust=entry.thrust_kn * 1e3,
        )

    @property
    def mesh_frequency(self) -> float:
        """Pinion–ring mesh frequency z_r n / 60 (Hz)."""
        return self.description.driveshaft.gear.ring_teeth * self.description.operating_point.speed_r_min / 60.0

    def step(self, wanted: float | None = None) -> float:
        """Time step of a run (s): the one wanted, or the machine's own, as its stiffest mesh vibration needs it.

        Raises
        ------
        MachineError
            A machine that cannot be assembled.
        SimulationError
            A step that is too coarse, or meshes that none is short enough for.
        """
        from tbm_dynamics.integration.condensed import check_step, own_step  # noqa: PLC0415 - compiled code

        system = self.assemble()
        if wanted is None:
            return own_step(system)
        check_step(system, wanted)
        return wanted

    def settling(self) -> float:
        """Time (s) that the start of a run is felt, which no statistic of it should hold; see `settling_time`.

        Raises
        ------
        MachineError
            A machine that cannot be assembled.
        """
        from tbm_dynamics.integration.settling import settling_time  # noqa: PLC0415 - scipy, for those who assemble

        return settling_time(self.assemble())

    def with_inputs(self, **inputs: float) -> Machine:
        """Return a variant with the named inputs changed and nothing else.

        They are x1 … x25, ``loads.axial_low`` … and of single drives ``drive_3.backlash`` …, see `machine.inputs`.

        Raises
        ------
        MachineError
            Unknown input or a value that is not allowed.

        Examples
        --------
        >>> load_machine("dz101").with_inputs(x2=1800.0, x16=2.0).operating_point.torque
        1800000.0
        """
        variant = Machine(self.base, {**self.inputs, **inputs}, self.origin)
        _ = variant.description  # refuse a bad value here, where it was given
        return variant

    def with_offsets(self, offsets: Mapping[str, Vector3]) -> Machine:
        """Return the machine with test points elsewhere: m from their nodes, by name.

        Raises
        ------
        MachineError
            A test point that the machine does not have.
        """
        places, moved = self.base.sensor_places, dict(self.base.test_points)
        for point, offset in offsets.items():
            if point not in places:
                raise MachineError(f"test point {point!r}: machine {self.name} has {', '.join(places)}")
            moved[point] = places[point].at(offset).shortest
        return Machine(self.base.model_copy(update={"test_points": moved}), self.inputs, self.origin)

    def check_operating_point(self, point: OperatingPoint) -> None:
        """Refuse an operating point that the machine cannot have.

        Raises
        ------
        MachineError
            A negative speed, torque or thrust, more than the `operating_limits` of the file allow; one line.
        """
        if point.speed < 0.0 or point.torque < 0.0 or point.thrust < 0.0:
            raise MachineError(
                "operating point: speed must be positive, or 0 at a standstill, torque and thrust not negative"
            )
        limits = self.description.operating_limits
        given = point.speed / R_MIN, point.torque / 1e3, point.thrust / 1e3
        problem = limits and limits.problem(*given)
        if problem:
            raise MachineError(f"operating point: {problem} for {self.name}")

    def load_scale(self, point: OperatingPoint | None = None) -> np.ndarray:
        """Factors on the described loads at an operating point, shape (6,).

        The described loads are those at a thrust of their mean F_x and a torque of their mean M_x, whatever the
        operating point of the file says.
        """
        point = point or self.operating_point
        loads = self.description.loads
        return loads.scale(point.thrust / abs(loads.fx.mean), point.torque / abs(loads.mx.mean))

    @property
    def driven_loads(self) -> LoadDescription:
        """Loads as they fluctuate at the operating point: at a standstill they do not."""
        loads = self.description.loads
        return loads if self.description.operating_point.speed_r_min > 0.0 else loads.at_rest

    def loads(self, seed: int = 0) -> SpectralLoads:
        """Cutterhead loads at the operating point, a pure function of (seed, time).

        Examples
        --------
        >>> load_machine("dz101").loads(seed=0).evaluate([0.0, 1.0]).shape
        (2, 6)
        """
        from tbm_dynamics.loads.spectral import SpectralLoads  # noqa: PLC0415 - compiled code, for those who run it

        return SpectralLoads(self.driven_loads, scale=self.load_scale(), seed=seed)

    def cutter_loads(self, seed: int = 0) -> CutterLoads:
        """Cutterhead loads from the discs at the operating point's speed and thrust.

        Raises
        ------
        MachineError
            A file without cutters, a layout or a thrust that cannot be; one line.
        """
        from tbm_dynamics.loads.cutters.cutter_loads import CutterLoads  # noqa: PLC0415 - as above
        from tbm_dynamics.loads.cutters.head import Cutterhead  # noqa: PLC0415
        from tbm_dynamics.loads.cutters.layout import read_layout  # noqa: PLC0415

        described, point = self.description.cutters, self.operating_point
        if described is None:
            raise MachineError(f"{self.origin}: cutters: missing; the load model cutter needs this section")
        beside = Path(self.origin).parent / described.layout
        try:
            layout = read_layout(beside if beside.is_file() else described.layout, described.head_radius)
            return CutterLoads(Cutterhead(described, layout), point.thrust, point.speed, seed)
        except CutterError as error:
            raise MachineError(f"{self.origin}: cutters: {error}") from None

    def assemble(self) -> System:
        """Assemble M, C, K and the couplings; see `tbm_dynamics.structure.assembly.assemble`.

        Examples
        --------
        >>> system = load_machine("dz101").assemble()
        >>> system.M.shape, float(system.natural_frequencies(1)[0].round(1))
        ((420, 420), 1.8)
        """
        from tbm_dynamics.structure.assembly import assemble  # noqa: PLC0415 - scipy, for those who assemble

        return assemble(self)


def load_machine(machine: str | Path) -> Machine:
    """Load a shipped machine by name, or a machine file by path.

    Raises
    ------
    MachineError
        One line that names file, key and what is allowed.

    Examples
    --------
    >>> load_machine("dz101").name
    'dz101'
    """
    shipped = str(machine) in shipped_machines()
    return Machine(read_description(machine), origin=str(machine if shipped else real_path(machine)))
